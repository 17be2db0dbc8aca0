"""The table of the README from results.json."""

__all__ = ["COMPARED", "tables"]

from experiments.markdown import table
from experiments.recording import Results

COMPARED = ("radius", "height")
"""Of a can, what is compared."""


def tables(results: Results) -> str:
    """Errors, their ratio to the bound, biases and intervals, by views and noise."""
    values, rows = results.values, []
    for case in results.cases("views.", ".failures"):
        of_each = [f"{values[f'{case}.failures']}"]
        for name in COMPARED:
            path = f"{case}.{name}"
            of_each += [
                f"{1e6 * values[f'{path}.rms']:.1f}",
                f"{values[f'{path}.over_bound']:.2f}",
                f"{values[f'{path}.over_reachable']:.2f}",
                f"{values[f'{path}.bias']:+.2f}",
                f"{100 * values[f'{path}.inside']:.1f}",
            ]
        _, count, noise = case.split(".")
        rows.append([count, noise, *of_each])
    head = ["views", "noise", "failures"]
    for name in COMPARED:
        head += [
            f"{name}: error, um",
            "over the bound",
            "reachable",
            "bias",
            "95 % that hold",
        ]
    return table(head, rows)
