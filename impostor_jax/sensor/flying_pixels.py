"""Flying pixels: readings in mid-air, at the edges of things.

A pixel whose footprint lies across a jump in depth gets light from both sides, and many
sensors then read a depth in between where there is nothing.
"""

__all__ = ["FlyingPixels"]

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import bounded_number
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.compiling import compiled
from impostor_jax.numerics import Numbers, Scalar
from impostor_jax.sensor.base import AbstractDepthNoise, Depths, Normals, noise_model
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.draws import chances
from impostor_jax.sensor.surface import has_surface


class FlyingPixels(AbstractDepthNoise):
    """A sensor that mixes both sides of a jump in depth.

    A pixel lies at a jump if the depth of one of its four neighbors differs by more
    than `jump`; so do the pixels on both sides. With the given probability it shows
    w near + (1 - w) far, w uniform in [0, 1], of itself and the neighbor that differs
    most, and the sensor reads that, with its own noise. Next to a pixel that hits
    nothing there is nothing to mix with.

    Args:
        sensor: The noise model that makes the readings.
        probability: Of a mixed reading at a jump.
        jump: Smallest jump, as a fraction of the nearer depth. At a focal length of
            500 pixels the default is a slope of 86 degrees.
    """

    sensor: AbstractDepthNoise
    probability: Scalar
    jump: Scalar

    def __init__(self, sensor: Any, probability: Any = 0.5, jump: Any = 0.03):
        self.sensor = noise_model(sensor)
        self.probability = bounded_number(
            "probability", probability, "a probability from 0 to 1", 1.0
        )
        self.jump = bounded_number(
            "jump", jump, "0 or a positive fraction of the nearer depth"
        )

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        return self.sensor.sigma(depth, cos_incidence)

    @property
    @override
    def bias(self) -> Bias:
        bias = self.sensor.bias
        return dataclasses.replace(bias, edge_reach=bias.edge_reach + 1)

    @override
    @compiled
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        mix_key, sensor_key = jax.random.split(key)
        other, at_jump = self._across(depth)
        probability = jnp.asarray(self.probability, depth.dtype)
        draw = chances(mix_key, depth.shape, depth.dtype)
        mixes = at_jump & (draw < probability)
        # Of those that are below the probability, draws are uniform once more.
        weight = draw / jnp.where(mixes, probability, 1)
        # Nothing that is infinite may enter a product with a weight of 0.
        own = jnp.where(mixes, depth, 0)
        mixed = weight * own + (1 - weight) * jnp.where(mixes, other, 0)
        scene = jnp.where(mixes, mixed, depth)
        return self.sensor.sample(sensor_key, scene, normal, camera)

    def _across(self, depth: Depths) -> tuple[Depths, Bool[Array, "h w"]]:
        """Depth of the neighbor across the largest jump, and whether there is one."""
        height, width = depth.shape
        z = jnp.where(has_surface(depth), depth, 0)
        ratio = jnp.asarray(self.jump, depth.dtype)
        # Beyond the border lies the border itself, and a pixel does not jump to itself.
        padded = jnp.pad(z, 1, mode="edge")
        other, most = z, jnp.zeros_like(z)
        for near in (
            padded[1 : 1 + height, :width],
            padded[1 : 1 + height, 2:],
            padded[:height, 1 : 1 + width],
            padded[2:, 1 : 1 + width],
        ):
            lower = jnp.minimum(near, z)
            apart = jnp.abs(near - z)
            # The first of those that are as far apart.
            jumps = (lower > 0) & (apart > ratio * lower) & (apart > most)
            other, most = jnp.where(jumps, near, other), jnp.where(jumps, apart, most)
        return other, most > 0
