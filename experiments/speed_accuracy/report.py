"""The tables and the figures of the README, from results.json."""

__all__ = ["draw", "tables"]

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from experiments.markdown import number, percent, table
from experiments.recording import Results
from experiments.speed_accuracy.scenes import DIFFICULTIES, SHAPES
from experiments.speed_accuracy.settings import FITS, RENDERS, TRACES
from impostor_jax.effort import EFFORTS

MOST_LOST = 0.05
"""Share of images that may fail or come out wrong with a setting that is compared."""

NOTABLE = 1.2
"""Factor in time or error beside the default from which a setting is named."""

BEFORE = Path(__file__).parent / "before"
"""Results of the presets with the solver before, at commit e4ff0d2."""

Values = dict[str, float | None]
Point = tuple[float, float]


def front(points: dict[str, Point]) -> list[str]:
    """Names of the points that no other beats in both coordinates, by the first."""
    kept: list[str] = []
    for name in sorted(points, key=lambda name: points[name]):
        if not kept or points[name][1] < points[kept[-1]][1]:
            kept.append(name)
    return kept


FIT_COLUMNS = {
    "time": "time, ms",
    "time_over_balanced": "over balanced",
    "radius_over_bound": "radius",
    "axis_over_bound": "axis",
    "center_over_bound": "center",
    "height": "height, mm",
}

REAL_TIMES = {"time": "time, ms", "time_over_balanced": "over balanced"}

REAL_PARTS = {"failures": "failed", "held": "radius within its 95 %"}

RENDER_COLUMNS = {
    "maps.time": "maps, ms",
    "coverage.time": "coverage, ms",
    "size": "maps, MB",
    "depth.p50": "depth error, median",
    "depth.p100": "largest",
    "coverage.rms": "coverage error, RMS of edges",
}

TRACE_COLUMNS = {
    "time": "time, ms",
    "time_over_balanced": "over balanced",
    "rmse": "RMS error",
}


def tables(results: Results) -> str:
    """Fits by difficulty, memory, renders, pictures, and a sentence for each dial."""
    values, blocks = results.values, []
    for name in DIFFICULTIES:
        best, rows = front(fit_points(values, name)), []
        for setting in FITS:
            label = f"fit.{setting}.{name}"
            if f"{label}.time" in values:
                numbers = (number(values[f"{label}.{q}"]) for q in FIT_COLUMNS)
                parts = (percent(values[f"{label}.{p}"]) for p in ("failures", "wrong"))
                mark = " *" if setting in best else ""
                rows.append([f"{setting}{mark}", *numbers, *parts])
        if rows:
            blocks.append(table([name, *FIT_COLUMNS.values(), "failed", "wrong"], rows))
    rows = [
        [
            setting,
            *(number(values[f"fit.{setting}.real.{q}"]) for q in REAL_TIMES),
            *(percent(values[f"fit.{setting}.real.{q}"]) for q in REAL_PARTS),
        ]
        for setting in FITS
        if f"fit.{setting}.real.time" in values
    ]
    if rows:
        columns = [*REAL_TIMES.values(), *REAL_PARTS.values()]
        blocks.append(table(["photographs", *columns], rows))
    memory = {setting: values.get(f"fit.{setting}.memory") for setting in FITS}
    rows = [[setting, number(size)] for setting, size in memory.items() if size]
    blocks.append(table(["setting", "peak memory, MB"], rows))
    for shape in SHAPES:
        rows = []
        for setting in RENDERS:
            label = f"render.{setting}.{shape}"
            if f"{label}.size" in values:
                numbers = (number(values[f"{label}.{q}"]) for q in RENDER_COLUMNS)
                rows.append([setting, *numbers])
        blocks.append(table([shape, *RENDER_COLUMNS.values()], rows))
    rows = [
        [setting, *(number(values[f"trace.{setting}.{q}"]) for q in TRACE_COLUMNS)]
        for setting in TRACES
        if f"trace.{setting}.rmse" in values
    ]
    blocks.append(table(["traced picture", *TRACE_COLUMNS.values()], rows))
    return "\n\n".join([*blocks, "\n".join(sentences(values))]).rstrip()


