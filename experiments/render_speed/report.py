"""The table and the figure of the README, from results.json."""

__all__ = ["draw", "table"]

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.recording import read_spreads
from impostor_jax.io.atomic import write_atomically

LABELS = {
    "frame_c": "depth, normal, mask: C",
    "frame_jax": "depth, normal, mask",
    "depth_only": "depth",
    "tile": "depth, normal, mask on a tile",
    "many_gl": "10000 cylinders: OpenGL, read back",
    "many_jax": "10000 cylinders: every ray at every one",
    "many_scene": "10000 cylinders: as a scene",
    "scene_cylinders": "1000 cylinders as a scene",
    "scene_mixed": "1000 mixed shapes as a scene",
    "gradient_tile": "loss and gradient on a tile",
    "gradient_own_tile": "loss and gradient, tile placed inside",
    "fit_mask": "fit with a mask",
    "fit_no_mask": "fit without a mask",
    "first_render": "first render of a process",
    "first_fit": "first fit of a process",
}
"""Cases that have a median."""

OTHERS = {
    "frame.ratio_of_jax_to_c": "depth, normal, mask: JAX / C",
    "first_render.import": "import before the first render, ms",
    "first_render.arguments": "its camera and cylinder, ms",
    "first_render.memory": "its peak resident memory, MB",
    "first_fit.import": "import before the first fit, ms",
    "first_fit.arguments": "its camera and image, ms",
    "first_fit.memory": "its peak resident memory, MB",
}
"""Other metrics."""


def table(folder: Path) -> str:
    """Results of a folder in Markdown; what was not measured is left blank."""
    values = read_spreads(folder)
    lines = [
        "| case | median, ms | spread, ms | minimum, ms | page faults |",
        "|---|--:|--:|--:|--:|",
    ]
    for case, label in LABELS.items():
        least, faults = values[f"{case}.minimum"][0], values[f"{case}.page_faults"][0]
        numbers = (*values[f"{case}.median"], least, faults)
        lines.append(_row(label, numbers))
    lines += ["", "| quantity | median | spread |", "|---|--:|--:|"]
    lines += [_row(label, values[name]) for name, label in OTHERS.items()]
    return "\n".join(lines)


def draw(folder: Path) -> None:
    """Draw the medians of a folder's results as bars, on a logarithmic axis."""
    values = read_spreads(folder)
    cases = [case for case in LABELS if values[f"{case}.median"][0] is not None]
    medians, spreads = np.array([values[f"{case}.median"] for case in cases]).T
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    axes.barh(
        [LABELS[case] for case in cases],
        medians,
        xerr=spreads / 2,
        color=["tab:orange" if case == "frame_c" else "tab:blue" for case in cases],
        error_kw={"capsize": 3},
    )
    for row, (median, spread) in enumerate(zip(medians, spreads, strict=True)):
        where = 1.15 * (median + spread / 2)
        axes.text(where, row, f"{_number(median)} ms", va="center", fontsize=8)
    axes.set_xscale("log")
    axes.set_xlim(medians.min() / 4, medians.max() * 8)
    axes.invert_yaxis()
    axes.set_xlabel("median time in ms; whiskers as wide as the interquartile range")
    write_atomically(folder / "figures" / "render_speed.png", figure.savefig)


def _row(label: str, numbers: tuple[float | None, ...]) -> str:
    return f"| {' | '.join([label, *map(_number, numbers)])} |"


def _number(value: float | None) -> str:
    """Three digits, or all that stand before the point."""
    if value is None:
        return ""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
