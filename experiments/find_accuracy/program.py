"""What a program that finds cylinders is given, and what it returns."""

__all__ = ["Detection", "MissingProgramError", "Program", "points_of"]

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

import impostor_jax as ij


class Detection(NamedTuple):
    """One cylinder that a program has found, in the camera's frame and in meters.

    Attributes:
        center: A point of the axis; the cylinder's middle if it is known.
        axis: Unit vector, of either sign.
        radius: Of the wall.
        height: From end to end; NaN if the program does not tell.
        confidence: In [0, 1], the larger the surer.
        radius_std: What the program says its radius is off by, one standard deviation;
            NaN if it does not tell.
    """

    center: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float
    height: float
    confidence: float
    radius_std: float = math.nan


Program = Callable[
    [Float[np.ndarray, "h w"], ij.PinholeCamera, ij.AbstractDepthNoise],
    list[Detection],
]
"""Of readings (float32, meters, 0 for none), their camera and the sensor's noise."""


class MissingProgramError(Exception):
    """A program that is not installed; it is left out, and the sentence printed."""


def points_of(
    depth: Float[np.ndarray, "h w"], camera: ij.PinholeCamera
) -> Float[np.ndarray, "h w 3"]:
    """Readings as points of the camera's frame, the lens taken off; 0 for none."""
    row, col = camera.frame.pixels()
    ray = camera.rays(row, col, np.float32).direction
    direction = np.stack([np.asarray(ray.x), np.asarray(ray.y), np.asarray(ray.z)], -1)
    return depth[..., None] * direction
