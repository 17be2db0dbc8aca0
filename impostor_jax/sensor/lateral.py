"""Lateral noise: a reading belongs to a surface point a pixel or so off its ray.

On a surface that faces the camera this changes nothing. It moves readings along slopes,
and makes the edges of objects ragged.
"""

__all__ = ["LateralNoise"]

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import angle_below_grazing, bounded_number, is_concrete
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.compiling import compiled
from impostor_jax.numerics import Numbers, Scalar
from impostor_jax.sensor.base import (
    AbstractDepthNoise,
    Depths,
    Normals,
    cos_incidence,
    noise_model,
)
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.draws import normal_draws
from impostor_jax.sensor.structured_light import MAX_ANGLE, grazing_ratio
from impostor_jax.sensor.surface import has_surface

RARE_SHIFT = 2.6
"""Standard deviations beyond which one shift in a hundred goes."""


class LateralNoise(AbstractDepthNoise):
    """A sensor whose pixels look at a surface a random shift away.

    The shifts along rows and columns are independent, normal, and rounded to whole
    pixels; their standard deviation in pixels is

        floor + growth theta / (pi/2 - theta)

    with the incidence theta at the pixel's own surface, and `floor` where its ray hits
    nothing. So a pixel at an edge reads the object, what lies behind it or, where that
    is nothing, `+inf`. At the image's border the shift ends.

    The sensor reads depth and normal there and adds its own noise. `sigma` is the
    sensor's, and leaves out what the shift adds on a slope.

    Args:
        sensor: The noise model that reads the depths.
        floor: Standard deviation of the shift at normal incidence, in pixels.
        growth: Of that standard deviation with the incidence, in pixels.
        max_angle: Incidence in radians from which the standard deviation is held
            constant.

    References:
        Nguyen, Izadi and Lovell, Modeling Kinect sensor noise for improved 3D
        reconstruction and tracking, 3DIMPVT 2012; the defaults are their fit.
    """

    sensor: AbstractDepthNoise
    floor: Scalar
    growth: Scalar
    max_angle: Scalar

    def __init__(
        self,
        sensor: Any,
        floor: Any = 0.8,
        growth: Any = 0.035,
        max_angle: Any = MAX_ANGLE,
    ):
        self.sensor = noise_model(sensor)
        # A shift of more pixels than an image has would not fit an integer.
        self.floor = bounded_number("floor", floor, "from 0 to 10000 pixels", 1e4)
        self.growth = bounded_number("growth", growth, "from 0 to 10000 pixels", 1e4)
        self.max_angle = angle_below_grazing("max_angle", max_angle)

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        return self.sensor.sigma(depth, cos_incidence)

    @property
    @override
    def bias(self) -> Bias:
        bias = self.sensor.bias
        # On the host, in the same precision, in a tenth of the time.
        xp: Any = np if is_concrete(self.floor) else jnp
        floor = xp.asarray(self.floor, jnp.result_type(float))
        farthest = xp.ceil(RARE_SHIFT * floor - 0.5)
        reach = bias.edge_reach + farthest.astype(int)
        return dataclasses.replace(bias, edge_reach=reach)

    @override
    @compiled
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        shift_key, sensor_key = jax.random.split(key)
        ratio, _ = grazing_ratio(cos_incidence(normal, camera), self.max_angle)
        ratio = jnp.where(has_surface(depth), ratio, 0)
        floor, growth = (
            jnp.asarray(field, depth.dtype) for field in (self.floor, self.growth)
        )
        height, width = depth.shape
        draw = normal_draws(shift_key, (2 * height, width), depth.dtype)
        draw = draw.reshape(2, height, width)
        shift = jnp.round((floor + growth * ratio)[None] * draw).astype(jnp.int32)
        row, col = camera.frame.pixels()
        row = jnp.clip(row + shift[0], 0, camera.height - 1)
        col = jnp.clip(col + shift[1], 0, camera.width - 1)
        return self.sensor.sample(sensor_key, depth[row, col], normal[row, col], camera)
