"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, case_table
from experiments.cross_ray_noise.programs import OURS, PRACTICE
from experiments.recording import Results

NAMES = (*OURS, *PRACTICE)

QUANTITIES = {
    "mean error of the radius, mm (spread)": ("mean", "+.3f", 1e3, True),
    "mean error over the spread of errors": ("bias", "+.2f"),
    "95 % intervals that hold, %": ("inside", ".0f", 100),
    "failures, %": ("failures", ".0f", 100),
    "time, ms": ("time",),
}
"""By the head of its table, the rest of a column for each program."""


def tables(results: Results) -> str:
    """A table for each quantity: a row for each case, a column for each program."""
    cases = results.cases("", ".learned.failures")
    blocks = []
    for head, (quantity, *rest) in QUANTITIES.items():
        columns = [Column(name, f"{name}.{quantity}", *rest) for name in NAMES]
        blocks.append(case_table(results, head, cases, columns, _label))
    return "\n\n".join(blocks)


def _label(case: str) -> str:
    return case.replace(".", ", ", 2)
