"""Tables for other programs: CSV, or Parquet, of rows that may be many millions.

Nothing here needs JAX, so that a command can refuse a name before JAX starts.
"""

__all__ = [
    "arrays_of",
    "check_table",
    "columns_of",
    "read_table",
    "write_rows",
]

import csv
import itertools
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from impostor_jax.io.atomic import (
    check_output_file,
    check_output_folder,
    write_atomically,
)
from impostor_jax.plain_arguments import one_of

Row = dict[str, Any]
"""Values by column; what is no finite number is None."""

LEFT_OUT = ("std_budget", "world_from_cylinder")
"""Of a record: what a row has no room for."""

AXES = "xyz"
"""Ends of the names of a vector's columns."""

TEXTS = ("image", "name", "status", "reason", "version")
"""Columns of words, though they may look like numbers."""

AT_ONCE = 10_000
"""Rows of a part of a Parquet file, which is written as a whole."""

TABLES = (".csv", ".parquet")
"""Ends of the names of tables."""


def columns_of(record: dict[str, Any]) -> Row:
    """A record as the columns of a row."""
    return {
        name: value
        for key, part in record.items()
        if key not in LEFT_OUT
        for name, value in _columns(key, part)
    }


def check_table(path: str | Path, name: str = "path") -> None:
    """Raise a `ValueError` unless a table can be written.

    Args:
        path: Of its file.
        name: What errors call it.
    """
    path = Path(path)
    if path.suffix.lower() not in TABLES:
        raise ValueError(
            f"{name} must end with {' or '.join(TABLES)}, got {str(path)!r}"
        )
    if path.suffix.lower() == ".parquet":
        _parquet()
    if path.parent.exists():
        check_output_file(path, name)
    else:
        check_output_folder(path.parent)


def write_rows(rows: Callable[[], Iterable[Row]], path: str | Path) -> None:
    """Write a table of rows that need not be in memory all at once.

    Args:
        rows: Gives them, twice: a row may lack columns that others have.
        path: Of the file, which ends with `.csv`, or `.parquet`, which takes pyarrow.
            One that is there is replaced.

    Raises:
        ValueError: The name ends otherwise, the file cannot be written, or pyarrow is
            not installed.
    """
    check_table(path)
    path = Path(path)
    columns: dict[str, list[Any]] = {}
    for row in rows():
        for name, value in row.items():
            kinds = columns.setdefault(name, [])
            if value is not None and type(value) not in kinds:
                kinds.append(type(value))
    write = _write_csv if path.suffix.lower() == ".csv" else _write_parquet
    write_atomically(path, lambda partial: write(partial, columns, rows()))


def read_table(path: Path) -> dict[str, np.ndarray]:
    """Read a table that `write_rows` wrote, a column each.

    Args:
        path: Of a file that is there.

    Returns:
        As `arrays_of`.

    Raises:
        ValueError: It is no table, or pyarrow is not installed.
    """
    one_of("ending of path", path.suffix.lower(), TABLES)
    if path.suffix.lower() == ".parquet":
        _, parquet = _parquet()
        try:
            table = parquet.read_table(path)
        except (OSError, ValueError) as error:
            raise ValueError(f"table {str(path)!r} is no Parquet file") from error
        return arrays_of({k: table[k].to_pylist() for k in table.column_names})
    with path.open(newline="", encoding="utf-8") as file:
        lines = csv.reader(file)
        names = next(lines, [])
        rows = list(lines)
    return arrays_of(
        {name: [_of_text(row[k], name) for row in rows] for k, name in enumerate(names)}
    )


def arrays_of(columns: dict[str, list[Any]]) -> dict[str, np.ndarray]:
    """Arrays of as many values as there are rows.

    Of numbers, NaN where there is none; of words; or, of lists, of arrays.
    """
    return {name: _array(values) for name, values in columns.items()}


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


def _write_csv(path: Path, columns: dict[str, list[type]], rows: Iterable[Row]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        if columns:
            table.writerow(columns)
        for row in rows:
            table.writerow([_text(row.get(name)) for name in columns])


def _text(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list) else value


def _of_text(text: str, name: str) -> Any:
    """A value of a CSV file."""
    if name in TEXTS:
        return text
    if text in ("", "True", "False"):
        return None if text == "" else text == "True"
    try:
        return json.loads(text)
    except ValueError:
        return text


def _array(values: list[Any]) -> np.ndarray:
    """A column's values as an array."""
    some = [value for value in values if value is not None]
    if some and all(isinstance(value, bool) for value in some):
        if len(some) == len(values):
            return np.array(values, bool)
    elif all(isinstance(value, int | float) for value in some):
        return np.array([np.nan if v is None else v for v in values], float)
    elif some and all(isinstance(value, str) for value in some):
        return np.array(["" if value is None else value for value in values])
    array = np.empty(len(values), object)
    for k, value in enumerate(values):
        is_list = isinstance(value, list)
        array[k] = np.array(value, float) if is_list else value
    return array


def _write_parquet(
    path: Path, columns: dict[str, list[type]], rows: Iterable[Row]
) -> None:
    pyarrow, parquet = _parquet()
    types = {
        bool: pyarrow.bool_(),
        int: pyarrow.int64(),
        float: pyarrow.float64(),
        str: pyarrow.string(),
        list: pyarrow.list_(pyarrow.float64()),
    }
    fields = [(name, types[_type(kinds)]) for name, kinds in columns.items()]
    schema, rest = pyarrow.schema(fields), iter(rows)
    with parquet.ParquetWriter(path, schema) as file:
        while part := list(itertools.islice(rest, AT_ONCE)):
            file.write_table(pyarrow.Table.from_pylist(part, schema))


def _type(kinds: list[type]) -> type:
    """Type of a column that holds values of some types."""
    if len(kinds) == 1:
        return kinds[0]
    # Of none it is a number that no row has.
    return float if set(kinds) <= {int, float} else str


def _parquet() -> tuple[Any, Any]:
    """The modules that write and read Parquet."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as missing:
        raise ValueError(
            "a .parquet file takes pyarrow: pip install 'impostor_jax[table]'"
        ) from missing
    return pyarrow, parquet
