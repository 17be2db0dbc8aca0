"""The table of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import number, table
from experiments.recording import Results

COLUMNS = {
    "cases": ("fits", ".0f"),
    "converged": ("converged", ".0f"),
    "changed": ("another status", ".0f"),
    "moved": ("moved by > 0.001 std", ".0f"),
    "largest": ("by at most, std", ".2g"),
    "seconds.before": ("all together, before, s", ".3g"),
    "seconds.after": ("now, s", ".3g"),
    "worst.before": ("slowest, before, s", ".3g"),
    "worst.after": ("now, s", ".3g"),
}
"""What is told of each kind, and how."""


def tables(results: Results) -> str:
    """A row for each kind."""
    rows = [
        [kind]
        + [
            number(results.values.get(f"{kind}.{name}"), form)
            for name, (_, form) in COLUMNS.items()
        ]
        for kind in results.cases("", ".cases")
    ]
    return table(["warm calls", *(head for head, _ in COLUMNS.values())], rows)
