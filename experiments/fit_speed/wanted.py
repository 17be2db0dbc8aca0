"""What is wanted of fits."""

__all__ = ["WANTED", "Wish"]

import dataclasses


@dataclasses.dataclass(frozen=True)
class Wish:
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
