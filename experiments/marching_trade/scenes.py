"""Terrains, and rays at them."""

__all__ = ["EXTENT", "TERRAINS", "Rays", "as_rays", "land", "over_land"]

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.terrain import Terrain

EXTENT = ((-50.0, 50.0), (-50.0, 50.0))

TERRAINS = {"smooth": Terrain(octaves=2), "steep": Terrain()}
"""The first two octaves of the published terrain, and all ten."""

Vectors = Float[np.ndarray, "n 3"]


@dataclasses.dataclass(frozen=True)
class Rays:
    """Rays of unit direction."""

    origin: Vectors
    direction: Vectors


def over_land(rng: np.random.Generator, count: int) -> Rays:
    """Views from 12 m, above all ground, 5 to 60 degrees down, any way around."""
    origin = np.column_stack(
        [
            rng.uniform(-40, 40, count),
            np.full(count, 12.0),
            rng.uniform(-40, 40, count),
        ]
    )
    down = np.radians(rng.uniform(5, 60, count))
    around = rng.uniform(0, 2 * np.pi, count)
    level = np.cos(down)
    direction = np.column_stack(
        [level * np.cos(around), -np.sin(down), level * np.sin(around)]
    )
    # Rounded once, so that both precisions see the same rays.
    parts = (v.astype(np.float32).astype(float) for v in (origin, direction))
    return Rays(*parts)


def as_rays(rays: Rays, dtype: str) -> Ray:
    """The rays as the package takes them."""
    return Ray(
        Vec3.from_array(jnp.asarray(rays.origin, dtype)),
        Vec3.from_array(jnp.asarray(rays.direction, dtype)),
    )


def land(name: str, dtype: str, **options: Any) -> Heightfield:
    """A terrain over the extent."""
    return Heightfield(TERRAINS[name], jnp.asarray(EXTENT, dtype), **options)
