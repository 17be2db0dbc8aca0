"""The tables of the README from results.json, and the figure."""

__all__ = ["PERCENTS", "draw", "tables"]

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.extremes.rays import EXTREMES
from experiments.markdown import number, percent, table
from experiments.recording import Results

FORMULAS = {
    "textbook": "b² - ac",
    "published": "published shader",
    "mitsuba": "Mitsuba, no caps",
    "ours": "impostor_jax",
}


PERCENTS = (50, 99, 99.9, 100)
"""Of the errors over all extremes."""


def tables(results: Results) -> str:
    """Over all extremes, over the image, and each extreme alone."""
    values = results.values
    names = {
        "depth": "depth error, eps times its condition number",
        "depth_ulps": "depth error, eps",
        "gradient": "gradient error, eps times its condition number",
        "gradient_relative": "gradient error, eps",
    }
    head = ["over all extremes, float32", *(f"{p:g} %" for p in PERCENTS[:-1]), "worst"]
    rows = [
        [label, *(number(values[f"all.{name}.p{p:g}"], ".2g") for p in PERCENTS)]
        for name, label in names.items()
    ]
    blocks = [table(head, rows)]
    shown = ("textbook", "published", "ours")
    rows = [
        [
            f"{float(distance):g}",
            *(number(values[f"image.{distance}.{n}.p99"], ".2g") for n in shown),
        ]
        for distance in ("10", "100", "1000", "10000", "100000", "1e+06")
    ]
    head = ["distance / radius", "b² - ac, ulps at 99 %", "published", "ours"]
    blocks.append(table(head, rows))
    shown = [name for name in FORMULAS if f"table.far.{name}.wrong" in values]
    rows = []
    for extreme, (sentence, _) in EXTREMES.items():
        cells = []
        for name in shown:
            key = f"table.{extreme}.{name}"
            lost = values.get(f"{key}.no_slope")
            cell = percent(values[f"{key}.wrong"])
            cells.append(f"{cell}, {percent(lost)}" if lost else cell)
        rows.append([f"{extreme}: {sentence}", *cells])
    blocks.append(table(["extreme", *(FORMULAS[name] for name in shown)], rows))
    return "\n\n".join(blocks)


def draw(results: Results) -> dict[str, Figure]:
    """Draw the heat maps: a row for each plane of extremes, a column a formula."""
    values = results.values
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
            _heat(column, results, plane, name, labels)
            column.set_title(FORMULAS[name])
    bar = figure.colorbar(rows[0, 0].images[0], ax=rows, shrink=0.8)
    bar.set_label("median error of depth, log10 of ulps; gray: no sure hit")
    return {"extremes": figure}


def _heat(
    axes: Axes, results: Results, plane: str, name: str, labels: tuple[str, str]
) -> None:
    cells = {
        tuple(float(x) for x in case.removeprefix(f"{plane}.").split("_")): (
            results.values[f"{case}.{name}"]
        )
        for case in results.cases(f"{plane}.", f".{name}")
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
