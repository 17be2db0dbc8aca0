"""Variance of noise that high differences along rows and columns of an image tell.

They vanish on planes, in inverse depth, and nearly so on what bends gently: what is
left is noise.
"""

__all__ = ["FEWEST", "MEDIAN_SQUARE", "variance_of_mean", "variances"]

import math

import numpy as np
from jaxtyping import Bool, Float

FEWEST = 200
"""Differences that tell a level of noise to a tenth."""

CLIP = 3.0
"""Standard deviations to which differences are clipped: a jump is no noise."""

CLIPPED = 0.9950
"""Mean square of normal numbers clipped to three standard deviations."""

MEDIAN_SQUARE = 0.4549
"""Of normal numbers."""

WEIGHTS = {3: (-1, 3, -3, 1), 4: (1, -4, 6, -4, 1)}
"""Of the third difference and the fourth, which bends leave less of."""

MOST_LINES = 40
"""Rows, and columns, along which differences are taken, evenly spread."""


def variances(
    inverse: Float[np.ndarray, "h w"],
    own: Bool[np.ndarray, "h w"],
    lag: int,
    order: int,
    most: float = math.inf,
) -> list[float]:
    """Variance of white noise that differences tell, along each axis.

    None of an axis along which there are too few.

    Args:
        inverse: Of an image, depth in 1/meters.
        own: Pixels that count.
        lag: Pixels between those whose difference is taken.
        order: Of the difference: 3 or 4.
        most: Over what their median tells, at most.
    """
    weights, found = WEIGHTS[order], []
    for axis in (0, 1):
        count = inverse.shape[axis] - order * lag
        if count <= 0:
            continue
        stride = -(-inverse.shape[1 - axis] // MOST_LINES)
        values, there = (np.moveaxis(x, axis, 0)[:, ::stride] for x in (inverse, own))
        difference, use = np.zeros_like(values[:count]), np.ones_like(there[:count])
        for k, weight in enumerate(weights):
            part = slice(k * lag, k * lag + count)
            difference += weight * values[part]
            use &= there[part]
        if np.count_nonzero(use) >= FEWEST / 2:
            square = float(np.square(weights).sum())
            found.append(_clipped(difference[use], most) / square)
    return found


def _clipped(values: Float[np.ndarray, " n"], most: float) -> float:
    """Variance of normal numbers among which are some that are too large."""
    squares = values**2
    usual = variance = float(np.median(squares)) / MEDIAN_SQUARE
    for _ in range(4):
        if not variance > 0:
            # Most differences of what is coarsely rounded are 0.
            return float(np.mean(squares))
        clipped = np.minimum(squares, CLIP**2 * variance)
        variance = float(np.mean(clipped)) / CLIPPED
    return min(variance, most * usual)


def variance_of_mean(near: float, apart: float) -> float:
    """Variance of a mean of n readings, times n, where neighbors alone share errors.

    Args:
        near: Variance that third differences of neighbors tell, 1 - 1.5 times their
            correlation of that of one reading.
        apart: The same of others, which is all of it.
    """
    correlation = min(max((1 - near / apart) / 1.5, 0.0), 0.5)
    return apart * (1 + 2 * correlation) ** 2