def sentences(values: Values) -> list[str]:
    """What turning each dial of a fit costs and gives."""
    lines = []
    for setting in FITS:
        parts = []
        for name in (*DIFFICULTIES, "real"):
            label, default = f"fit.{setting}.{name}", f"fit.balanced.{name}"
            ratio = values.get(f"{label}.time_over_balanced")
            if setting == "balanced" or ratio is None:
                continue
            told = [f"{ratio:.2f} of the time"]
            error, usual = (
                values.get(f"{one}.radius_over_bound") for one in (label, default)
            )
            if error and usual:
                told.append(f"{error / usual:.2f} of the radius error")
            lost = sum(values.get(f"{label}.{k}") or 0 for k in ("failures", "wrong"))
            told.append(f"{100 * lost:.0f} % failed or wrong")
            parts.append(f"{name}: {', '.join(told)}")
        if parts:
            lines.append(f"- *{setting}*: {'; '.join(parts)}.")
    return lines


def fit_points(values: Values, name: str) -> dict[str, Point]:
    """Time and radius error of each setting for images of a difficulty.

    Those that lose more than `MOST_LOST` of the images are left out: the errors are of
    the images that are left, the good ones.
    """
    points = {}
    for setting in FITS:
        parts = [values.get(f"fit.{setting}.{name}.{k}") for k in ("failures", "wrong")]
        if sum(part or 0 for part in parts) > MOST_LOST:
            continue
        time, error = (
            values.get(f"fit.{setting}.{name}.{quantity}")
            for quantity in ("time_over_balanced", "radius_over_bound")
        )
        base = values.get(f"fit.balanced.{name}.time")
        if time is not None and error is not None and base is not None:
            points[setting] = (time * base, error)
    return points


def draw(results: Results) -> dict[str, Figure]:
    """Error against time, for fits of each difficulty and renders of each shape."""
    values, before = results.values, Results.read(BEFORE).values
    figure = Figure(figsize=(13, 8), layout="constrained")
    above, below = figure.subplots(2, 3)
    for axes, name in zip(above, DIFFICULTIES, strict=True):
        _scatter(axes, fit_points(values, name), fit_points(before, name))
        axes.set_title(f"fits, {name} images")
        axes.set_xlabel("time of a fit, ms")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5)))
        axes.yaxis.set_major_formatter("{x:g}")
    above[0].set_ylabel("RMS radius error over the bound")
    shown = (
        ("can", "coverage", "coverage.rms", "RMS error of edge pixels"),
        ("rod", "coverage", "coverage.rms", "RMS error of edge pixels"),
        ("can", "maps", "depth.p100", "largest relative depth error"),
    )
    for axes, (shape, kind, quantity, label) in zip(below, shown, strict=True):
        points = {}
        for setting in RENDERS:
            time, error = (
                values.get(f"render.{setting}.{shape}.{name}")
                for name in (f"{kind}.time", quantity)
            )
            if time is not None and error is not None:
                points[setting] = (time, max(error, 1e-9))
        _scatter(axes, points)
        axes.set_title(f"{kind} of a {shape}")
        axes.set_xlabel("time of a render, ms")
        axes.set_ylabel(label)
    lines, labels = above[0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside lower center")
    return {"speed_accuracy": figure}


def _scatter(
    axes: Axes, points: dict[str, Point], before: dict[str, Point] | None = None
) -> None:
    best = front(points)
    for name, point in (before or {}).items():
        axes.plot(*point, "o", color="C3", markerfacecolor="none")
        axes.annotate(
            f"{name}, before",
            point,
            fontsize=6.5,
            xytext=(4, 3),
            textcoords="offset points",
        )
    if best:
        axes.step(
            [points[name][0] for name in best],
            [points[name][1] for name in best],
            where="post",
            color="C0",
            alpha=0.4,
            label="none is faster and more exact",
        )
    usual = points.get("balanced")
    # From above: where two are at one place, the second is written below.
    for index, name in enumerate(sorted(points, key=lambda n: -points[n][1])):
        preset, point = name in EFFORTS, points[name]
        axes.plot(*point, "o" if preset else ".", color="C3" if preset else "C7")
        apart = usual and any(
            max(a / b, b / a) > NOTABLE for a, b in zip(point, usual, strict=True)
        )
        if preset or name in best or apart:
            axes.annotate(
                name,
                point,
                fontsize=9 if preset else 6.5,
                fontweight="bold" if preset else "normal",
                xytext=(4, 3 if index % 2 else -8),
                textcoords="offset points",
            )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(x=0.2, y=0.15)
    # Few numbers along an axis, written out.
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.3)
