"""The tables of the README from results.json, and the figure."""

__all__ = ["draw", "tables"]

from matplotlib.figure import Figure

from experiments.columns import Column, case_table, without_group
from experiments.markdown import number, table
from experiments.recording import Results
from impostor_jax.evaluate import LEVELS, by_visibility
from impostor_jax.fit.fittable import CYLINDER

RUNS = {"fit": "visible masks", "eroded": "masks without their edge pixels"}

STAGES = ("drawing", "rendering", "noise", "coding", "writing")

ERRORS = {
    "radius_mm": "radius mm",
    "axis_deg": "axis deg",
    "center_mm": "center mm",
    "height_mm": "height mm",
    "spread": "error over std",
}

FITTED = (
    Column("number", "number", ".0f"),
    Column("failed", "failures", ".0f"),
    Column("wrong", "wrong", ".0f"),
    *(Column(head, key, ".3f") for key, head in ERRORS.items()),
    *(Column(level, f"coverage.{level}", ".1%") for level in LEVELS),
)

BINS = list(by_visibility([]))

COORDINATES = CYLINDER.coordinates


def tables(results: Results) -> str:
    """Rates, what the time goes into, memory, and fits by visibility."""
    values = results.values

    def cells(names: list[str], form: str) -> list[str]:
        pairs = map(results.pair, names)
        return [number(value, form, spread) for value, spread in pairs]

    rates = ["speed.rate", "speed.rate_after_start", "speed.rate_of_coding_alone"]
    over = ["speed.rate_over_coding", "speed.steady_over_coding"]
    memory = (
        f"{values[f'{case}_images']:.0f} MiB for {case.removeprefix('memory.')}"
        for case in results.cases("memory.", "_images")
    )
    blocks = [
        table(
            ["", "whole command", "after start", "coding alone"],
            [
                ["images/s", *cells(rates, ".1f")],
                ["over coding alone", *cells(over, ".2f"), "1"],
            ],
        ),
        table(
            ["", *STAGES],
            [
                ["ms an image", *cells([f"time.{s}" for s in STAGES], ".1f")],
                ["share", *cells([f"share.{s}" for s in STAGES], ".0%")],
            ],
        ),
        f"Largest process: {', '.join(memory)} images.\n"
        f"Killed and resumed with equal bytes: {values['killed.equal']:.0%}.",
    ]
    for name, title in RUNS.items():
        cases = (f"{name}.{row}" for row in [*BINS, "all"])
        seen = [case for case in cases if values[f"{case}.number"]]
        blocks += [
            f"With {title}, {values[f'{name}.time']:.0f} ms a fit:",
            case_table(results, "visible", seen, FITTED, without_group),
        ]
        rows = [
            [
                level,
                *(number(values[f"{name}.{c}.{level}"], ".1%") for c in COORDINATES),
            ]
            for level in LEVELS
        ]
        head = ["interval", *(name.replace("_", " ") for name in COORDINATES)]
        blocks.append(table(head, rows))
    return "\n\n".join(blocks)


def draw(results: Results) -> dict[str, Figure]:
    """Errors and coverage against visibility."""
    values = results.values
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    place = range(len(BINS))
    for (name, title), style in zip(RUNS.items(), ("-", "--"), strict=True):
        for column, color in (("radius_mm", "C0"), ("center_mm", "C1")):
            height = [values[f"{name}.{label}.{column}"] for label in BINS]
            what = column.removesuffix("_mm")
            left.plot(place, height, f"{color}o{style}", label=f"{what}, {title}")
        for (level, width), color in zip(LEVELS.items(), ("C2", "C3"), strict=True):
            labels = [f"{name}.{label}.coverage.{level}" for label in BINS]
            pairs = map(results.pair, labels)
            known = [(k, *pair) for k, pair in enumerate(pairs) if None not in pair]
            if known:
                x, y, error = zip(*known, strict=True)
                label = f"{level} ({width:.3g} std), {title}"
                right.errorbar(x, y, error, fmt=f"{color}o{style}", label=label)
            right.axhline(float(level[:-2]) / 100, color=color, linewidth=0.5)
    left.set(yscale="log", ylabel="median absolute error in mm")
    right.set(ylim=(0, 1), ylabel="share of errors within the interval")
    for axes in (left, right):
        axes.set_xticks(list(place), BINS, rotation=30)
        axes.set_xlabel("visible part of the silhouette")
        axes.legend(fontsize=7)
    return {"synthetic_benchmark": figure}
