"""Tables of what was found in one image or cloud: a row for each cylinder."""

__all__ = ["table_of", "write_table"]

from pathlib import Path
from typing import Any

from impostor_jax.find.found import AbstractFound
from impostor_jax.io.tables import columns_of, write_rows


def table_of(found: AbstractFound) -> list[dict[str, Any]]:
    """Rows of what was found, the surest first.

    Columns are those of `found.to_dict()`, vectors and deviations taken apart:
    `center_m_x`, `std_radius_m`. What is no finite number is None.

    Args:
        found: Of a search of an image or of a cloud.
    """
    return [columns_of(record) for record in found.to_dict()["cylinders"]]


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
    rows = table_of(found)
    write_rows(lambda: rows, path)
