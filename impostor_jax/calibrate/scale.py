"""The scale of depths, from a cylinder whose radius is known.

A fit to readings that are corrected by the right error has the right radius. How the
radius follows the error depends on what of a wall is seen, and is found by fits: an
offset of the disparity bends a wall as it moves it, and changes the radius by less than
the distance.
"""

__all__ = ["Scale", "scale_of"]

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fits.single import fit_cylinder
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.scale_error import ScaleError

CHANGE = 0.02
"""Of the error, by which a fit is repeated to see what it changes."""

NUM_STEPS = 3
"""Fits, each with the error that the last ones say."""

SMALLEST, LARGEST = 1e-3, 0.1
"""Of the change of the error from one to the next: rounding does not tell of less."""

LEAST_SLOPE = 0.05
"""Of the radius with the error, over the radius."""

USUAL = 0.01
"""Standard deviation of the error from image to image, before several are seen."""

USUAL_WEIGHT = 2.0
"""Images that this weighs as much as."""

NUM_ROUNDS = 20
"""Of the mean, and of the deviation by which it is weighed."""


class Scale(NamedTuple):
    """The error that all depths of an image share, as `ScaleError` has it.

    Attributes:
        mean: Over images.
        deviation: Of the next image from the mean, with what is not known of that.
        number: Of images whose fit succeeded.
    """

    mean: float
    deviation: float
    number: int


def scale_of(
    depths: Float[np.ndarray, "n h w"],
    objects: Bool[np.ndarray, "n h w"],
    radius: float,
    camera: PinholeCamera,
    sensor: AbstractDepthNoise,
    law: str,
) -> Scale | None:
    """The error of the scale; None if no fit succeeded.

    Args:
        depths: Images in meters; 0 where there is no reading.
        objects: Pixels of the cylinder in each; none where it is not seen.
        radius: Of the cylinder, in meters.
        camera: That took them.
        sensor: Without an error of the scale.
        law: Of `ScaleError`.
    """
    found = [
        one
        for depth, mask in zip(depths, objects, strict=True)
        if mask.any()
        and (one := _error_of(depth, mask, radius, camera, sensor, law)) is not None
    ]
    if not found:
        return None
    errors, deviations = np.array(found).T
    variance, mean = USUAL**2, 0.0
    for _ in range(NUM_ROUNDS):
        # Images differ by this, and by what each fit does not know.
        weight = 1 / (variance + deviations**2)
        mean = float(weight @ errors / weight.sum())
        excess = float(np.sum((errors - mean) ** 2 - deviations**2))
        total = USUAL_WEIGHT * USUAL**2 + max(excess, 0.0)
        variance = total / (USUAL_WEIGHT + len(errors) - 1)
    of_mean = 1 / float(np.sum(1 / (variance + deviations**2)))
    return Scale(mean, math.sqrt(variance + of_mean), len(errors))


def _error_of(
    depth: Float[np.ndarray, "h w"],
    mask: Bool[np.ndarray, "h w"],
    radius: float,
    camera: PinholeCamera,
    sensor: AbstractDepthNoise,
    law: str,
) -> tuple[float, float] | None:
    """The error of one image, and its standard deviation; None if a fit failed."""

    def fitted(error: float) -> tuple[float, float] | None:
        fit = fit_cylinder(depth, camera, mask, ScaleError(sensor, 0.0, error, law))
        if not bool(fit.success):
            return None
        return float(fit.cylinder.radius), float(fit.std.radius)

    # Depths that read short make a cylinder small, and so does a larger disparity.
    error, step, slope = 0.0, CHANGE if law == "scale" else -CHANGE, math.nan
    before = fitted(0.0)
    for _ in range(NUM_STEPS):
        after = fitted(error + step)
        if before is None or after is None:
            return None
        slope = (after[0] - before[0]) / step
        # What does not change the radius is not told by it.
        if not abs(slope) > LEAST_SLOPE * radius:
            return None
        error, before = error + step, after
        step = float(np.clip((radius - before[0]) / slope, -LARGEST, LARGEST))
        if abs(step) < SMALLEST:
            break
    assert before is not None
    return error + step, before[1] / abs(slope)
