"""The tables and the figures of the README, from results.json."""

__all__ = ["FIRST", "FIRST_PARTS", "draw", "table"]

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from experiments.fit_speed.wanted import WANTED, is_met
from experiments.recording import read_spreads, three_digits
from impostor_jax.io.atomic import write_atomically

CASES = {
    "single.balanced.mask": "balanced, mask",
    "single.fast.mask": "fast, mask",
    "single.exact.mask": "exact, mask",
    "single.initial.mask": "balanced, mask, start given",
    "single.known_radius.mask": "balanced, mask, start and radius given",
    "single.balanced.no_mask": "balanced, no mask",
    "single.fast.no_mask": "fast, no mask",
    "single.exact.no_mask": "exact, no mask",
    "batch.balanced.mask": "batch: balanced, mask",
    "batch.fast.mask": "batch: fast, mask",
    "batch.balanced.no_mask": "batch: balanced, no mask",
    "batch.fast.no_mask": "batch: fast, no mask",
    "batch.vmap.mask": "batch in vmap: balanced, mask, start given",
    "single.fft2": "NumPy's fft2 of the image",
    "peer.pcl": "PCL",
    "peer.scipy": "SciPy, started at the truth",
    "peer.cylfit": "cylfit",
    "peer.scikit-spatial": "scikit-spatial",
    "peer.pyransac3d": "pyransac3d",
}
"""Warm cases; of a batch, per image."""

FIRST = {
    "balanced.empty": "balanced, empty cache",
    "balanced.filled": "balanced, filled cache",
    "fast.empty": "fast, empty cache",
    "fast.filled": "fast, filled cache",
    "batch.filled": "batch of balanced, filled cache",
}
"""First fits in new processes."""

FIRST_PARTS = {
    "import_jax": "ms",
    "import": "ms",
    "arguments": "ms",
    "call": "ms",
    "without_jax": "ms",
    "trace": "ms",
    "lower": "ms",
    "compile": "ms",
    "memory": "MB",
    "device_memory": "MB",
}
"""What is known of each, and its unit."""

CURVES = {
    "pixels": ("pixels of the mask", "start guessed"),
    "pixels_from_start": ("pixels of the mask", "start given"),
    "images": ("images of a batch", "start guessed"),
    "parameters": ("free coordinates", "start given"),
}
"""What a fit grows with, and where it starts."""

Values = dict[str, tuple[float | None, float | None]]

NOTHING = (None, None)


def table(folder: Path) -> str:
    """Results of a folder in Markdown; what was not measured is left blank."""
    values = read_spreads(folder)
    lines = ["| wanted | at most | measured | met |", "|---|--:|--:|---|"]
    for wish in WANTED:
        value = values.get(wish.metric, NOTHING)[0]
        unit = "" if wish.unit == "1" else f" {wish.unit}"
        met = {True: "yes", False: "no", None: ""}[is_met(wish, value)]
        cells = (f"{three_digits(wish.most)}{unit}", three_digits(value), met)
        lines.append(f"| {wish.label} | {' | '.join(cells)} |")
    lines += [
        "",
        "| case | median, ms | spread, ms | minimum, ms | page faults |",
        "|---|--:|--:|--:|--:|",
    ]
    lines += [_row(label, _case(values, case)) for case, label in CASES.items()]
    lines += ["", "| program | error of the radius, mm |", "|---|--:|"]
    for name in (
        *(case for case in CASES if case.startswith("peer.")),
        "peer.balanced",
    ):
        label = CASES.get(name, "balanced, mask")
        lines.append(_row(label, values.get(f"{name}.radius_error", NOTHING)[:1]))
    head = [f"{part.replace('_', ' ')}, {unit}" for part, unit in FIRST_PARTS.items()]
    lines += ["", f"| first fit | {' | '.join(head)} |", "|---|" + "--:|" * len(head)]
    for case, label in FIRST.items():
        cells = [
            _with_spread(values.get(f"first.{case}.{part}", NOTHING))
            for part in FIRST_PARTS
        ]
        lines.append(f"| {label} | {' | '.join(cells)} |")
    for curve, (label, start) in CURVES.items():
        slope = _with_spread(values[f"scaling.{curve}.exponent"])
        name = f"{label}, {start}"
        lines += [
            "",
            f"| {name} | median, ms | spread, ms | minimum, ms | page faults |",
            "|--:|--:|--:|--:|--:|",
        ]
        lines += [
            _row(str(size), _case(values, f"scaling.{curve}.{size}"))
            for size in sizes_of(values, curve)
        ]
        lines += ["", f"Exponent: {slope}."]
    return "\n".join(lines)


