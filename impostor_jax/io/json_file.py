"""JSON of files: read within bounds, and an error names the file."""

__all__ = ["json_value", "read_json_object"]

import json
from pathlib import Path
from typing import Any

from impostor_jax.io.input_file import require_file

MAX_DEPTH = 100
"""Deepest nesting of lists and objects; files of this package need seven."""


def read_json_object(path: Path, what: str) -> dict[str, Any]:
    """Read a JSON file that holds one object; `what` names it in errors.

    Raises:
        ValueError: The file is missing or broken, or holds something else.
    """
    require_file(path, what)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{what} cannot be read: {error.strerror}") from error
    record = json_value(data, what)
    if not isinstance(record, dict):
        raise ValueError(f"{what} must hold one JSON object")
    return record


def json_value(data: bytes, what: str) -> Any:
    """What the bytes of JSON hold, in UTF-8 with or without a byte order mark.

    Raises:
        ValueError: It is broken, or nested too deep.
    """
    try:
        record = json.loads(data.decode("utf-8-sig"))
    except RecursionError as error:
        raise ValueError(_too_deep(what)) from error
    except ValueError as error:
        raise ValueError(f"{what} is not readable JSON") from error
    # Who reads the record may go through it by recursion.
    level: list[Any] = [record] if isinstance(record, dict | list) else []
    for _ in range(MAX_DEPTH + 1):
        if not level:
            return record
        level = [
            child
            for node in level
            for child in (node.values() if isinstance(node, dict) else node)
            if isinstance(child, dict | list)
        ]
    raise ValueError(_too_deep(what))


def _too_deep(what: str) -> str:
    return f"{what} must not be nested more than {MAX_DEPTH} deep"
