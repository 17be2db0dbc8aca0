"""The tables of the README from results.json, and the figure."""

__all__ = ["draw", "tables"]

from pathlib import Path

from matplotlib.figure import Figure

from experiments.recording import read_spreads, read_values
from impostor_jax.evaluate import LEVELS, by_visibility
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.io.atomic import write_atomically

RUNS = {"fit": "visible masks", "eroded": "masks without their edge pixels"}

STAGES = ("drawing", "rendering", "noise", "coding", "writing")

COLUMNS = {
    "radius_mm": "radius mm",
    "axis_deg": "axis deg",
    "center_mm": "center mm",
    "height_mm": "height mm",
    "spread": "error over std",
}

BINS = list(by_visibility([]))


def tables(folder: Path) -> str:
    """Results of a folder in Markdown."""
    values = read_values(folder)
    lines = ["| | whole command | after start | coding alone |", "|---|--:|--:|--:|"]
    spreads = read_spreads(folder)

    def cell(name: str, digits: str) -> str:
        value, spread = spreads[name]
        return f"{value:{digits}} ({spread:{digits}})"

    rates = ("rate", "rate_after_start", "rate_of_coding_alone")
    cells = [cell(f"speed.{name}", ".1f") for name in rates]
    lines.append(f"| images/s | {' | '.join(cells)} |")
    over = [cell(f"speed.{name}_over_coding", ".2f") for name in ("rate", "steady")]
    lines.append(f"| over coding alone | {' | '.join(over)} | 1 |")
    lines += ["", f"| | {' | '.join(STAGES)} |", "|---|" + "--:|" * len(STAGES)]
    cells = [cell(f"time.{stage}", ".1f") for stage in STAGES]
    lines.append(f"| ms an image | {' | '.join(cells)} |")
    cells = [cell(f"share.{stage}", ".0%") for stage in STAGES]
    lines.append(f"| share | {' | '.join(cells)} |")
    memory = [
        f"{value:.0f} MiB for {name.removeprefix('memory.').removesuffix('_images')}"
        for name, value in values.items()
        if name.startswith("memory.")
    ]
    lines += ["", f"Largest process: {', '.join(memory)} images."]
    lines.append(f"Killed and resumed with equal bytes: {values['killed.equal']:.0%}.")
    for name, title in RUNS.items():
        lines += ["", f"With {title}, {values[f'{name}.time']:.0f} ms a fit:", ""]
        head = ["visible", "number", "failed", "wrong", *COLUMNS.values(), *LEVELS]
        lines += [f"| {' | '.join(head)} |", "|---|" + "--:|" * (len(head) - 1)]
        for row in [*BINS, "all"]:
            label = f"{name}.{row}"
            counts = ("number", "failures", "wrong")
            cells = [_cell(values[f"{label}.{count}"], ".0f") for count in counts]
            cells += [_cell(values[f"{label}.{column}"], ".3f") for column in COLUMNS]
            cells += [_cell(values[f"{label}.coverage.{n}"], ".1%") for n in LEVELS]
            if values[f"{label}.number"]:
                lines.append(f"| {row} | {' | '.join(cells)} |")
        head = [name.replace("_", " ") for name in CYLINDER.coordinates]
        lines += ["", f"| interval | {' | '.join(head)} |"]
        lines.append("|---|" + "--:|" * len(CYLINDER.coordinates))
        for level in LEVELS:
            labels = [
                f"{name}.{coordinate}.{level}" for coordinate in CYLINDER.coordinates
            ]
            cells = [_cell(values[label], ".1%") for label in labels]
            lines.append(f"| {level} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def draw(folder: Path) -> None:
    """Write the figure: errors and coverage against visibility."""
    values, spreads = read_values(folder), read_spreads(folder)
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    place = range(len(BINS))
    for (name, title), style in zip(RUNS.items(), ("-", "--"), strict=True):
        for column, color in (("radius_mm", "C0"), ("center_mm", "C1")):
            height = [values[f"{name}.{label}.{column}"] for label in BINS]
            what = column.removesuffix("_mm")
            left.plot(place, height, f"{color}o{style}", label=f"{what}, {title}")
        for (level, width), color in zip(LEVELS.items(), ("C2", "C3"), strict=True):
            pairs = [spreads[f"{name}.{label}.coverage.{level}"] for label in BINS]
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
    write_atomically(
        folder / "figures" / "synthetic_benchmark.png",
        lambda partial: figure.savefig(partial, dpi=110),
    )
