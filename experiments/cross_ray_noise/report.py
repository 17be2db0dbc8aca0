"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.cross_ray_noise.programs import OURS, PRACTICE
from experiments.markdown import number, table
from experiments.recording import Results

NAMES = (*OURS, *PRACTICE)

QUANTITIES = {
    "mean": ("mean error of the radius, mm (spread)", 1e3, "+.3f", True),
    "bias": ("mean error over the spread of errors", 1, "+.2f", False),
    "inside": ("95 % intervals that hold, %", 100, ".0f", False),
    "failures": ("failures, %", 100, ".0f", False),
    "time": ("time, ms", 1, ".3g", False),
}
"""Of each: head, scale, format, and whether its spread is told."""


def tables(results: Results) -> str:
    """A table for each quantity: a row for each case, a column for each program."""
    cases = results.cases("", ".learned.failures")
    parts = []
    for quantity, (head, scale, form, is_spread_told) in QUANTITIES.items():
        rows = []
        for case in cases:
            row = [case.replace(".", ", ", 2)]
            for name in NAMES:
                value, spread = results.pair(f"{case}.{name}.{quantity}")
                scaled = [None if x is None else scale * x for x in (value, spread)]
                own = f"{scaled[1]:.3f}" if is_spread_told and scaled[1] else None
                text = number(scaled[0], form)
                row.append(f"{text} ({own})" if own else text)
            rows.append(row)
        parts.append(table([head, *NAMES], rows))
    return "\n\n".join(parts)
