"""A program that draws what the renderer draws, and the proof that it does."""

__all__ = ["Drawing", "check_drawing"]

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

MOST_FLIPS = 0.01
"""Share of the pixels that one of two images alone may hit: rays along the outline."""


class Drawing(NamedTuple):
    """One image by one program.

    Attributes:
        call: Draws it, and returns when it is there; this is timed.
        depth: Draws it and returns z in meters, `+inf` where nothing is hit.
        tolerance: Of the median difference in depth, in meters.
    """

    call: Callable[[], object]
    depth: Callable[[], Float[np.ndarray, "h w"]]
    tolerance: float = 1e-6


def check_drawing(
    name: str, drawing: Drawing, expected: Float[np.ndarray, "h w"]
) -> None:
    """Refuse to compare programs that draw different images.

    Raises:
        ValueError: The depth differs, or what is hit.
    """
    depth = drawing.depth()
    hit, wanted = np.isfinite(depth), np.isfinite(expected)
    both, flips = hit & wanted, np.count_nonzero(hit != wanted)
    difference = np.median(np.abs(depth[both] - expected[both])) if both.any() else 1.0
    if not difference < drawing.tolerance or flips > MOST_FLIPS * both.sum():
        raise ValueError(
            f"{name} must draw the image that JAX draws, got a median difference of "
            f"{difference} meters and {flips} pixels that only one of them hits, "
            f"beside {both.sum()} that both hit"
        )
