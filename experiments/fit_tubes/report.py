"""The tables of the README from results.json."""

__all__ = ["SIZES", "tables"]

from experiments.markdown import number, table
from experiments.recording import Results

SIZES = ("outer_radius", "inner_radius", "height")
"""Of a tube, what is compared."""


def tables(results: Results) -> str:
    """Errors over the bound, intervals, and the test of a bore."""
    values, over, inside = results.values, [], []
    for case in results.cases("tube.", ".failures"):
        shares = [f"{values[f'{case}.{name}.over_bound']:.2f}" for name in SIZES]
        biases = [f"{values[f'{case}.{name}.bias']:+.2f}" for name in SIZES]
        ends = f"{values[f'{case}.failures']}", f"{values[f'{case}.time']:.0f}"
        over.append([case, *shares, *biases, *ends])
        held = [f"{100 * values[f'{case}.{name}.inside']:.1f}" for name in SIZES]
        inside.append([case, *held])
    biased = [f"bias of {name}" for name in SIZES]
    head = ["error over the bound", *SIZES, *biased, "failures", "ms"]
    blocks = [table(head, over)]
    blocks.append(table(["95 % intervals that hold, %", *SIZES], inside))
    rows = [
        [
            case.split(".", 1)[1],
            f"{values[f'{case}.needed']:.3f}",
            f"{values[f'{case}.failures']}",
            number(values[f"{case}.statistic.least"]),
            number(values[f"{case}.statistic.most"]),
        ]
        for case in results.cases("bore.", ".needed")
    ]
    if rows:
        head = ["bore", "needed", "not told", "least statistic", "largest"]
        blocks.append(table(head, rows))
    return "\n\n".join(blocks)
