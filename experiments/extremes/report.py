"""The tables of the README from results.json, and the figure."""

__all__ = ["draw", "tables"]

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.extremes.rays import EXTREMES
from experiments.recording import read_values
from impostor_jax.io.atomic import write_atomically

Values = dict[str, float | None]

FORMULAS = {
    "textbook": "b² - ac",
    "published": "published shader",
    "mitsuba": "Mitsuba, no caps",
    "ours": "impostor_jax",
}


def tables(folder: Path) -> str:
    """Results of a folder in Markdown."""
    values = read_values(folder)
    lines = ["| over all extremes, float32 | 50 % | 99 % | 99.9 % | worst |"]
    lines += ["|---|--:|--:|--:|--:|"]
    for name, label in (
        ("depth", "depth error, eps times its condition number"),
        ("depth_ulps", "depth error, eps"),
        ("gradient", "gradient error, eps times its condition number"),
        ("gradient_relative", "gradient error, eps"),
    ):
        cells = [
            _number(values[f"all.{name}.p{p}"]) for p in ("50", "99", "99.9", "100")
        ]
        lines.append(f"| {label} | {' | '.join(cells)} |")
    lines += ["", "| distance / radius | b² - ac, ulps at 99 % | published | ours |"]
    lines += ["|--:|--:|--:|--:|"]
    for distance in ("10", "100", "1000", "10000", "100000", "1e+06"):
        cells = [
            _number(values[f"image.{distance}.{name}.p99"])
            for name in ("textbook", "published", "ours")
        ]
        lines.append(f"| {float(distance):g} | {' | '.join(cells)} |")
    shown = [n for n in FORMULAS if f"table.far.{n}.wrong" in values]
    lines += ["", f"| extreme | {' | '.join(FORMULAS[n] for n in shown)} |"]
    lines += ["|---|" + "--:|" * len(shown)]
    for extreme, (sentence, _) in EXTREMES.items():
        cells = []
        for name in shown:
            key = f"table.{extreme}.{name}"
            lost = values.get(f"{key}.no_slope")
            cell = _percent(values[f"{key}.wrong"])
            cells.append(f"{cell}, {_percent(lost)}" if lost else cell)
        lines.append(f"| {extreme}: {sentence} | {' | '.join(cells)} |")
    return "\n".join(lines)


def draw(folder: Path) -> None:
    """Draw the heat maps: a row for each plane of extremes, a column a formula."""
    values = read_values(folder)
    drawn = {key.rsplit(".", 1)[1] for key in values if key.startswith("tilt.")}
    shown = [name for name in FORMULAS if name in drawn]
    figure = Figure(figsize=(3 * len(shown) + 1, 6.5), layout="constrained")
    rows = figure.subplots(2, len(shown), squeeze=False)
    planes = (
        ("incidence", ("distance / radius", "angle off the wall, rad")),
        ("tilt", ("height / radius", "angle of axis and ray, rad")),
    )
    for axes, (plane, labels) in zip(rows, planes, strict=True):
        for column, name in zip(axes, shown, strict=True):
            _heat(column, values, plane, name, labels)
            column.set_title(FORMULAS[name])
    bar = figure.colorbar(rows[0, 0].images[0], ax=rows, shrink=0.8)
    bar.set_label("median error of depth, log10 of ulps; gray: no sure hit")
    (folder / "figures").mkdir(exist_ok=True)
    write_atomically(
        folder / "figures" / "extremes.png",
        lambda temporary: figure.savefig(temporary, dpi=90, format="png"),
    )


def _heat(
    axes: Axes, values: Values, plane: str, name: str, labels: tuple[str, str]
) -> None:
    cells = {
        tuple(float(x) for x in key.split("_")): value
        for key, value in (
            (k.removeprefix(f"{plane}.").removesuffix(f".{name}"), v)
            for k, v in values.items()
            if k.startswith(f"{plane}.") and k.endswith(f".{name}")
        )
    }
    first, second = (sorted({key[i] for key in cells}) for i in (0, 1))
    found = np.full((len(second), len(first)), np.nan)
    for (a, b), value in cells.items():
        if value is not None:
            found[second.index(b), first.index(a)] = np.log10(max(value, 0.1))
    axes.set_facecolor("lightgray")
    axes.imshow(found, origin="lower", aspect="auto", vmin=-1, vmax=7, cmap="magma")
    axes.set_xticks(range(len(first)), [f"{x:.7g}" for x in first], rotation=90)
    axes.set_yticks(range(len(second)), [f"{x:g}" for x in second])
    axes.set(xlabel=labels[0], ylabel=labels[1])


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2g}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.3g} %"
