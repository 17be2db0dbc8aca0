"""The table of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import number, percent, table
from experiments.recording import Results


def tables(results: Results) -> str:
    """A row for each kind of image."""
    rows = []
    for case in results.cases("", ".kept"):
        found = {
            name: results.values.get(f"{case}.{name}")
            for name in ("kept", "far", "median", "largest")
        }
        row = [case.replace(".", ", "), percent(found["kept"], ".4g")]
        row += [number(found["far"], ".0f")]
        row += [number(found[name], ".2g") for name in ("median", "largest")]
        rows.append(row)
    head = [
        *("images, and what is changed", "status kept", "estimates that move by > 0.1"),
        *("median, deviations", "largest, deviations"),
    ]
    return table(head, rows)
