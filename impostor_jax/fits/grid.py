"""The grid that the coordinates of points were rounded to, from the points themselves.

LAS files hold multiples of a scale, text files some decimals, and float32 has a spacing
of its own. Rounding errs in all directions alike, so also across the rays.
"""

__all__ = ["rounding_of"]

import numpy as np
from jaxtyping import Float

OFF_GRID = 0.02
"""Part of a step that a coordinate may lie off a grid: stored in single precision some
do, and of coordinates without a grid one in 25 lies as near."""

FEWEST_STEPS = 20
"""Different coordinates along an axis that show a grid."""


def rounding_of(points: Float[np.ndarray, "n 3"], stored: np.dtype) -> float:
    """Standard deviation of each coordinate by rounding, in meters.

    The root of the mean square over the three axes.

    Args:
        points: In meters, in double precision.
        stored: Floating-point type that they came in.
    """
    spacing = float(np.finfo(stored).eps) * np.abs(points).max(axis=0)
    steps = [max(_step(x), ulp) for x, ulp in zip(points.T, spacing, strict=True)]
    return float(np.sqrt(np.mean(np.square(steps)) / 12))


def _step(values: Float[np.ndarray, " n"]) -> float:
    """Step of the grid that numbers lie on; 0 where there is none."""
    apart = np.diff(np.unique(values))
    # Numbers of one place on a grid may differ by their own rounding.
    apart = apart[apart > 1e-9 * np.abs(values).max()]
    if len(apart) < FEWEST_STEPS:
        return 0.0
    step = apart.min()
    count = np.ones_like(apart)
    for _ in range(3):
        count = np.round(apart / step)
        step = np.sum(apart * count) / np.sum(count * count)
    off = np.abs(apart / step - np.round(apart / step))
    # Of a long gap the error of the step itself is many times as large.
    is_near = off < OFF_GRID * np.maximum(1, count / 100)
    return float(step) if np.mean(is_near) > 0.99 else 0.0
