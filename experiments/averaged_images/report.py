"""The table of the README from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, case_table
from experiments.recording import Results

COLUMNS = (
    Column("success", "success", ".2f"),
    Column("beyond 5", "wrong", ".2f"),
    Column("mean error of the radius, std", "bias", ".1f", has_spread=True),
    Column("at most, std", "largest", ".1f"),
    Column("std of the radius, %", "relative", ".3f", 100),
    Column("heights seen", "heights", ".2f"),
)


def tables(results: Results) -> str:
    """A row a change."""
    return case_table(results, "image", results.cases("", ".success"), COLUMNS)
