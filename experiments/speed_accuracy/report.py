"""The tables and the figures of the README, from results.json."""

__all__ = ["draw", "tables"]

from collections.abc import Iterable, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from experiments.columns import Column, case_table
from experiments.markdown import percent
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


FITTED = (
    Column("time, ms", "time"),
    Column("over balanced", "time_over_balanced"),
    Column("radius", "radius_over_bound"),
    Column("axis", "axis_over_bound"),
    Column("center", "center_over_bound"),
    Column("height, mm", "height"),
    Column("failed", "failures", percent),
    Column("wrong", "wrong", percent),
)

PHOTOGRAPHED = (
    *FITTED[:2],
    Column("failed", "failures", percent),
    Column("radius within its 95 %", "held", percent),
)

RENDERED = (
    Column("maps, ms", "maps.time"),
    Column("coverage, ms", "coverage.time"),
    Column("maps, MB", "size"),
    Column("depth error, median", "depth.p50"),
    Column("largest", "depth.p100"),
    Column("coverage error, RMS of edges", "coverage.rms"),
)

TRACED = (*FITTED[:2], Column("RMS error", "rmse"))

MEMORY = [Column("peak memory, MB", "memory")]


def tables(results: Results) -> str:
    """Fits by difficulty, memory, renders, pictures, and a sentence for each dial."""
    values = results.values

    def of_settings(
        head: str,
        case: str,
        settings: Iterable[str],
        columns: Sequence[Column],
        best: Sequence[str] = (),
    ) -> str:
        """Of the settings that were measured; a star marks the best."""
        cases = {case.format(setting): setting for setting in settings}
        known = [key for key in cases if any(one.cell(results, key) for one in columns)]

        def label(key: str) -> str:
            return f"{cases[key]} *" if cases[key] in best else cases[key]

        return case_table(results, head, known, columns, label)

    blocks = []
    for name in DIFFICULTIES:
        best = front(fit_points(values, name))
        blocks.append(of_settings(name, f"fit.{{}}.{name}", FITS, FITTED, best))
    blocks.append(of_settings("photographs", "fit.{}.real", FITS, PHOTOGRAPHED))
    blocks.append(of_settings("setting", "fit.{}", FITS, MEMORY))
    for shape in SHAPES:
        blocks.append(of_settings(shape, f"render.{{}}.{shape}", RENDERS, RENDERED))
    blocks.append(of_settings("traced picture", "trace.{}", TRACES, TRACED))
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
