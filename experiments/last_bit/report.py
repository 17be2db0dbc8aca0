"""The table of the README from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, case_table
from experiments.markdown import percent
from experiments.recording import Results

COLUMNS = (
    Column("status kept", "kept", lambda part: percent(part, ".4g")),
    Column("estimates that move by > 0.1", "far", ".0f"),
    Column("median, deviations", "median", ".2g"),
    Column("largest, deviations", "largest", ".2g"),
)


def tables(results: Results) -> str:
    """A row for each kind of image."""
    head, kinds = "images, and what is changed", results.cases("", ".kept")
    return case_table(
        results, head, kinds, COLUMNS, lambda case: case.replace(".", ", ")
    )
