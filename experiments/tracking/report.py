"""The tables of the README from results.json."""

__all__ = ["COMPARED", "tables"]

from collections.abc import Callable

from experiments.columns import Column, case_table, without_group
from experiments.markdown import number
from experiments.recording import Results

COMPARED = (
    "radius",
    "height",
    "center_first",
    "center_second",
    "center_along",
    "axis_first",
    "axis_second",
)
"""Coordinates whose intervals are counted."""


def _or_dash(form: str) -> Callable[[float | None], str]:
    return lambda value: number(value, form) or "-"


WHOLE, ONE, THREE = map(_or_dash, (".0f", ".1f", ".3f"))
"""Numbers with so many digits behind the point."""

INTERVALS = (
    Column("radius: error, um", "radius.rms", ONE, 1e6),
    Column("std, last over first", "radius.fall", _or_dash(".2f")),
    *(Column(f"{x}: 95 % that hold", f"{x}.inside", ONE, 100) for x in COMPARED),
)

COUNTS = (
    Column("cylinders", "truths", WHOLE),
    Column("missed, %", "missed", ONE, 100),
    Column("false", "false", WHOLE),
    Column("switches", "switches", WHOLE),
    Column("MOTA", "mota", THREE),
)

TIMES = Column("median, ms", "median", ONE), Column("99 %, ms", "slow", ONE)

REAL_TIME = (
    Column("dropped, %", "dropped", ONE, 100),
    Column("delay, ms", "median", ONE),
    Column("99 %, ms", "slow", ONE),
    Column("not followed, %", "missed", ONE, 100),
    Column("switches", "switches", WHOLE),
    Column("place: error, um", "aside", ONE, 1e6),
    Column("velocity: error, mm/s", "speed", ONE, 1e3),
    Column("std of radius, um", "radius", ONE, 1e6),
)


def tables(results: Results) -> str:
    """Intervals by case, counts of videos, times, and what a camera drops."""
    times = [f"time.{name}" for name in ("tracked", "searched", "find_cylinders")]
    parts = [
        ("case", results.cases("intervals.", ".radius.inside"), INTERVALS),
        ("videos", results.cases("videos.", ".mota"), COUNTS),
        ("image", times, TIMES),
    ]
    if dropped := results.cases("real_time.", ".dropped"):
        parts.append(("images taken", dropped, REAL_TIME))
    blocks = [case_table(results, *part, label=without_group) for part in parts]
    kept = ONE(100 * results.values["hidden.kept"])
    blocks.append(f"Hidden for 20 images: {kept} % of the cans keep their identity.")
    return "\n\n".join(blocks)
