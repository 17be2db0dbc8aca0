"""The tables of the README, from results.json."""

__all__ = ["FIRST", "FIRST_PARTS", "tables"]

from typing import NamedTuple

from experiments.markdown import table, three_digits
from experiments.recording import Results
from experiments.timing import COLUMNS, case_row


class Wish(NamedTuple):
    """A number that must not be exceeded.

    Attributes:
        label: What it is of.
        metric: Its name in `results.json`.
        most: The largest value that will do.
        unit: Of `most` and of the metric.
    """

    label: str
    metric: str
    most: float
    unit: str = "ms"


WANTED = (
    Wish("`balanced`, mask", "single.balanced.mask.median", 5),
    Wish("`balanced`, mask, start given", "single.initial.mask.median", 3),
    Wish("`fast`, mask", "single.fast.mask.median", 2),
    Wish("291 pixels, start given", "scaling.pixels_from_start.291.median", 1),
    Wish("batch of `balanced`, mask, an image", "batch.balanced.mask.median", 4),
    Wish("`jit(vmap)`, start given, an image", "batch.vmap.mask.median", 4),
    Wish("`balanced`, no mask", "single.balanced.no_mask.median", 20),
    Wish("`fast` over `exact`, mask", "single.fast_over_exact.mask", 0.25, "1"),
    Wish("`balanced` over `fft2`", "single.balanced_over_fft2.mask", 0.5, "1"),
    Wish("first fit, empty cache", "first.balanced.empty.without_jax", 4000),
    Wish("first fit, filled cache", "first.balanced.filled.without_jax", 1200),
)
"""Medians. A mask has at most 10000 pixels; a first fit is timed from after the import
of JAX."""

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


def tables(results: Results) -> str:
    """What is wanted, warm and first fits, and growth; blank where not measured."""
    values, rows = results.values, []
    for wish in WANTED:
        value = values.get(wish.metric)
        unit = "" if wish.unit == "1" else f" {wish.unit}"
        met = "" if value is None else "yes" if value <= wish.most else "no"
        most = f"{three_digits(wish.most)}{unit}"
        rows.append([wish.label, most, three_digits(value), met])
    blocks = [
        table(["wanted", "at most", "measured", "met"], rows),
        table(
            ["case", *COLUMNS],
            (case_row(results, case, label) for case, label in CASES.items()),
        ),
    ]
    peers = {case: label for case, label in CASES.items() if case.startswith("peer.")}
    rows = [
        [label, three_digits(values.get(f"{case}.radius_error"))]
        for case, label in {**peers, "peer.balanced": "balanced, mask"}.items()
    ]
    blocks.append(table(["program", "error of the radius, mm"], rows))
    head = [f"{part.replace('_', ' ')}, {unit}" for part, unit in FIRST_PARTS.items()]
    rows = [
        [
            label,
            *(_with_spread(results, f"first.{case}.{part}") for part in FIRST_PARTS),
        ]
        for case, label in FIRST.items()
    ]
    blocks.append(table(["first fit", *head], rows))
    for curve, (label, start) in CURVES.items():
        rows = [
            case_row(results, f"scaling.{curve}.{size}", str(size))
            for size in _sizes(results, curve)
        ]
        blocks += [
            table([f"{label}, {start}", *COLUMNS], rows),
            f"Exponent: {_with_spread(results, f'scaling.{curve}.exponent')}.",
        ]
    return "\n\n".join(blocks)


def _sizes(results: Results, curve: str) -> list[int]:
    """Sizes at which a curve was measured."""
    start = f"scaling.{curve}."
    cases = results.cases(start, ".median")
    return sorted(int(case.removeprefix(start)) for case in cases)


def _with_spread(results: Results, name: str) -> str:
    value, spread = map(three_digits, results.pair(name))
    return f"{value} ({spread})" if spread else value
