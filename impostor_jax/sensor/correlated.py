"""Errors that neighbors share: bands, ripples and warps of a depth image."""

__all__ = ["CorrelatedNoise"]

import dataclasses
from typing import Any

import equinox as eqx
import jax
from jaxtyping import PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import bounded_number, is_concrete, real_number
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.compiling import compiled
from impostor_jax.numerics import Numbers, Scalar
from impostor_jax.sensor.base import AbstractDepthNoise, Depths, Normals, noise_model
from impostor_jax.sensor.bias import Bias, SmoothField

SHORTEST = 1.0
"""Correlation length in pixels; what is shorter is no more than `sigma` tells."""


class CorrelatedNoise(AbstractDepthNoise):
    """A sensor whose readings have a smooth error, normal from image to image.

    At a depth z it has the standard deviation `deviation` z^`power`, and the
    correlation exp(-d^2 / (2 length^2)) at a distance of d pixels. Of a length of a few
    pixels it is the grain of an image that a sensor filters; of a hundred and more, a
    warp, by which the wall of a can and its cap disagree. Parts may be nested.

    `sigma` is the sensor's, and leaves it out: a fit counts what the error, as it is
    described here, does to the estimate.

    Args:
        sensor: The noise model that makes the readings.
        deviation: Standard deviation at a depth of 1 m, in meters.
        length: Of the correlation, in pixels.
        power: Of the depth: 2 where the disparity errs, 0 where a travel time does.
    """

    sensor: AbstractDepthNoise
    deviation: Scalar
    length: float = eqx.field(static=True)
    power: Scalar

    def __init__(self, sensor: Any, deviation: Any, length: Any, power: Any = 2.0):
        self.sensor = noise_model(sensor)
        self.deviation = bounded_number(
            "deviation", deviation, "0 or positive, in meters"
        )
        if not is_concrete(length):
            raise ValueError("length must be concrete, got a traced number")
        self.length = real_number("length", length, positive=True, unit="pixels")
        if self.length < SHORTEST:
            raise ValueError(
                f"length must be at least {SHORTEST} pixels, got {self.length}"
            )
        self.power = bounded_number("power", power, "from 0 to 4", 4.0)

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        return self.sensor.sigma(depth, cos_incidence)

    @property
    @override
    def bias(self) -> Bias:
        bias = self.sensor.bias
        return dataclasses.replace(bias, fields=(*bias.fields, self._field))

    @override
    @compiled
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        field_key, sensor_key = jax.random.split(key)
        scene = depth + self._field.draw(field_key, depth)
        return self.sensor.sample(sensor_key, scene, normal, camera)

    @property
    def _field(self) -> SmoothField:
        return SmoothField(self.deviation, self.power, self.length)
