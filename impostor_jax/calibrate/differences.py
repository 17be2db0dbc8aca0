"""How much readings of a plane differ, by their distance in pixels.

What neighbors share is not in their difference. Of white noise half the mean square of
it is the variance at all distances, of a smooth error the part that two readings do not
share: so the first distances tell noise from grain.
"""

__all__ = ["LAGS", "Differences", "differences_of"]

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.calibrate.flats import Flat

LAGS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 18, 22, 27, 32)
"""Distances in pixels, along rows and columns."""

DEPTH_STEP = 0.04
"""Of the logarithm of the depths that are counted as one."""

ANGLE_STEP = np.radians(2)
"""Of the incidences that are."""


class Differences(NamedTuple):
    """Mean squares by classes of depth and incidence.

    Attributes:
        depth: Mean of each class, in meters.
        cosine: Mean of that of the incidence.
        half_square: Half the mean square of the difference at each of `LAGS`, of errors
            over depth to the power; 0 where there is none.
        number: Of differences.
    """

    depth: Float[np.ndarray, " b"]
    cosine: Float[np.ndarray, " b"]
    half_square: Float[np.ndarray, "b k"]
    number: Float[np.ndarray, "b k"]


def differences_of(flats: Sequence[Flat]) -> Differences:
    """The differences within each plane of all images."""
    classes = [_classes(flat) for flat in flats]
    known, index = np.unique(np.concatenate(classes), return_inverse=True)
    count, parts, start = len(known), [], 0
    totals = np.zeros((3, count))
    squares, number = np.zeros((2, len(LAGS), count))
    for flat, own in zip(flats, classes, strict=True):
        part = np.zeros(flat.labels.shape, int)
        on = flat.labels > 0
        part[on] = index[start : start + len(own)]
        start += len(own)
        parts.append(part)
        for total, value in zip(totals, (1, flat.depth, flat.cosine), strict=True):
            weight = np.broadcast_to(value, on.shape)[on].astype(float)
            total += np.bincount(part[on], weight, count)
        for k, lag in enumerate(LAGS):
            for axis in (0, 1):
                there, square = _squares(flat, lag, axis)
                own = np.moveaxis(part, axis, 0)
                # Of both classes: on a slanted plane the first is always the farther.
                for one in (own[:-lag][there], own[lag:][there]):
                    squares[k] += np.bincount(one, square, count)
                    number[k] += np.bincount(one, minlength=count)
    pixels, depth, cosine = totals
    half = squares / np.maximum(number, 1) / 2
    return Differences(depth / pixels, cosine / pixels, half.T, number.T)


def _classes(flat: Flat) -> Int[np.ndarray, " n"]:
    """Number of the class of each pixel on a plane."""
    on = flat.labels > 0
    far = np.floor(np.log(flat.depth[on]) / DEPTH_STEP).astype(int)
    steep = np.floor(np.arccos(flat.cosine[on]) / ANGLE_STEP).astype(int)
    return far * 1000 + steep


def _squares(
    flat: Flat, lag: int, axis: int
) -> tuple[Bool[np.ndarray, "r c"], Float[np.ndarray, " n"]]:
    """Where a pixel and one beyond it are of one plane; squares of their difference."""
    labels, error = (np.moveaxis(x, axis, 0) for x in (flat.labels, flat.error))
    there = (labels[:-lag] > 0) & (labels[:-lag] == labels[lag:])
    return there, (error[lag:] - error[:-lag])[there] ** 2
