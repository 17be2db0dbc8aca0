"""The tables and the figure of the README, from results.json."""

__all__ = ["draw", "tables"]

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.markdown import table, three_digits
from experiments.recording import Results
from experiments.render_speed.names import FIRST, GROUPS, RATIOS
from experiments.timing import COLUMNS, case_row

CURVE_LABELS = {
    "pixels": "pixels of an image of one can",
    "cylinders": "cylinders of a scene",
    "batch": "cans of a batch: loss and gradient",
    "parameters": "parameters of a scene: loss and gradient",
}
"""What grows, by the name of the curve."""

BUSY = 1.5
"""Median of C over its minimum that only a busy machine shows."""

Points = list[tuple[int, float, float]]


FIRST_PARTS = {
    "import": "import before it, ms",
    "arguments": "its camera and cylinder, ms",
    "memory": "peak resident memory, MB",
}
"""What is known of a first call besides its time."""


def tables(results: Results) -> str:
    """Cases, ratios, growth and first calls; blank where not measured."""
    blocks = []
    for name, group in GROUPS.items():
        rows = (
            case_row(results, f"{name}.{c}", label) for c, label in group.labels.items()
        )
        blocks.append(table([group.title, *COLUMNS], rows))
    blocks += _ratios(results)
    rows = []
    for name, label in CURVE_LABELS.items():
        for program, points in _curves(results, name).items():
            exponent = results.values[f"scaling.{name}.{program}.exponent"]
            ends = (
                f"{three_digits(time)} ({size})"
                for size, time, _ in (points[0], points[-1])
            )
            rows.append([label, program, *ends, three_digits(exponent)])
    head = ["time against", "program", "smallest, ms", "largest, ms", "exponent"]
    blocks.append(table(head, rows))
    rows = [
        [text, *map(three_digits, results.pair(f"first.{kind}.{key}"))]
        for kind, label in FIRST.items()
        for key, text in {"call": f"{label}, ms", **FIRST_PARTS}.items()
    ]
    blocks.append(table(["in a new process", "median", "spread"], rows))
    return "\n\n".join(blocks)


def draw(results: Results) -> dict[str, Figure]:
    """Draw the scaling as curves, on logarithmic axes."""
    curves = Figure(figsize=(10, 7), layout="constrained")
    for axes, (name, label) in zip(
        curves.subplots(2, 2).flat, CURVE_LABELS.items(), strict=True
    ):
        _lines(axes, results, name)
        axes.set_xlabel(label)
    return {"scaling": curves}


def _ratios(results: Results) -> list[str]:
    """The ratios beside what is wanted, and a word where the machine was busy."""
    values, rows = results.values, []
    for name, ratio in RATIOS.items():
        value, spread = results.pair(f"ratio.{name}")
        met = ""
        if value is not None and ratio.wanted is not None:
            met = "yes" if value <= ratio.wanted else "no"
        numbers = (value, spread, values[f"ratio.{name}.of_minima"], ratio.wanted)
        rows.append([ratio.label, *map(three_digits, numbers), met])
    head = ["ratio", "median", "spread", "of minima", "wanted", "met"]
    blocks = [table(head, rows)]
    for name, group in GROUPS.items():
        case = f"{name}.{next(iter(group.labels))}"  # of C
        median, least = values[f"{case}.median"], values[f"{case}.minimum"]
        if median is not None and median > BUSY * least:
            blocks.append(
                f"Of {group.title} C's median is {median / least:.1f} times its "
                "minimum: the machine was busy, and the ratios to C do not hold."
            )
    return blocks


def _lines(axes: Axes, results: Results, name: str) -> None:
    """Time against size for each program, with its exponent in the legend."""
    for program, points in _curves(results, name).items():
        size, median, spread = np.array(points).T
        exponent = results.values[f"scaling.{name}.{program}.exponent"]
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


def _curves(results: Results, name: str) -> dict[str, Points]:
    """Size, median and spread of the points of a curve, by program."""
    found: dict[str, Points] = {}
    for metric, median in results.values.items():
        kind, *rest = metric.split(".")
        if kind == "scaling" and rest[0] == name and rest[2] != "exponent":
            point = int(rest[2]), median, results.spreads[metric]
            found.setdefault(rest[1], []).append(point)
    return found
