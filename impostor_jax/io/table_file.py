"""Tables of records, as spreadsheets read them; nothing here needs JAX."""

__all__ = ["check_table", "columns_of", "write_rows"]

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from impostor_jax.io.atomic import check_output_file, write_atomically

AXES = "xyz"
"""Ends of the names of a vector's columns."""


def check_table(path: Path) -> None:
    """Raise a `ValueError` unless a table can be written to a file."""
    if path.suffix.lower() not in WRITERS:
        known = " or ".join(WRITERS)
        raise ValueError(f"path must end with {known}, got {str(path)!r}")
    check_output_file(path, "path")


def write_rows(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Write a table; one without rows has no columns, either: its file is empty.

    Args:
        rows: With the same columns each.
        path: As `check_table` lets it be.
    """
    writer = WRITERS[path.suffix.lower()]
    write_atomically(path, lambda partial: writer(partial, rows))


def columns_of(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """A value of a record, and what it is made of, with names of their own.

    Args:
        name: Of the value; "" of a whole record.
        value: As JSON holds it.
    """
    if isinstance(value, dict):
        for key, part in value.items():
            yield from columns_of(f"{name}_{key}" if name else key, part)
    elif isinstance(value, list):
        ends = AXES if len(value) == len(AXES) else map(str, range(len(value)))
        for end, part in zip(ends, value, strict=True):
            yield from columns_of(f"{name}_{end}", part)
    else:
        yield name, value


def _write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]) if rows else [])
        if rows:
            table.writeheader()
        table.writerows(rows)


def _write_parquet(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as missing:
        raise ValueError(
            "a .parquet file takes pyarrow: pip install 'impostor_jax[table]'"
        ) from missing
    parquet.write_table(pyarrow.Table.from_pylist(list(rows)), path)


WRITERS = {".csv": _write_csv, ".parquet": _write_parquet}
"""By the end of a file's name."""
