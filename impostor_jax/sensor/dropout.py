"""Readings that are missing, the more likely the more a surface turns away."""

__all__ = ["Dropout"]

import math
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import angle_below_grazing, bounded_number
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.compiling import compiled
from impostor_jax.numerics import Numbers, Scalar
from impostor_jax.sensor.base import (
    NO_READING,
    AbstractDepthNoise,
    Depths,
    Normals,
    cos_incidence,
    noise_model,
)
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.draws import chances
from impostor_jax.sensor.surface import has_surface

CUTOFF = math.radians(70)
"""Incidence from which more readings are missing, in radians."""


class Dropout(AbstractDepthNoise):
    """A sensor that misses readings; a missing one is 0, and nothing hit stays `+inf`.

    A reading is missing with the probability `rate` up to the angle `cutoff`, where
    surfaces still send enough light back; from there it rises, smoothly in the cosine c
    of the incidence, to 1 at grazing:

        p = 1 - (1 - rate) s^2 (3 - 2 s),  s = min(c / cos(cutoff), 1).

    The law is a stand-in that has the right ends: with the default cutoff half of the
    readings are missing at 80 degrees, about where measurements of such sensors end.
    Each pixel is drawn on its own, where real dropouts come in patches. `rate` holds
    too where the sensor reads something on a ray that hits nothing (`LateralNoise`).

    Args:
        sensor: The noise model that makes the readings.
        rate: Probability that a reading is missing at normal incidence.
        cutoff: Incidence in radians from which the probability grows.
    """

    sensor: AbstractDepthNoise
    rate: Scalar
    cutoff: Scalar

    def __init__(self, sensor: Any, rate: Any = 0.01, cutoff: Any = CUTOFF):
        self.sensor = noise_model(sensor)
        self.rate = bounded_number("rate", rate, "a probability from 0 to 1", 1.0)
        self.cutoff = angle_below_grazing("cutoff", cutoff)

    def probability(self, cos_incidence: Numbers) -> Numbers:
        """Probability that a reading is missing, at a cosine of the incidence."""
        dtype = cos_incidence.dtype
        share = cos_incidence / jnp.cos(jnp.asarray(self.cutoff, dtype))
        share = jnp.clip(share, 0, 1)
        rate = jnp.asarray(self.rate, dtype)
        return 1 - (1 - rate) * share * share * (3 - 2 * share)

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        return self.sensor.sigma(depth, cos_incidence)

    @property
    @override
    def bias(self) -> Bias:
        return self.sensor.bias

    @override
    @compiled
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        drop_key, sensor_key = jax.random.split(key)
        reading = self.sensor.sample(sensor_key, depth, normal, camera)
        cosine = jnp.where(has_surface(depth), cos_incidence(normal, camera), 1)
        draw = chances(drop_key, depth.shape, depth.dtype)
        drops = (draw < self.probability(cosine)) & jnp.isfinite(reading)
        return jnp.where(drops, NO_READING, reading)
