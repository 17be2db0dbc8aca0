"""Noise of one standard deviation for all readings."""

__all__ = ["ConstantNoise"]

from typing import Any

import jax.numpy as jnp
from jaxtyping import PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import real_number
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.compiling import compiled
from impostor_jax.numerics import Numbers, Scalar
from impostor_jax.sensor.across import errors_across, moved_across
from impostor_jax.sensor.base import AbstractDepthNoise, Depths, Normals, scattered
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.surface import has_surface


class ConstantNoise(AbstractDepthNoise):
    """Independent normal noise along z.

    Args:
        deviation: Standard deviation in meters, positive.
        across: Standard deviation of a reading's place across its ray, along each of
            two directions, in meters; None where nobody knows: a fit learns it.
        angle: The same of the direction of the ray, in radians.
    """

    deviation: Scalar
    across: Scalar | None
    angle: Scalar | None

    def __init__(self, deviation: Any, across: Any = None, angle: Any = None):
        self.deviation = real_number(
            "deviation", deviation, positive=True, unit="meters"
        )
        self.across, self.angle = errors_across(across, angle)

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        return jnp.where(
            has_surface(depth), jnp.asarray(self.deviation, depth.dtype), jnp.inf
        )

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
        return scattered(key, depth, self.sigma(depth, jnp.ones_like(depth)))
