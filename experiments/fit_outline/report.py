"""The tables of the README from results.json."""

__all__ = ["TOLD", "tables"]

from experiments.columns import Column, case_table
from experiments.recording import Results

TOLD = {"axis": "deg", "across": "mm", "distance": "mm", "height": "mm"}
"""What is compared, and in which unit."""

ERRORS = (
    *(Column(name, f"{name}.over_bound", ".2f") for name in TOLD),
    *(Column(f"RMSE of {x}, {unit}", f"{x}.rmse") for x, unit in TOLD.items()),
    Column("failures", "failures", ""),
    Column("ms", "time", ".0f"),
)

INTERVALS = [Column(name, f"{name}.inside", ".1f", 100) for name in TOLD]

OTHERS = (
    Column("called a can", "successes", ""),
    Column("undetermined", "undetermined", ""),
)


def tables(results: Results) -> str:
    """Errors over the bound, intervals, and masks of other things."""
    cans = results.cases("can.", ".failures")
    others = results.cases("other.", ".successes")
    blocks = (
        case_table(results, "error over the bound", cans, ERRORS),
        case_table(results, "95 % intervals that hold, %", cans, INTERVALS),
        case_table(results, "mask of", others, OTHERS),
    )
    return "\n\n".join(blocks)
