"""The tables and the figure of the README, from results.json."""

__all__ = ["draw", "tables"]

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.markdown import number, table
from experiments.recording import Results
from impostor_jax.fit.fittable import CYLINDER

PROGRAMS = ("impostor_jax", "scipy", "cylfit", "scikit-spatial", "pyransac3d")

GROUPS = (("axis_first", "axis_second"), ("center_first", "center_second"), ("radius",))
"""Coordinates of which the worse is shown."""


def tables(results: Results) -> str:
    """Our cases, other programs, and intervals."""
    values = results.values
    head = ["case", "axis / bound", "center / bound", "radius / bound", "radius, um"]
    head += ["largest bias / spread", "coverage", "failures", "ms"]
    blocks = [table(head, _rows(results))]
    if compared := _compared(results):
        head = ["radius error, um (over the bound)", *compared, "ms"]
        blocks.append(table(head, _comparison(results, compared)))
    head = ["coverage of 95 % intervals", *CYLINDER.coordinates]
    keys = {noise: _intervals(noise) for noise in _noises(results)}
    blocks.append(
        table(
            head,
            (
                [noise, *(f"{values[k]:.3f}" for k in own)]
                for noise, own in keys.items()
            ),
        )
    )
    return "\n\n".join(blocks)


def _rows(results: Results) -> Iterator[list[str]]:
    values = results.values
    for name in _cases(results):
        ratios = [max(values[f"{name}.{c}.over_bound"] for c in g) for g in GROUPS]
        used = [f"{name}.{c}" for group in GROUPS for c in group]
        bias = max(abs(values[f"{c}.bias_over_spread"]) for c in used)
        held = [values[f"{c}.coverage_95"] for c in used]
        yield [
            name,
            *(f"{ratio:.2f}" for ratio in ratios),
            f"{1e6 * values[f'{name}.radius.rmse']:.1f}",
            f"{bias:.2f}",
            f"{min(held):.2f}-{max(held):.2f}",
            f"{values[f'{name}.failures']:.0f}",
            f"{values[f'{name}.time']:.0f}",
        ]


def _comparison(results: Results, compared: list[str]) -> Iterator[list[str]]:
    """The radius error of each program."""
    values = results.values
    for program in PROGRAMS:
        cells = []
        for case in compared:
            name = f"{_prefix(program)}{case}"
            cell, failures = "no fit", values[f"{name}.failures"]
            if (rmse := values.get(f"{name}.radius.rmse")) is not None:
                cell = f"{1e6 * rmse:.3g} ({values[f'{name}.radius.over_bound']:.3g})"
            cells.append(cell + (f", {failures:.0f} fail" if failures else ""))
        time = values[f"{_prefix(program)}{compared[0]}.time"]
        yield [program, *cells, number(time, ".0f")]


def draw(results: Results) -> dict[str, Figure]:
    """Draw radius errors beside other programs', and the coverage of intervals."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _draw_errors(left, results)
    _draw_intervals(right, results)
    return {"fit_accuracy": figure}


def _draw_errors(axes: Axes, results: Results) -> None:
    cases = _compared(results) or _cases(results)
    ends = [f"{case}.radius.over_bound" for case in cases]
    programs = [p for p in PROGRAMS if _prefix(p) + ends[0] in results.values]
    width = 0.8 / len(programs)
    for place, program in enumerate(programs):
        found = np.array([results.pair(_prefix(program) + end) for end in ends], float)
        where = np.arange(len(cases)) + (place - (len(programs) - 1) / 2) * width
        axes.bar(where, found[:, 0], width, yerr=found[:, 1], label=program)
    axes.axhline(1, color="black", linewidth=1)
    axes.set_yscale("log")
    axes.set_xticks(range(len(cases)), [case.replace(".", "\n") for case in cases])
    axes.set_ylabel("RMS radius error / Cramér-Rao bound")
    axes.legend(fontsize=8)


def _draw_intervals(axes: Axes, results: Results) -> None:
    for noise, marker in zip(_noises(results), "os", strict=False):
        found = np.array([results.pair(key) for key in _intervals(noise)], float)
        spread = 2 * found[:, 1]
        axes.errorbar(range(7), found[:, 0], yerr=spread, fmt=marker, label=noise)
    axes.axhspan(0.93, 0.97, alpha=0.2)
    axes.axhline(0.95, color="black", linewidth=1)
    axes.set_xticks(range(7), CYLINDER.coordinates, rotation=45, ha="right")
    axes.set_ylabel("part of 95 % intervals that hold the truth")
    axes.legend(fontsize=8)


def _prefix(program: str) -> str:
    return "" if program == PROGRAMS[0] else f"{program}."


def _intervals(noise: str) -> list[str]:
    return [f"interval.{noise}.{name}.coverage_95" for name in CYLINDER.coordinates]


def _cases(results: Results) -> list[str]:
    """Cases that we fitted."""
    names = results.cases("", ".radius.over_bound")
    return [name for name in names if name.count(".") == 1 and name[0].isdigit()]


def _noises(results: Results) -> list[str]:
    """Noises whose intervals were counted."""
    names = ("white", "correlated")
    return [name for name in names if _intervals(name)[0] in results.values]


def _compared(results: Results) -> list[str]:
    """Cases that other programs fitted, too."""
    return [
        name
        for name in _cases(results)
        if f"{PROGRAMS[1]}.{name}.time" in results.values
    ]
