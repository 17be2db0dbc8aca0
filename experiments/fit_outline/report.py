"""The tables of the README from results.json."""

__all__ = ["TOLD", "tables"]

from experiments.markdown import number, table
from experiments.recording import Results

TOLD = {"axis": "deg", "across": "mm", "distance": "mm", "height": "mm"}
"""What is compared, and in which unit."""


def tables(results: Results) -> str:
    """Errors over the bound, intervals, and masks of other things."""
    values, over, inside = results.values, [], []
    for case in results.cases("can.", ".failures"):
        ratios = [number(values[f"{case}.{name}.over_bound"], ".2f") for name in TOLD]
        errors = [number(values[f"{case}.{name}.rmse"]) for name in TOLD]
        ends = f"{values[f'{case}.failures']}", f"{values[f'{case}.time']:.0f}"
        over.append([case, *ratios, *errors, *ends])
        shares = [f"{100 * values[f'{case}.{name}.inside']:.1f}" for name in TOLD]
        inside.append([case, *shares])
    units = [f"RMSE of {name}, {unit}" for name, unit in TOLD.items()]
    blocks = [
        table(["error over the bound", *TOLD, *units, "failures", "ms"], over),
        table(["95 % intervals that hold, %", *TOLD], inside),
    ]
    others = results.cases("other.", ".successes")
    rows = [
        [case, *(f"{values[f'{case}.{end}']}" for end in ("successes", "undetermined"))]
        for case in others
    ]
    blocks.append(table(["mask of", "called a can", "undetermined"], rows))
    return "\n\n".join(blocks)
