"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, Failures, case_table, without_group
from experiments.markdown import three_digits
from experiments.mask_errors.scenes import MASKS
from experiments.recording import Results

GROUPS = ("table", "small", "lying", "wall")

OF_CANS = (
    Column("intervals that hold", "all.coverage_95", ".1%"),
    *(Column(group, f"{group}.coverage_95", ".1%") for group in GROUPS),
    Column(f"largest: {GROUPS[0]}", f"{GROUPS[0]}.largest", three_digits),
    *(Column(group, f"{group}.largest", three_digits) for group in GROUPS[1:]),
    Column("beyond 5", "all.far", ""),
    Failures(start="all.status"),
    Column("ms", "all.time", three_digits),
)

OF_PRESETS = (
    Column("fits", "number", ""),
    Column("intervals that hold", "coverage_95", ".1%", has_spread=True),
    Column("largest", "largest", three_digits),
    Column("beyond 5", "far", ""),
    Column("wrong", "wrong", ""),
    Failures(),
    Column("ms", "time", three_digits),
)


def tables(results: Results) -> str:
    """Cans with each mask, by their noise, and the presets."""
    blocks = []
    for noise in _noises(results):
        cases = (f"{noise}.{mask}" for mask in MASKS)
        known = [case for case in cases if f"{case}.all.failures" in results.values]
        blocks.append(
            case_table(results, f"mask, {noise}", known, OF_CANS, without_group)
        )
    presets = results.cases("preset.", ".failures")
    blocks.append(case_table(results, "preset", presets, OF_PRESETS, without_group))
    return "\n\n".join(blocks)


def _noises(results: Results) -> list[str]:
    """What the first part of a can's metrics says."""
    firsts = dict.fromkeys(name.split(".")[0] for name in results.values)
    return [first for first in firsts if first != "preset"]
