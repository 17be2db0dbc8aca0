"""The tables of the README from results.json, and the figure."""

__all__ = ["draw", "tables"]

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.markdown import table
from experiments.recording import Results
from impostor_jax.glsl.conventions import DrawnMaps
from impostor_jax.parity.compare import angles_between

Values = dict[str, float]

PROGRAMS = ("published", "ours")


def tables(results: Results) -> str:
    """A table for each fault."""
    values = results.values
    rows = []
    for size in _sizes(values, "normals"):
        worst = values[f"normals.{size}.ours.worst"]
        parts = (values[f"normals.{size}.published.{p}"] for p in ("mean", "worst"))
        rows.append([size, *(f"{part:.1f}" for part in parts), f"{worst:.2g}"])
    head = ["published normals, deg: mean", "worst", "ours: worst"]
    blocks = [table(["height / radius", *head], rows)]
    rows = []
    for size in _sizes(values, "caps"):
        keys = (f"caps.{size}.{cap}.published.flipped" for cap in ("minus", "plus"))
        rows.append([size, *(f"{100 * values[key]:.0f} %" for key in keys)])
    head = ["half height, units", "cap at -axis flipped", "cap at +axis flipped"]
    blocks.append(table(head, rows))
    places = {
        f"cut.{size:g}.{distance:g}": [f"{size:g}", f"{distance:g}"]
        for size, distance in sorted({_cut(k) for k in values if k.startswith("cut.")})
    }
    rows = [
        [*place, *(f"{100 * values[f'{key}.{n}']:.1f} %" for n in PROGRAMS)]
        for key, place in {**places, "inside": ["6, camera inside", "0.3"]}.items()
    ]
    head = ["height / radius", "distance / radius", "published misses", "ours"]
    blocks.append(table(head, rows))
    rows = [
        [
            size,
            *(
                f"{values[f'depth.{size}.{name}.{part}']:.2g}"
                for name in PROGRAMS
                for part in ("median", "p99", "worst")
            ),
        ]
        for size in _sizes(values, "depth")
    ]
    head = ["distance / radius", "published depth, radii: median", "99 %", "worst"]
    blocks.append(table([*head, "ours: median", "99 %", "worst"], rows))
    return "\n\n".join(blocks)


def draw(results: Results, published: DrawnMaps, ours: DrawnMaps) -> Figure:
    """Draw the faults: one view of both programs, normals and depth errors."""
    values = results.values
    figure = Figure(figsize=(11, 6.5), layout="constrained")
    (first, second, wrong), (angle, cap, depth) = figure.subplots(2, 3)
    for axes, maps, title in (
        (first, published, "as published"),
        (second, ours, "corrected"),
    ):
        axes.imshow(_colors(maps))
        axes.set(title=f"{title}: normals", xticks=[], yticks=[])
    _draw_difference(wrong, published, ours)
    sizes = _sizes(values, "normals")
    heights = [float(size) for size in sizes]
    for part in ("mean", "worst"):
        found = [values[f"normals.{size}.published.{part}"] for size in sizes]
        angle.plot(heights, found, "o-", label=part)
    angle.set(
        xlabel="height / radius", ylabel="degrees", title="wall's normals", ylim=0
    )
    angle.legend()
    sizes = _sizes(values, "caps")
    for name, style in (("minus", "o-"), ("plus", "s--")):
        found = [values[f"caps.{size}.{name}.published.flipped"] for size in sizes]
        label = f"cap at {'-' if name == 'minus' else '+'}axis"
        cap.semilogx([float(size) for size in sizes], found, style, label=label)
    cap.axvline(0.5, color="gray", linewidth=0.8)
    cap.set(xlabel="half height, units", ylabel="part", title="flipped cap normals")
    cap.legend()
    sizes = _sizes(values, "depth")
    for name, color in (("published", "C3"), ("ours", "C0")):
        for part, style in (("p99", "o-"), ("worst", ":")):
            found = [values[f"depth.{size}.{name}.{part}"] for size in sizes]
            label = f"{name}, {'99 %' if part == 'p99' else part}"
            distances = [float(size) for size in sizes]
            depth.loglog(distances, found, style, color=color, label=label)
    depth.set(
        xlabel="distance / radius", ylabel="radii", title="error of the wall's depth"
    )
    depth.legend(fontsize="small")
    return figure


def _draw_difference(axes: Axes, published: DrawnMaps, ours: DrawnMaps) -> None:
    """Pixels cut off, and the angle between the normals elsewhere."""
    both = published.mask & ours.mask
    angle = np.full(both.shape, np.nan)
    angle[both] = angles_between(published.normal[both], ours.normal[both])
    shown = axes.imshow(angle, vmin=0, vmax=90)
    colors = np.zeros((*both.shape, 4))
    colors[ours.mask & ~published.mask] = (1, 0, 0, 1)
    axes.imshow(colors)
    axes.figure.colorbar(shown, ax=axes, shrink=0.7)
    axes.set(title="angle, deg; red: cut off", xticks=[], yticks=[])


def _colors(maps: DrawnMaps) -> np.ndarray:
    return np.where(maps.mask[..., None], (1 - maps.normal) / 2, 1.0)


def _sizes(values: Values, group: str) -> list[str]:
    """Sizes of a group of metrics, as they are written in their names."""
    found = {}
    for key in values:
        if key.startswith(f"{group}."):
            # A size may hold a point: it is what stands before the first word.
            parts = key.split(".")[1:]
            size = parts[:1] if not parts[1].isdigit() else parts[:2]
            found[".".join(size)] = None
    return list(found)


def _cut(key: str) -> tuple[float, float]:
    """Height and distance in the name of a metric of what is cut off."""
    parts = key.removeprefix("cut.").split(".")[:-1]
    return float(".".join(parts[:-1])), float(parts[-1])
