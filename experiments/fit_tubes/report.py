"""The tables of the README from results.json."""

__all__ = ["SIZES", "tables"]

from experiments.columns import Column, case_table, without_group
from experiments.recording import Results

SIZES = ("outer_radius", "inner_radius", "height")
"""Of a tube, what is compared."""

ERRORS = (
    *(Column(name, f"{name}.over_bound", ".2f") for name in SIZES),
    *(Column(f"bias of {name}", f"{name}.bias", "+.2f") for name in SIZES),
    Column("failures", "failures", ""),
    Column("ms", "time", ".0f"),
)

INTERVALS = [Column(name, f"{name}.inside", ".1f", 100) for name in SIZES]

TESTS = (
    Column("needed", "needed", ".3f"),
    Column("not told", "failures", ""),
    Column("least statistic", "statistic.least"),
    Column("largest", "statistic.most"),
)


def tables(results: Results) -> str:
    """Errors over the bound, intervals, and the test of a bore."""
    tubes = results.cases("tube.", ".failures")
    blocks = [
        case_table(results, "error over the bound", tubes, ERRORS),
        case_table(results, "95 % intervals that hold, %", tubes, INTERVALS),
    ]
    if tested := results.cases("bore.", ".needed"):
        blocks.append(case_table(results, "bore", tested, TESTS, without_group))
    return "\n\n".join(blocks)
