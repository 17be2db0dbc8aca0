"""Slopes of a surface that only some pixels see: at random, or every n-th row.

A window of fixed size holds no whole block of readings there. Its plane is fitted to
those that it holds, wherever they lie in it, and it is as wide as their spacing asks.
"""

__all__ = ["MAX_SLOPE_ERROR", "spacing_of", "sparse_slopes"]

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.opencv import cv2

MAX_SLOPE_ERROR = 0.05
"""Standard deviation of a normal, in radians, up to which windows are not widened."""

WIDEST_GAP = 17
"""Pixels between readings, less one, up to which they are of one surface."""

LEAST_DENSITY = 0.95
"""Share of the pixels with a reading from which a surface is seen densely."""

SPACINGS = 4.0
"""Half a window, in mean distances from a pixel to a reading: of every eighth row it
holds three, of scattered readings about 16."""


def spacing_of(seen: Bool[np.ndarray, "h w"]) -> float:
    """Mean distance from a pixel to the nearest reading, in pixels; 0 where dense.

    The pixels are those of the region that the readings fill if gaps are closed; what
    is thin, but dense, has none.
    """
    holes = (~seen).astype(np.uint8)
    gap = np.ones((WIDEST_GAP, WIDEST_GAP), np.uint8)
    border = WIDEST_GAP
    padded = np.pad(seen.astype(np.uint8), border)
    filled = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, gap)
    filled = filled[border:-border, border:-border] > 0
    if np.count_nonzero(seen) >= LEAST_DENSITY * np.count_nonzero(filled):
        return 0.0
    distance = cv2.distanceTransform(holes, cv2.DIST_L2, 5)
    return float(distance[filled].mean())


def sparse_slopes(
    inverse: Float[np.ndarray, "h w"],
    matrix: Float[np.ndarray, "3 3"],
    spacing: float,
    error: float,
) -> tuple[Float[np.ndarray, "3 h w"], Bool[np.ndarray, "h w"]]:
    """Slopes, as of `Samples`, of the planes through the readings of each window.

    The inverse depth of a plane is linear in the pixels: least squares with the sums
    over those pixels of a window that have a reading.

    Args:
        inverse: Inverse depth, NaN where there is no reading.
        matrix: Of the camera.
        spacing: As of `spacing_of`, positive.
        error: Standard deviation of a reading over the width of a pixel at its depth.

    Returns:
        The slopes, and those pixels with a reading whose plane is of readings around
        it: a plane through one side of a round wall is tilted.
    """
    seen = np.isfinite(inverse)
    half = _half_window(seen, spacing, error)
    side = (2 * half + 1,) * 2
    row, col = np.mgrid[: inverse.shape[0], : inverse.shape[1]].astype(float)
    # Counted from the middle, so that the squares keep their digits.
    x, y = col - col.mean(), row - row.mean()
    weight, w = seen.astype(float), np.where(seen, inverse, 0)

    def total(values: np.ndarray) -> np.ndarray:
        return cv2.boxFilter(
            values, cv2.CV_64F, side, normalize=False, borderType=cv2.BORDER_CONSTANT
        )

    count = np.maximum(total(weight), 1)

    def mean(values: np.ndarray) -> np.ndarray:
        return total(values) / count

    mx, my, mw = mean(weight * x), mean(weight * y), mean(w)
    xx, yy = mean(weight * x * x) - mx * mx, mean(weight * y * y) - my * my
    xy = mean(weight * x * y) - mx * my
    xw, yw = mean(w * x) - mx * mw, mean(w * y) - my * mw
    determinant = xx * yy - xy * xy
    # Readings of one row, or of one line, leave a plane's tilt open.
    is_spread = determinant > 0.01 * half**4 / 9
    determinant = np.where(is_spread, determinant, 1)
    by_x = (xw * yy - yw * xy) / determinant
    by_y = (yw * xx - xw * xy) / determinant
    cx, cy = matrix[:2, 2]
    at_axis = mw - by_x * (mx + col.mean() - cx) - by_y * (my + row.mean() - cy)
    slopes = np.stack([by_x, by_y, at_axis])
    usable = seen & is_spread
    if not usable.any():
        return slopes, usable
    aside = np.maximum(np.abs(mx - x), np.abs(my - y)) / half
    return slopes, usable & (aside <= max(0.25, float(np.median(aside[usable]))))


def _half_window(seen: Bool[np.ndarray, "h w"], spacing: float, error: float) -> int:
    """Half the side of the windows, in pixels.

    The slope of a plane through n readings within h pixels on each side errs by
    error sqrt(3 / n) / h, and n is their density times 4 h^2.
    """
    rows, cols = np.any(seen, axis=1), np.any(seen, axis=0)
    size = min(np.count_nonzero(rows), np.count_nonzero(cols))
    # Of scattered readings the mean distance is half their spacing.
    density = min(1.0, 1 / (2 * spacing) ** 2)
    for_noise = np.sqrt(error * np.sqrt(3 / (4 * density)) / MAX_SLOPE_ERROR)
    return int(np.ceil(max(3.0, SPACINGS * spacing, min(for_noise, size / 6))))
