"""The tables and the figures of the README, from results.json."""

__all__ = ["GRID", "NAMES", "draw", "tables"]

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.columns import Column, case_table, without_group
from experiments.find_accuracy.programs import OURS, PROGRAMS
from experiments.markdown import number, percent, table
from experiments.recording import Results
from impostor_jax.matching import BINS, LEVELS

NAMES = (
    *("tabletop_cans", "pipes", "tree_trunks", "inside_pipe", "hard"),
    *("mixed_table", "everyday_things", "no_cylinders"),
)
"""Of the presets."""

GRID = np.linspace(0, 1, 21)
"""Recalls at which precision is told."""

MEAN = "mean"


RIGHT_ONES = (
    Column("radius off by", "radius_error", percent),
    Column("95 % intervals that hold", "interval_95", percent),
    Column("with the true mask", "mask_interval_95", percent),
    Column("radius off the true mask's, std", "from_mask", ".2f"),
)


def tables(results: Results) -> str:
    """Precision, false detections, time, and how good what is found is."""
    programs, presets = _programs(results), _presets(results)
    seen = [preset for preset in presets if _has_truths(results, preset)]
    blocks = []
    head = [f"AP: {' / '.join(LEVELS)}", *programs]
    rows = [
        [_name(results, preset), *(_levels(results, p, [preset]) for p in programs)]
        for preset in seen
    ]
    rows.append([MEAN, *(_levels(results, program, seen) for program in programs)])
    blocks.append(table(head, rows))

    def cells(name: str, preset: str, form: str = ".2f") -> list[str]:
        return [
            number(results.values.get(f"{program}.{preset}.{name}"), form)
            for program in programs
        ]

    for head, first, second in (
        ("false an image (confidence of 0.5 and more)", "false.standard", "sure_false"),
        ("s an image: wall (processor)", "wall", "processor"),
    ):
        rows = []
        for preset in presets:
            pairs = zip(cells(first, preset), cells(second, preset), strict=True)
            rows.append([preset, *(f"{one} ({other})" for one, other in pairs)])
        blocks.append(table([head, *programs], rows))
    head = ["calibration error", *programs]
    rows = [[preset, *cells("calibration_error", preset)] for preset in presets]
    errors = (results.values.get(f"{p}.calibration_error") for p in programs)
    rows.append(["all", *(number(error, ".2f") for error in errors)])
    blocks.append(table(head, rows))
    cases = [f"{OURS}.{preset}" for preset in seen]
    if ours := [case for case in cases if f"{case}.from_mask" in results.values]:
        head = "right ones of ours"
        blocks.append(case_table(results, head, ours, RIGHT_ONES, without_group))
    return "\n\n".join(blocks)


def _programs(results: Results) -> list[str]:
    """Programs that ran."""
    names = {case.split(".")[0] for case in results.cases("", ".false.standard")}
    return [program for program in PROGRAMS if program in names]


def _presets(results: Results) -> list[str]:
    return [name for name in NAMES if f"truths.{name}" in results.values]


def _has_truths(results: Results, preset: str) -> bool:
    return results.values[f"truths.{preset}"] > 0


def _name(results: Results, preset: str) -> str:
    return f"{preset} ({results.values[f'truths.{preset}']:.0f} cylinders)"


def _levels(results: Results, program: str, presets: list[str]) -> str:
    """Mean of some presets at each level, with the spread of the standard one."""
    parts = []
    for level in LEVELS:
        pairs = [results.pair(f"{program}.{name}.ap.{level}") for name in presets]
        found = np.array([pair for pair in pairs if None not in pair])
        if not len(found):
            return ""
        part = f"{found[:, 0].mean():.2f}"
        if level == "standard":
            part += f" ({np.sqrt(np.mean(found[:, 1] ** 2) / len(found)):.2f})"
        parts.append(part)
    return " / ".join(parts)


def draw(results: Results) -> dict[str, Figure]:
    """Draw precision against recall, and what is right against confidence."""
    seen = [name for name in _presets(results) if _has_truths(results, name)]
    curves = Figure(figsize=(10, 6), layout="constrained")
    places = curves.subplots(2, 3, sharex=True, sharey=True).flat
    for preset, axes in zip(seen, places, strict=False):
        _draw_curves(axes, results, preset)
    reliability = Figure(figsize=(5, 4.5), layout="constrained")
    _draw_reliability(reliability.subplots(), results)
    return {"precision_recall": curves, "reliability": reliability}


def _draw_curves(axes: Axes, results: Results, preset: str) -> None:
    for program in _programs(results):
        names = [f"{program}.{preset}.precision.{100 * r:.0f}" for r in GRID]
        if names[0] in results.values:
            heights = [results.values[name] for name in names]
            axes.plot(GRID, heights, ".-", label=program)
    axes.set(title=preset, xlabel="recall", ylabel="precision", ylim=(0, 1.03))
    axes.legend(fontsize=7)


def _draw_reliability(axes: Axes, results: Results) -> None:
    """The area of a point tells how many detections it is of."""
    for program in _programs(results):
        bins = [
            [results.values.get(f"{program}.bin{k}.{part}") for part in PARTS]
            for k in range(BINS)
        ]
        if points := [own for own in bins if None not in own]:
            x, y, n = np.array(points, float).T
            (line,) = axes.plot(x, y, label=program)
            axes.scatter(x, y, 5 + 60 * n / n.max(), color=line.get_color())
    axes.plot([0, 1], [0, 1], color="black", linewidth=0.5)
    axes.set(xlabel="confidence", ylabel="share that is right (standard)")
    axes.legend(fontsize=8)


PARTS = ("confidence", "right", "number")
"""Of a bin of confidences."""
