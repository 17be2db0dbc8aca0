"""JSON of files: read within bounds, and an error names the file."""

__all__ = [
    "arguments_of",
    "check_depth",
    "check_keys",
    "check_version",
    "json_value",
    "read_json_object",
    "typed_record",
]

import inspect
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from impostor_jax.io.input_file import opened
from impostor_jax.plain_arguments import one_of, whole_number

MAX_DEPTH = 100
"""Deepest nesting of lists and objects; files of this package need seven, and two more
for each solid in a solid."""


def read_json_object(path: Path, what: str) -> dict[str, Any]:
    """Read a JSON file that holds one object; `what` names it in errors.

    Raises:
        ValueError: The file is missing or broken, or holds something else.
    """
    with opened(path, what) as file:
        record = json_value(file.read(), what)
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
    check_depth(record, what)
    return record


def check_depth(record: Any, what: str) -> None:
    """Raise a `ValueError` where a record is nested deeper than is read."""
    # Who reads the record may go through it by recursion.
    level: list[Any] = [record] if isinstance(record, dict | list) else []
    for _ in range(MAX_DEPTH + 1):
        if not level:
            return
        level = [
            child
            for node in level
            for child in (node.values() if isinstance(node, dict) else node)
            if isinstance(child, dict | list)
        ]
    raise ValueError(_too_deep(what))


def check_keys(
    record: dict[str, Any], required: Iterable[str], allowed: Iterable[str], what: str
) -> None:
    """Raise a `ValueError` unless a record has all required keys and allowed ones."""
    if missing := [key for key in required if key not in record]:
        raise ValueError(f"{what} lacks {', '.join(missing)}")
    if unknown := sorted(set(record) - set(allowed)):
        raise ValueError(f"{what} holds unknown keys: {', '.join(unknown)}")


def check_version(record: dict[str, Any], newest: int, what: str) -> None:
    """Raise a `ValueError` where a record is newer than what is read.

    Args:
        record: One without a version is of the first.
        newest: Version that is read.
        what: Names it in errors.
    """
    version = whole_number(f"version of {what}", record.get("version", 1), 1)
    if version > newest:
        raise ValueError(
            f"version of {what} must be at most {newest}, got {version}: it is of a "
            "newer impostor_jax"
        )


def typed_record(
    kinds: Mapping[str, Callable[..., Any]], record: Any, what: str
) -> tuple[str, dict[str, Any]]:
    """Take apart the record of an object: its type, and the arguments of its class.

    Args:
        kinds: Classes, and functions that make objects, by their names in records.
        record: With the key `type`.
        what: Names it in errors.

    Raises:
        ValueError: The type is unknown, or an argument is missing or unknown.
    """
    name: Any = record.get("type") if isinstance(record, dict) else record
    one_of(f"type of {what}", name, kinds)
    if not isinstance(record, dict):
        raise ValueError(f"{what} must be a JSON object, got {record!r}")
    values = {key: value for key, value in record.items() if key != "type"}
    known = arguments_of(kinds[name])
    required = [
        key for key, argument in known.items() if argument.default is argument.empty
    ]
    check_keys(values, required, known, f"{what} ({name})")
    return name, values


def arguments_of(kind: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """What a class, or a function, makes objects from."""
    if not isinstance(kind, type):
        return dict(inspect.signature(kind).parameters)
    arguments = dict(inspect.signature(kind.__init__).parameters)
    del arguments["self"]
    return arguments


def _too_deep(what: str) -> str:
    return f"{what} must not be nested more than {MAX_DEPTH} deep"
