"""Bark and rough ground: surfaces that lie off their smooth shapes.

A surface is moved along its normal by a random function of the place in space, smooth
and normal, which is the same wherever the scanner stands. Along the ray that is as
much, over the cosine of the incidence.
"""

__all__ = ["Roughness", "roughened"]

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Scalar
from impostor_jax.sensor.base import cos_incidence

WAVES = 48
"""Of which the function is the sum."""

STEEPEST = 0.25
"""Smallest cosine of the incidence that counts: where a ray grazes more it meets the
side of a bump, and not its continued foot."""


@dataclasses.dataclass(frozen=True)
class Roughness:
    """How rough surfaces are.

    Attributes:
        deviation: Standard deviation from the smooth shape, in meters.
        length: Of the correlation along the surface, exp(-d^2 / (2 length^2)) at a
            distance d, in meters; several times the deviation, as bumps do not hide
            one another.
    """

    deviation: float
    length: float

    def __post_init__(self) -> None:
        for name in ("deviation", "length"):
            if not getattr(self, name) > 0:
                raise ValueError(
                    f"{name} must be positive, in meters, got {getattr(self, name)}"
                )


def roughened(
    key: PRNGKeyArray,
    depth: Float[Array, "h w"],
    normal: Float[Array, "h w 3"],
    camera: AbstractCamera,
    deviation: Scalar,
    length: Scalar,
) -> Float[Array, "h w"]:
    """Depth of the rough surfaces, to first order in the deviation.

    Args:
        key: Of the random function.
        depth: Of the smooth shapes, `+inf` where nothing is hit.
        normal: Of the smooth shapes.
        camera: What sees them.
        deviation: As of `Roughness`.
        length: As of `Roughness`.

    References:
        Rahimi and Recht, Random features for large-scale kernel machines, 2007: waves
        whose directions and phases are drawn have that correlation.
    """
    row, col = camera.frame.pixels()
    ray = camera.rays(row, col, depth.dtype)
    seen = jnp.isfinite(depth)
    point = ray.at(jnp.where(seen, depth, 0))
    wave_key, phase_key = jax.random.split(key)
    waves = jax.random.normal(wave_key, (WAVES, 3), depth.dtype) / length
    phases = jax.random.uniform(phase_key, (WAVES,), depth.dtype, 0, 2 * jnp.pi)

    def add(total: Float[Array, "h w"], wave: tuple[Array, Array]):
        direction, phase = wave
        along = point.dot(Vec3.from_array(direction))
        return total + jnp.cos(along + phase), None

    total, _ = jax.lax.scan(add, jnp.zeros_like(depth), (waves, phases))
    bump = deviation * (2 / WAVES) ** 0.5 * total
    cosine = jnp.maximum(cos_incidence(normal, camera), STEEPEST)
    return jnp.where(seen, depth - bump / (cosine * ray.direction.norm()), depth)
