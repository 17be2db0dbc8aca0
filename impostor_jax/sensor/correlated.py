"""Errors that neighbors share: bands, ripples and warps of an image, and lines."""

__all__ = ["CorrelatedNoise", "LineNoise", "Lines"]

import abc
import dataclasses
from typing import Any, Literal, get_args

import equinox as eqx
import jax
from jaxtyping import PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import bounded_number, is_concrete, one_of, real_number
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.compiling import compiled
from impostor_jax.numerics import Numbers, Scalar
from impostor_jax.sensor.base import AbstractDepthNoise, Depths, Normals, noise_model
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.fields import AbstractField, LineField, SmoothField

SHORTEST = 1.0
"""Correlation length in pixels; what is shorter is no more than `sigma` tells."""

Lines = Literal["rows", "columns"]
"""Along which readings err alike."""


class _AbstractShared(AbstractDepthNoise):
    """A sensor whose readings have an error in common, too."""

    sensor: eqx.AbstractVar[AbstractDepthNoise]

    @property
    @abc.abstractmethod
    def field(self) -> AbstractField:
        """That error."""

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        own = self.sensor.sigma(depth, cos_incidence)
        return self.field.counted_in(own, depth)

    @property
    @override
    def bias(self) -> Bias:
        bias = self.sensor.bias
        return dataclasses.replace(bias, fields=(*bias.fields, self.field))

    @override
    @compiled
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        field_key, sensor_key = jax.random.split(key)
        scene = depth + self.field.draw(field_key, depth)
        return self.sensor.sample(sensor_key, scene, normal, camera)


class CorrelatedNoise(_AbstractShared):
    """A sensor whose readings have a smooth error, normal from image to image.

    At a depth z it has the standard deviation `deviation` z^`power`, and the
    correlation exp(-d^2 / (2 length^2)) at a distance of d pixels. Of a length of a few
    pixels it is the grain of an image that a sensor filters; of a hundred and more, a
    warp, by which the wall of a can and its cap disagree. Parts may be nested.

    `sigma` counts grain, of a length of up to 10 pixels: readings of a surface scatter
    by it. It leaves a longer error out, which moves a surface as a whole. A fit counts
    what either, as it is described here, does to the estimate.

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

    @property
    @override
    def field(self) -> AbstractField:
        return SmoothField(self.deviation, self.power, self.length)


class LineNoise(_AbstractShared):
    """A sensor whose readings of a line err alike, normally from line to line.

    Of a row, as of a rolling shutter, of the stripes that a projector casts, or of a
    laser of a scanner that has one for each; or of a column, as of a readout that has
    an amplifier for each. `sigma` counts it in each reading. What an average over a
    line keeps of it is why an estimate of many readings is less sure.

    Args:
        sensor: The noise model that makes the readings.
        deviation: Standard deviation at a depth of 1 m, in meters.
        lines: "rows" or "columns".
        power: Of the depth, with which it grows.
    """

    sensor: AbstractDepthNoise
    deviation: Scalar
    lines: Lines = eqx.field(static=True)
    power: Scalar

    def __init__(
        self, sensor: Any, deviation: Any, lines: Any = "rows", power: Any = 0.0
    ):
        self.sensor = noise_model(sensor)
        self.deviation = bounded_number(
            "deviation", deviation, "0 or positive, in meters"
        )
        one_of("lines", lines, get_args(Lines))
        self.lines = lines
        self.power = bounded_number("power", power, "from 0 to 4", 4.0)

    @property
    @override
    def field(self) -> AbstractField:
        return LineField(self.deviation, self.power, self.lines)
