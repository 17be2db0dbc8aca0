"""The tables and the figure of the README, from results.json."""

__all__ = ["draw", "tables"]

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.recording import read_spreads
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.io.atomic import write_atomically

PROGRAMS = ("impostor_jax", "scipy", "cylfit", "scikit-spatial", "pyransac3d")

Values = dict[str, tuple[float | None, float | None]]


def tables(folder: Path) -> str:
    """Results of a folder in Markdown: our cases, other programs, and intervals."""
    values = read_spreads(folder)
    lines = [
        "| case | axis / bound | center / bound | radius / bound | radius, um "
        "| largest bias / spread | coverage | failures | ms |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for name in _cases(values):
        groups = (("axis_first", "axis_second"), ("center_first", "center_second"))
        ratios = [
            max(_get(values, f"{name}.{c}.over_bound") for c in group)
            for group in (*groups, ("radius",))
        ]
        used = [c for group in (*groups, ("radius",)) for c in group]
        bias = max(abs(_get(values, f"{name}.{c}.bias_over_spread")) for c in used)
        held = [_get(values, f"{name}.{c}.coverage_95") for c in used]
        radius = 1e6 * _get(values, f"{name}.radius.rmse")
        lines.append(
            f"| {name} | {' | '.join(f'{r:.2f}' for r in ratios)} | {radius:.1f} "
            f"| {bias:.2f} | {min(held):.2f}-{max(held):.2f} "
            f"| {_get(values, f'{name}.failures'):.0f} "
            f"| {_get(values, f'{name}.time'):.0f} |"
        )
    if compared := _compared(values):
        lines += _comparison(values, compared)
    lines += [
        "",
        f"| coverage of 95 % intervals | {' | '.join(CYLINDER.coordinates)} |",
    ]
    lines += [f"|---|{'--:|' * 7}"]
    for noise in _noises(values):
        held = [
            _get(values, f"interval.{noise}.{c}.coverage_95")
            for c in CYLINDER.coordinates
        ]
        lines.append(f"| {noise} | {' | '.join(f'{part:.3f}' for part in held)} |")
    return "\n".join(lines)


def _comparison(values: Values, compared: list[str]) -> list[str]:
    """Table of the radius error of each program."""
    lines = [
        "",
        f"| radius error, um (over the bound) | {' | '.join(compared)} | ms |",
        f"|---|{'--:|' * (len(compared) + 1)}",
    ]
    for program in PROGRAMS:
        cells = []
        for case in compared:
            name = f"{_prefix(program)}{case}"
            failures = _get(values, f"{name}.failures")
            cell = "no fit"
            if f"{name}.radius.rmse" in values:
                rmse = 1e6 * _get(values, f"{name}.radius.rmse")
                cell = f"{rmse:.3g} ({_get(values, f'{name}.radius.over_bound'):.3g})"
            cells.append(cell + (f", {failures:.0f} fail" if failures else ""))
        time = _get(values, f"{_prefix(program)}{compared[0]}.time")
        lines.append(f"| {program} | {' | '.join(cells)} | {time:.0f} |")
    return lines


def draw(folder: Path) -> None:
    """Draw radius errors beside other programs', and the coverage of intervals."""
    values = read_spreads(folder)
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _draw_errors(left, values)
    _draw_intervals(right, values)
    write_atomically(folder / "figures" / "fit_accuracy.png", figure.savefig)


def _draw_errors(axes: Axes, values: Values) -> None:
    cases = _compared(values) or _cases(values)
    programs = [
        p for p in PROGRAMS if f"{_prefix(p)}{cases[0]}.radius.over_bound" in values
    ]
    width = 0.8 / len(programs)
    for place, program in enumerate(programs):
        keys = [f"{_prefix(program)}{case}.radius.over_bound" for case in cases]
        found = np.array([values.get(key, (np.nan, np.nan)) for key in keys], float)
        where = np.arange(len(cases)) + (place - (len(programs) - 1) / 2) * width
        axes.bar(where, found[:, 0], width, yerr=found[:, 1], label=program)
    axes.axhline(1, color="black", linewidth=1)
    axes.set_yscale("log")
    axes.set_xticks(range(len(cases)), [case.replace(".", "\n") for case in cases])
    axes.set_ylabel("RMS radius error / Cramér-Rao bound")
    axes.legend(fontsize=8)


def _draw_intervals(axes: Axes, values: Values) -> None:
    for noise, marker in zip(_noises(values), "os", strict=False):
        keys = [f"interval.{noise}.{name}.coverage_95" for name in CYLINDER.coordinates]
        found = np.array([values[key] for key in keys], float)
        axes.errorbar(
            range(7), found[:, 0], yerr=2 * found[:, 1], fmt=marker, label=noise
        )
    axes.axhspan(0.93, 0.97, alpha=0.2)
    axes.axhline(0.95, color="black", linewidth=1)
    axes.set_xticks(range(7), CYLINDER.coordinates, rotation=45, ha="right")
    axes.set_ylabel("part of 95 % intervals that hold the truth")
    axes.legend(fontsize=8)


def _get(values: Values, name: str) -> float:
    value = values[name][0]
    return float("nan") if value is None else value


def _prefix(program: str) -> str:
    return "" if program == PROGRAMS[0] else f"{program}."


def _cases(values: Values) -> list[str]:
    """Cases that we fitted."""
    end = ".radius.over_bound"
    names = [name.removesuffix(end) for name in values if name.endswith(end)]
    return [name for name in names if name.count(".") == 1 and name[0].isdigit()]


def _noises(values: Values) -> list[str]:
    """Noises whose intervals were counted."""
    names = ("white", "correlated")
    return [n for n in names if f"interval.{n}.radius.coverage_95" in values]


def _compared(values: Values) -> list[str]:
    """Cases that other programs fitted, too."""
    return [name for name in _cases(values) if f"{PROGRAMS[1]}.{name}.time" in values]
