"""Results of many images, as arrays."""

__all__ = ["read_results"]

from pathlib import Path

import numpy as np

from impostor_jax.io.input_file import require_file
from impostor_jax.io.tables import arrays_of, read_table
from impostor_jax.many.journal import read_entries

JOURNALS = ".jsonl"
"""Ending of the files that grow as images are done."""


def read_results(path: str | Path) -> dict[str, np.ndarray]:
    """Read the results of many images, a column each.

        results = ij.read_results("out/results.csv")
        good = results["status"] == "converged"
        print(results["image"][good], results["radius_m"][good])

    Args:
        path: `.csv` or `.parquet`, as `impostor-jax fit` and `find` write them of many
            images, and `write_table` of one; or `.jsonl`, which holds what is done of a
            run.

    Returns:
        Arrays of as many values as there are rows: of numbers, NaN where there is
        none; of words; or, of `covariance`, of arrays.

    Raises:
        ValueError: The file is missing or no table, or pyarrow is not installed.
    """
    path = Path(path)
    require_file(path, f"table {str(path)!r}")
    if path.suffix.lower() != JOURNALS:
        return read_table(path)
    rows = [row for entry in read_entries(path) for row in entry.rows]
    names = dict.fromkeys(name for row in rows for name in row)
    return arrays_of({name: [row.get(name) for row in rows] for name in names})
