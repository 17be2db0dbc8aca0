"""Axial noise of a structured-light camera: the first Kinect.

Its disparity errs by the same fraction of a pixel at all distances, so depth errs with
the square of its distance; and a pattern that falls on a slanted surface is stretched,
so the error grows as the surface turns away.
"""

__all__ = ["MAX_ANGLE", "StructuredLight", "grazing_ratio"]

import math
from typing import Any

import jax.numpy as jnp
from jaxtyping import PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import angle_below_grazing, bounded_number, real_number
from impostor_jax.camera.base import AbstractCamera, check_depth_along_z
from impostor_jax.compiling import compiled
from impostor_jax.numerics import Numbers, Scalar, eps, safe_sqrt
from impostor_jax.sensor.across import errors_across, moved_across
from impostor_jax.sensor.base import (
    AbstractDepthNoise,
    Depths,
    Normals,
    cos_incidence,
    scattered,
)
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.matching import matching_sensor
from impostor_jax.sensor.surface import has_surface

MAX_ANGLE = math.radians(80)
"""Incidence from which the laws are held constant, in radians: they diverge at 90
degrees, and were measured to about 80."""

MIN_DEPTH = 0.1
"""Depth in meters below which the term of the incidence is held constant: 1 / sqrt(z)
and its slope grow without bound, and such a camera sees nothing nearer than 0.4 m."""


def grazing_ratio(cos_incidence: Numbers, max_angle: Scalar) -> tuple[Numbers, Numbers]:
    """Incidence over what it lacks to grazing, theta / (pi/2 - theta), and its square.

    Args:
        cos_incidence: Cosine between surface normal and viewing ray.
        max_angle: Angle in radians from which both are constant.

    Derivatives:
        That of the square is exact, at normal incidence too. There the ratio itself
        has an infinite slope in the cosine, which is replaced by 0.
    """
    dtype = cos_incidence.dtype
    lowest = jnp.cos(jnp.asarray(max_angle, dtype))
    cosine = jnp.where(cos_incidence > lowest, cos_incidence, lowest)
    # Of the half angle: 1 - c^2 under the root would lose half of the digits near 1.
    tangent2 = (1 - cosine) / (1 + cosine)
    theta = 2 * _arctan(safe_sqrt(tangent2))
    # The square is smooth in the cosine and the root is not: where they agree to
    # rounding, the first term of the series brings its slope.
    theta2 = jnp.where(tangent2 < eps(dtype), 4 * tangent2, theta * theta)
    lacking = math.pi / 2 - theta
    return theta / lacking, theta2 / (lacking * lacking)


def _arctan(x: Numbers) -> Numbers:
    """Arctangent of numbers from 0 to 1, to 3 roundings.

    XLA calls the C library's on a CPU, a number at a time: 16 ns each, and this 1 ns.
    """
    # A quarter of the angle, by which its tangent is 0.2 at most: what the series
    # leaves out is less than 1e-17.
    for _ in range(2):
        x = x / (1 + jnp.sqrt(1 + x * x))
    square, total = x * x, jnp.zeros_like(x)
    for power in range(23, 0, -2):
        total = (-1) ** (power // 2) / power + square * total
    return 4 * x * total


class StructuredLight(AbstractDepthNoise):
    """Normal noise along z that grows with depth and incidence.

    With depth z and the angle theta between surface normal and viewing ray,

        sigma = floor + growth (z - best_depth)^2
                + grazing / sqrt(z) theta^2 / (pi/2 - theta)^2.

    The last term is small where the paper leaves it out: it states the first two for
    angles of 10 to 60 degrees, where the last is 0.0004 m at most at 1 m, and all three
    beyond. Here all count everywhere, so sigma has no jump.

    Args:
        floor: Standard deviation at `best_depth` and normal incidence, in meters,
            positive.
        growth: Of the standard deviation with the square of the depth, in 1/meters.
        best_depth: Depth of the smallest standard deviation, in meters.
        grazing: Factor of the term of the incidence, in meters^1.5.
        max_angle: Incidence in radians from which sigma is held constant.
        across: Standard deviation of a reading's place across its ray, along each of
            two directions, in meters; None where nobody knows: a fit learns it.
        angle: The same of the direction of the ray, in radians.

    References:
        Nguyen, Izadi and Lovell, Modeling Kinect sensor noise for improved 3D
        reconstruction and tracking, 3DIMPVT 2012; the defaults are their fit.
    """

    floor: Scalar
    growth: Scalar
    best_depth: Scalar
    grazing: Scalar
    max_angle: Scalar
    across: Scalar | None
    angle: Scalar | None

    def __init__(
        self,
        floor: Any = 0.0012,
        growth: Any = 0.0019,
        best_depth: Any = 0.4,
        grazing: Any = 0.0001,
        max_angle: Any = MAX_ANGLE,
        across: Any = None,
        angle: Any = None,
    ):
        self.floor = real_number("floor", floor, positive=True, unit="meters")
        self.growth = bounded_number("growth", growth, "0 or positive, in 1/meters")
        self.best_depth = real_number("best_depth", best_depth, unit="meters")
        self.grazing = bounded_number(
            "grazing", grazing, "0 or positive, in meters^1.5"
        )
        self.max_angle = angle_below_grazing("max_angle", max_angle)
        self.across, self.angle = errors_across(across, angle)

    @staticmethod
    def sensor(native_scale: Any = 1.0) -> AbstractDepthNoise:
        """The whole camera: it leans at edges, and neither scale nor bands are known.

        Args:
            native_scale: Pixels of the image for one of the camera's own 640 x 480, of
                an image that was warped or enlarged.
        """
        return matching_sensor(StructuredLight(), native_scale)

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        dtype = depth.dtype
        floor, growth, best_depth, grazing = (
            jnp.asarray(field, dtype)
            for field in (self.floor, self.growth, self.best_depth, self.grazing)
        )
        seen = has_surface(depth)
        z = jnp.where(seen, depth, 1)
        far = z - best_depth
        _, square = grazing_ratio(cos_incidence, self.max_angle)
        turned = grazing * square / jnp.sqrt(jnp.where(z > MIN_DEPTH, z, MIN_DEPTH))
        return jnp.where(seen, floor + growth * far * far + turned, jnp.inf)

    @property
    @override
    def bias(self) -> Bias:
        return Bias.of_rays(self.across, self.angle)

    @override
    @compiled
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        check_depth_along_z(camera)
        key, depth = moved_across(key, depth, normal, camera, self.bias)
        return scattered(key, depth, self.sigma(depth, cos_incidence(normal, camera)))
