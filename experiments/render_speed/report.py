"""The tables and the figures of the README, from results.json."""

__all__ = ["draw", "table"]

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.recording import read_spreads, three_digits
from experiments.render_speed.names import FIRST, GROUPS, RATIOS, Group
from impostor_jax.io.atomic import write_atomically

CURVE_LABELS = {
    "pixels": "pixels of an image of one can",
    "cylinders": "cylinders of a scene",
    "batch": "cans of a batch: loss and gradient",
    "parameters": "parameters of a scene: loss and gradient",
}
"""What grows, by the name of the curve."""

BUSY = 1.5
"""Median of C over its minimum that only a busy machine shows."""

Spreads = dict[str, tuple[float | None, float | None]]
Points = list[tuple[int, float, float]]


def table(folder: Path) -> str:
    """Results of a folder in Markdown; what was not measured is left blank."""
    values = read_spreads(folder)
    lines: list[str] = []
    for name, group in GROUPS.items():
        lines += [
            f"| {group.title} | median, ms | spread, ms | minimum, ms | page faults |",
            "|---|--:|--:|--:|--:|",
        ]
        for case, label in group.labels.items():
            others = (
                values[f"{name}.{case}.{key}"][0] for key in ("minimum", "page_faults")
            )
            lines.append(_row(label, *values[f"{name}.{case}.median"], *others))
        lines.append("")
    lines += _ratio_lines(values)
    lines += [
        "",
        "| time against | program | smallest, ms | largest, ms | exponent |",
        "|---|---|--:|--:|--:|",
    ]
    for name, label in CURVE_LABELS.items():
        for program, points in _curves(values, name).items():
            exponent = values[f"scaling.{name}.{program}.exponent"][0]
            ends = [
                f"{three_digits(time)} ({size})"
                for size, time, _ in (points[0], points[-1])
            ]
            cells = [label, program, *ends, three_digits(exponent)]
            lines.append(f"| {' | '.join(cells)} |")
    lines += [
        "",
        "| in a new process | median | spread |",
        "|---|--:|--:|",
    ]
    for kind, label in FIRST.items():
        for key, text in (
            ("call", f"{label}, ms"),
            ("import", "import before it, ms"),
            ("arguments", "its camera and cylinder, ms"),
            ("memory", "peak resident memory, MB"),
        ):
            lines.append(_row(text, *values[f"first.{kind}.{key}"]))
    return "\n".join(lines)


def draw(folder: Path) -> None:
    """Draw the medians as bars and the scaling as curves, on logarithmic axes."""
    values = read_spreads(folder)
    rows = [len(group.labels) for group in GROUPS.values()]
    bars = Figure(figsize=(9, 1.5 + 0.27 * sum(rows)), layout="constrained")
    panels = bars.subplots(len(GROUPS), 1, sharex=True, height_ratios=rows)
    for axes, (name, group) in zip(panels, GROUPS.items(), strict=True):
        _bars(axes, values, name, group)
    panels[-1].set_xlabel(
        "median time in ms; whiskers as wide as the interquartile range"
    )
    write_atomically(folder / "figures" / "render_speed.png", bars.savefig)
    curves = Figure(figsize=(10, 7), layout="constrained")
    for axes, (name, label) in zip(
        curves.subplots(2, 2).flat, CURVE_LABELS.items(), strict=True
    ):
        _lines(axes, values, name)
        axes.set_xlabel(label)
    write_atomically(folder / "figures" / "scaling.png", curves.savefig)


def _ratio_lines(values: Spreads) -> list[str]:
    """The ratios beside what is wanted, and a word where the machine was busy."""
    lines = [
        "| ratio | median | spread | of minima | wanted | met |",
        "|---|--:|--:|--:|--:|---|",
    ]
    for name, ratio in RATIOS.items():
        value, spread = values[f"ratio.{name}"]
        met = ""
        if value is not None and ratio.wanted is not None:
            met = "yes" if value <= ratio.wanted else "no"
        least = values[f"ratio.{name}.of_minima"][0]
        row = _row(ratio.label, value, spread, least, ratio.wanted)
        lines.append(f"{row} {met} |")
    for name, group in GROUPS.items():
        case = f"{name}.{next(iter(group.labels))}"  # of C
        median, least = values[f"{case}.median"][0], values[f"{case}.minimum"][0]
        if median is not None and least is not None and median > BUSY * least:
            lines += [
                "",
                f"Of {group.title} C's median is {median / least:.1f} times its "
                "minimum: the machine was busy, and the ratios to C do not hold.",
            ]
    return lines


def _bars(axes: Axes, values: Spreads, name: str, group: Group) -> None:
    """One bar for each case that was measured; those of C stand out."""
    labels = []
    for case, label in group.labels.items():
        median, spread = values[f"{name}.{case}.median"]
        if median is None or spread is None:
            continue
        row = len(labels)
        labels.append(label)
        color = "tab:blue" if _is_ours(case) else "tab:gray"
        color = "tab:orange" if case.split("_")[0] == "c" else color
        axes.barh(row, median, xerr=spread / 2, color=color, error_kw={"capsize": 2})
        where = 1.1 * (median + spread / 2)
        axes.text(where, row, f"{three_digits(median)} ms", va="center", fontsize=8)
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.set_xscale("log")
    axes.margins(x=0.15)
    axes.invert_yaxis()
    axes.set_title(group.title, loc="left", fontsize=9, fontweight="bold")
    axes.grid(axis="x", alpha=0.3)


def _lines(axes: Axes, values: Spreads, name: str) -> None:
    """Time against size for each program, with its exponent in the legend."""
    for program, points in _curves(values, name).items():
        size, median, spread = np.array(points).T
        exponent = values[f"scaling.{name}.{program}.exponent"][0]
        label = {"jax": "render", "c": "C"}[program]
        if exponent is not None:
            label += f", exponent {exponent:.2f}"
        color = "tab:orange" if program == "c" else "tab:blue"
        axes.errorbar(
            *(size, median, spread / 2),
            fmt="o-",
            color=color,
            capsize=3,
            label=label,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylabel("median time, ms")
    axes.grid(alpha=0.3)
    axes.legend()


def _curves(values: Spreads, name: str) -> dict[str, Points]:
    """Size, median and spread of the points of a curve, by program."""
    found: dict[str, Points] = {}
    for metric, (median, spread) in values.items():
        kind, *rest = metric.split(".")
        if kind != "scaling" or rest[0] != name or rest[2] == "exponent":
            continue
        assert median is not None
        assert spread is not None
        found.setdefault(rest[1], []).append((int(rest[2]), median, spread))
    return found


def _is_ours(case: str) -> bool:
    return case.split("_")[0] in ("frame", "depth", "tile", "loss", "scene", "mixed")


def _row(label: str, *numbers: float | None) -> str:
    return f"| {' | '.join([label, *map(three_digits, numbers)])} |"
