"""The table of the README from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, case_table
from experiments.recording import Results

COLUMNS = (
    Column("success", "success", ".2f"),
    Column("said to depart", "departs", ".2f"),
    Column("wrong", "wrong", ".2f"),
    Column("wrong before", "wrong_without", ".2f"),
    Column("at most, std", "largest", ".1f"),
    Column("before, std", "largest_without", ".1f"),
    Column("std of the radius, mm", "radius_std", ".2f", 1e3),
)


def tables(results: Results) -> str:
    """A row a thing."""
    things = results.cases("", ".success")
    return case_table(
        results, "thing", things, COLUMNS, lambda case: case.replace(".", " ")
    )
