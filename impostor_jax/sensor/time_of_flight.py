"""Noise of a time-of-flight camera, which measures the phase of its own light.

Its error is that of counting photons: it grows as light gets less, with the square of
the distance and with the slant of a surface.
"""

__all__ = ["TimeOfFlight"]

import math
from typing import Any

import jax.numpy as jnp
from jaxtyping import PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import angle_below_grazing, bounded_number, real_number
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.compiling import compiled
from impostor_jax.numerics import Numbers, Scalar
from impostor_jax.sensor.across import errors_across, moved_across
from impostor_jax.sensor.base import (
    AbstractDepthNoise,
    Depths,
    Normals,
    cos_incidence,
    scattered,
)
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.correlated import CorrelatedNoise
from impostor_jax.sensor.flying_pixels import FlyingPixels
from impostor_jax.sensor.surface import has_surface

MAX_ANGLE = math.radians(80)
"""Incidence in radians from which the noise is held constant."""


class TimeOfFlight(AbstractDepthNoise):
    """Normal noise along z that grows as the light that comes back gets less.

    With depth z and the angle theta between surface normal and viewing ray,

        sigma = floor + growth z^2 / cos(theta).

    That is what readings err by on their own; `sensor` is the whole camera.

    Args:
        floor: Standard deviation near the camera, in meters, positive.
        growth: Of the standard deviation with the square of the depth, in 1/meters.
        max_angle: Incidence in radians from which sigma is held constant.
        across: Standard deviation of a reading's place across its ray, along each of
            two directions, in meters; None where nobody knows: a fit learns it.
        angle: The same of the direction of the ray, in radians.

    References:
        Lange and Seitz, Solid-state time-of-flight range camera, IEEE J. Quantum
        Electronics 37 (2001): the error of the phase goes with the inverse of the
        amplitude, which goes with cos(theta) / z^2. The defaults make 17 mm at 4 m, the
        most that the data sheet of the Azure Kinect allows.
    """

    floor: Scalar
    growth: Scalar
    max_angle: Scalar
    across: Scalar | None
    angle: Scalar | None

    def __init__(
        self,
        floor: Any = 0.001,
        growth: Any = 0.001,
        max_angle: Any = MAX_ANGLE,
        across: Any = None,
        angle: Any = None,
    ):
        self.floor = real_number("floor", floor, positive=True, unit="meters")
        self.growth = bounded_number("growth", growth, "0 or positive, in 1/meters")
        self.max_angle = angle_below_grazing("max_angle", max_angle)
        self.across, self.angle = errors_across(across, angle)

    @staticmethod
    def sensor(native_scale: Any = 1.0) -> AbstractDepthNoise:
        """The whole camera: mixed readings at edges, and multipath, too.

        Light that comes back by way of other surfaces moves depths smoothly, by a few
        millimeters: half of the 11 mm that the data sheet allows as a systematic error,
        over a quarter of the image.

        Args:
            native_scale: Pixels of the image for one of the camera's.
        """
        length = 120 * real_number("native_scale", native_scale, positive=True)
        warped = CorrelatedNoise(
            TimeOfFlight(), deviation=0.005, length=length, power=0
        )
        return FlyingPixels(warped)

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        dtype = depth.dtype
        floor, growth = (jnp.asarray(x, dtype) for x in (self.floor, self.growth))
        least = jnp.cos(jnp.asarray(self.max_angle, dtype))
        seen = has_surface(depth)
        z = jnp.where(seen, depth, 1)
        light = jnp.where(cos_incidence > least, cos_incidence, least)
        return jnp.where(seen, floor + growth * z * (z / light), jnp.inf)

    @property
    @override
    def bias(self) -> Bias:
        return Bias.of_rays(self.across, self.angle)

    @override
    @compiled
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        key, depth = moved_across(key, depth, normal, camera, self.bias)
        return scattered(key, depth, self.sigma(depth, cos_incidence(normal, camera)))
