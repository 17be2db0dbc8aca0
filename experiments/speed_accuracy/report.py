"""The tables and the figures of the README, from results.json."""

__all__ = ["draw", "front", "tables"]

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.recording import read_values
from experiments.speed_accuracy.scenes import DIFFICULTIES, SHAPES
from experiments.speed_accuracy.settings import FITS, RENDERS
from impostor_jax.effort import EFFORTS
from impostor_jax.io.atomic import write_atomically

Values = dict[str, float | None]
Point = tuple[float, float]


def front(points: dict[str, Point]) -> list[str]:
    """Names of the points that no other beats in both coordinates, by the first."""
    kept: list[str] = []
    for name in sorted(points, key=lambda name: points[name]):
        if not kept or points[name][1] < points[kept[-1]][1]:
            kept.append(name)
    return kept


def tables(folder: Path) -> str:
    """Results of a folder in Markdown."""
    values = read_values(folder)
    lines = []
    for name in DIFFICULTIES:
        lines += [
            "",
            f"| {name} | time, ms | over balanced | radius | axis | center "
            "| height, mm | failed | wrong |",
            "|---|--:|--:|--:|--:|--:|--:|--:|--:|",
        ]
        best = front(fit_points(values, name))
        for setting in FITS:
            label = f"fit.{setting}.{name}"
            if f"{label}.time" not in values:
                continue
            numbers = [
                values[f"{label}.{quantity}"]
                for quantity in (
                    "time",
                    "time_over_balanced",
                    "radius_over_bound",
                    "axis_over_bound",
                    "center_over_bound",
                    "height",
                )
            ]
            shares = [values[f"{label}.{part}"] for part in ("failures", "wrong")]
            cells = [*map(_number, numbers), *map(_percent, shares)]
            mark = " *" if setting in best else ""
            lines.append(f"| {setting}{mark} | {' | '.join(cells)} |")
    lines += ["", "| setting | peak memory, MB |", "|---|--:|"]
    for setting in FITS:
        if f"fit.{setting}.memory" in values:
            lines.append(f"| {setting} | {_number(values[f'fit.{setting}.memory'])} |")
    for shape in SHAPES:
        lines += [
            "",
            f"| {shape} | maps, ms | coverage, ms | maps, MB | depth error, median "
            "| largest | coverage error, RMS of edges |",
            "|---|--:|--:|--:|--:|--:|--:|",
        ]
        for setting in RENDERS:
            label = f"render.{setting}.{shape}"
            if f"{label}.size" not in values:
                continue
            quantities = (
                *("maps.time", "coverage.time", "size"),
                *("depth.p50", "depth.p100", "coverage.rms"),
            )
            cells = [_number(values[f"{label}.{q}"]) for q in quantities]
            lines.append(f"| {setting} | {' | '.join(cells)} |")
    return "\n".join([*lines, "", *sentences(values)])


def sentences(values: Values) -> list[str]:
    """What turning each dial of a fit costs and gives, on the easy and hard images."""
    lines = []
    for setting in FITS:
        parts = []
        for name in ("easy", "hard"):
            label, default = f"fit.{setting}.{name}", f"fit.balanced.{name}"
            ratio = values.get(f"{label}.time_over_balanced")
            error, usual = (
                values.get(f"{one}.radius_over_bound") for one in (label, default)
            )
            if setting == "balanced" or ratio is None or not error or not usual:
                continue
            lost = sum(values[f"{label}.{k}"] or 0 for k in ("failures", "wrong"))
            parts.append(
                f"{name}: {ratio:.2f} of the time, {error / usual:.2f} of the radius "
                f"error, {100 * lost:.0f} % failed or wrong"
            )
        if parts:
            lines.append(f"- *{setting}*: {'; '.join(parts)}.")
    return lines


def fit_points(values: Values, name: str) -> dict[str, Point]:
    """Time and radius error of each setting for images of a difficulty."""
    points = {}
    for setting in FITS:
        time, error = (
            values.get(f"fit.{setting}.{name}.{quantity}")
            for quantity in ("time_over_balanced", "radius_over_bound")
        )
        base = values.get(f"fit.balanced.{name}.time")
        if time is not None and error is not None and base is not None:
            points[setting] = (time * base, error)
    return points


def draw(folder: Path) -> None:
    """Error against time, for fits of each difficulty and renders of each shape."""
    values = read_values(folder)
    figure = Figure(figsize=(13, 8), layout="constrained")
    above, below = figure.subplots(2, 3)
    for axes, name in zip(above, DIFFICULTIES, strict=True):
        _scatter(axes, fit_points(values, name))
        axes.set_title(f"fits, {name} images")
        axes.set_xlabel("time of a fit, ms")
    above[0].set_ylabel("RMS radius error over the bound")
    for axes, shape in zip(below, SHAPES, strict=True):
        points = {}
        for setting in RENDERS:
            time, error = (
                values.get(f"render.{setting}.{shape}.{quantity}")
                for quantity in ("coverage.time", "coverage.rms")
            )
            if time is not None and error is not None:
                points[setting] = (time, max(error, 1e-9))
        _scatter(axes, points)
        axes.set_title(f"coverage of a {shape}")
        axes.set_xlabel("time of a render, ms")
    below[0].set_ylabel("RMS error of edge pixels")
    write_atomically(
        folder / "figures" / "speed_accuracy.png",
        lambda temporary: figure.savefig(temporary, dpi=90, format="png"),
    )


def _scatter(axes: Axes, points: dict[str, Point]) -> None:
    best = front(points)
    if best:
        axes.step(
            [points[name][0] for name in best],
            [points[name][1] for name in best],
            where="post",
            color="C0",
            alpha=0.4,
            label="none is faster and more exact",
        )
    for name, (time, error) in points.items():
        preset = name in EFFORTS
        axes.plot(time, error, "o" if preset else ".", color="C3" if preset else "C7")
        axes.annotate(
            name,
            (time, error),
            fontsize=9 if preset else 6.5,
            fontweight="bold" if preset else "normal",
            xytext=(4, 3),
            textcoords="offset points",
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(alpha=0.3, which="both")
    if best:
        axes.legend(fontsize=7, loc="upper right")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.3g} %"