def sizes_of(values: Values, curve: str) -> list[int]:
    """Sizes at which a curve was measured."""
    names = [name.split(".") for name in values if name.startswith(f"scaling.{curve}.")]
    return sorted(int(name[2]) for name in names if name[3:] == ["median"])


def draw(folder: Path) -> None:
    """Draw a folder's warm and first fits as bars, and what they grow with."""
    values = read_spreads(folder)
    write_atomically(folder / "figures" / "fit_speed.png", _bars(values).savefig)
    write_atomically(folder / "figures" / "scaling.png", _curves(values).savefig)


def _bars(values: Values) -> Figure:
    bars = {f"{case}.median": label for case, label in CASES.items()} | {
        f"first.{case}.without_jax": f"first: {label}" for case, label in FIRST.items()
    }
    shown = {
        label: values[name]
        for name, label in bars.items()
        if values.get(name, NOTHING)[0] is not None
    }
    medians = np.array([median for median, _ in shown.values()], float)
    spreads = np.array([spread for _, spread in shown.values()], float)
    figure = Figure(figsize=(8, 6.5), layout="constrained")
    axes = figure.subplots()
    beside = ("peer.", "single.fft2")
    others = {label for case, label in CASES.items() if case.startswith(beside)}
    axes.barh(
        list(shown),
        medians,
        xerr=spreads / 2,
        color=["C7" if label in others else "C0" for label in shown],
        error_kw={"capsize": 3},
    )
    for row, (median, spread) in enumerate(zip(medians, spreads, strict=True)):
        where = 1.15 * (median + spread / 2)
        axes.text(where, row, f"{three_digits(median)} ms", va="center", fontsize=8)
    marks = [
        (wish.most, list(shown).index(bars[wish.metric]))
        for wish in WANTED
        if bars.get(wish.metric) in shown
    ]
    axes.plot(*np.transpose(marks), "C3|", markersize=16, mew=3, label="wanted")
    axes.set_xscale("log")
    axes.set_xlim(medians.min() / 8, medians.max() * 8)
    axes.invert_yaxis()
    axes.set_xlabel("median time in ms; whiskers as wide as the interquartile range")
    axes.legend()
    return figure


def _curves(values: Values) -> Figure:
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    labels = list(dict.fromkeys(label for label, _ in CURVES.values()))
    panels = dict(zip(labels, figure.subplots(1, len(labels)), strict=True))
    for curve, (label, start) in CURVES.items():
        sizes = sizes_of(values, curve)
        pairs = [values[f"scaling.{curve}.{size}.median"] for size in sizes]
        medians, spreads = np.array(pairs, float).T
        slope = _with_spread(values[f"scaling.{curve}.exponent"])
        name = f"{start}: exponent {slope}" if slope else start
        axes = panels[label]
        axes.errorbar(sizes, medians, spreads / 2, fmt="o-", capsize=3, label=name)
        axes.set(xlabel=label, ylabel="time of a call, ms")
        if curve == "parameters":
            axes.set_ylim(bottom=0)
        else:
            axes.set(xscale="log", yscale="log")
            axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter(NullFormatter())
        # Above the curves, which go from corner to corner.
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1), fontsize=8)
        axes.grid(alpha=0.3)
    return figure


def _case(values: Values, case: str) -> tuple[float | None, ...]:
    """Median, spread, minimum and page faults."""
    least, faults = (
        values.get(f"{case}.{name}", NOTHING)[0] for name in ("minimum", "page_faults")
    )
    return (*values.get(f"{case}.median", NOTHING), least, faults)


def _row(label: str, numbers: tuple[float | None, ...]) -> str:
    return f"| {' | '.join([label, *map(three_digits, numbers)])} |"


def _with_spread(pair: tuple[float | None, float | None]) -> str:
    value, spread = pair
    return (
        three_digits(value)
        if spread is None
        else f"{three_digits(value)} ({three_digits(spread)})"
    )
