"""The table of the README from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, case_table
from experiments.recording import Results

COLUMNS = (
    Column("fits", "cases", ".0f"),
    Column("converged", "converged", ".0f"),
    Column("another status", "changed", ".0f"),
    Column("moved by > 0.001 std", "moved", ".0f"),
    Column("by at most, std", "largest", ".2g"),
    Column("all together, before, s", "seconds.before"),
    Column("now, s", "seconds.after"),
    Column("slowest, before, s", "worst.before"),
    Column("now, s", "worst.after"),
)


def tables(results: Results) -> str:
    """A row for each kind."""
    return case_table(results, "warm calls", results.cases("", ".cases"), COLUMNS)
