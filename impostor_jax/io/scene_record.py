"""The record of a scene file, as far as it is checked without JAX."""

__all__ = ["VERSION", "check_scene_record", "read_scene_record"]

from pathlib import Path
from typing import Any

from impostor_jax.io.json_file import check_keys, read_json_object

VERSION = 1

REQUIRED = ("version", "shapes")
ALLOWED = (*REQUIRED, "camera", "lights", "background")


def read_scene_record(path: Path) -> dict[str, Any]:
    """Read a scene file's record, whose shapes and lights are not looked at.

    Raises:
        ValueError: The file is missing or broken, of another version, or lacks a key.
    """
    what = f"scene file {str(path)!r}"
    record = read_json_object(path, what)
    check_scene_record(record, what)
    return record


def check_scene_record(record: dict[str, Any], what: str) -> None:
    """Raise a `ValueError` unless a record is of a scene; `what` names its file."""
    check_keys(record, REQUIRED, ALLOWED, what)
    if record["version"] != VERSION:
        raise ValueError(
            f"version of {what} must be {VERSION}, got {record['version']!r}"
        )
    entries, lights = record["shapes"], record.get("lights", [])
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"shapes of {what} must be a list that is not empty")
    if not isinstance(lights, list):
        raise ValueError(f"lights of {what} must be a list, got {lights!r}")
