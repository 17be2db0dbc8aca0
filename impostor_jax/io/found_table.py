"""Tables of what was found: a row for each cylinder, as spreadsheets read them."""

__all__ = ["table_of", "write_table"]

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from impostor_jax.find.found import AbstractFound
from impostor_jax.io.atomic import check_output_file, write_atomically

LEFT_OUT = ("std_budget", "world_from_cylinder")
"""Of a record: what a row has no room for."""

AXES = "xyz"
"""Ends of the names of a vector's columns."""


def table_of(found: AbstractFound) -> list[dict[str, Any]]:
    """Rows of what was found, the surest first.

    Columns are those of `found.to_dict()`, vectors and deviations taken apart:
    `center_m_x`, `std_radius_m`. What is no finite number is None.

    Args:
        found: Of a search of an image or of a cloud.
    """
    return [
        {
            name: value
            for key, part in record.items()
            if key not in LEFT_OUT
            for name, value in _columns(key, part)
        }
        for record in found.to_dict()["cylinders"]
    ]


def write_table(found: AbstractFound, path: str | Path) -> None:
    """Write what was found as a table: `.csv`, or `.parquet`, which takes pyarrow.

    A table without rows has no columns, either: its file is empty.

    Args:
        found: Of a search of an image or of a cloud.
        path: Of the file; one that is there is replaced.

    Raises:
        ValueError: The name ends otherwise, the file cannot be written, or pyarrow is
            not installed.
    """
    path = Path(path)
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        known = " or ".join(WRITERS)
        raise ValueError(f"path must end with {known}, got {str(path)!r}")
    check_output_file(path, "path")
    rows = table_of(found)
    write_atomically(path, lambda partial: writer(partial, rows))


def _columns(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """A value of a record, and what it is made of, with names of their own."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _columns(f"{name}_{key}", part)
    elif isinstance(value, list):
        ends = AXES if len(value) == len(AXES) else map(str, range(len(value)))
        for end, part in zip(ends, value, strict=True):
            yield from _columns(f"{name}_{end}", part)
    else:
        yield name, value


def _write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]) if rows else [])
        if rows:
            table.writeheader()
        table.writerows(rows)


def _write_parquet(path: Path, rows: list[dict[str, Any]]) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as missing:
        raise ValueError(
            "a .parquet file takes pyarrow: pip install 'impostor_jax[table]'"
        ) from missing
    parquet.write_table(pyarrow.Table.from_pylist(rows), path)


WRITERS = {".csv": _write_csv, ".parquet": _write_parquet}
"""By the end of a file's name."""
