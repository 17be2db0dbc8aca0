"""How well the numbers that both sides are given determine what a pixel sees.

An input x_i, rounded, is known to a relative eps, and then a result f to eps times
sum |x_i df/dx_i|, whatever formula it comes from: the primitives promise a depth within
a few of these. The inputs are all numbers of the primitive and of the pixel's ray; a
direction is known to eps of its length, since it is made to have one. The depth is one
more input of the normal, known to its own sum: where rounding moves the hit along the
ray, the normal is that of another point.
"""

__all__ = ["Condition", "condition_of"]

import dataclasses
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.compiling import quickly_compiled
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.glsl.batches import batches_in_camera
from impostor_jax.numerics import safe_norm
from impostor_jax.parity.case import Primitives
from impostor_jax.primitives.base import UNITS, AbstractPrimitive

CHUNK = 2048
"""Pixels at a time, always as many: one compilation serves all."""


@dataclasses.dataclass(frozen=True)
class Condition:
    """What a relative change of all inputs by 1 would do, to first order.

    Attributes:
        depth: In meters; 0 where nothing is hit.
        normal: In radians; 0 where nothing is hit.
    """

    depth: Float[np.ndarray, "h w"]
    normal: Float[np.ndarray, "h w"]


def condition_of(
    primitives: Primitives, camera: AbstractCamera, index: Int[np.ndarray, "h w"]
) -> Condition:
    """Condition of every pixel.

    Args:
        primitives: As `OffscreenRenderer.draw` takes them.
        camera: As `OffscreenRenderer.draw` takes it.
        index: Which of them a pixel sees; -1 for none.
    """
    row, col = camera.frame.pixels()
    found = np.zeros((index.size, 2), np.float32)
    for batch in batches_in_camera(primitives, camera):
        member = index.ravel() - batch.first
        (mine,) = np.nonzero((member >= 0) & (member < batch.count))
        rays = camera.rays(row, col, batch.primitives.dtype)
        rays = jax.tree.map(lambda x: jnp.broadcast_to(x, index.shape).ravel(), rays)
        for start in range(0, len(mine), CHUNK):
            pixels = mine[np.arange(start, start + CHUNK).clip(max=len(mine) - 1)]
            ray = jax.tree.map(lambda x, k=pixels: x[k], rays)
            if batch.count > 1:
                seen = jax.tree.map(lambda x, k=member[pixels]: x[k], batch.primitives)
                found[pixels] = _each_of(seen, ray)
            else:
                # A grid, which needs no copy for every pixel.
                seen = jax.tree.map(lambda x: x[0], batch.primitives)
                found[pixels] = _all_of(seen, ray)
    return Condition(*found.T.reshape(2, *index.shape))


def _condition(primitive: AbstractPrimitive, ray: Ray) -> Float[Array, "2"]:
    """Condition of depth and normal at one pixel."""

    def surface(primitive: AbstractPrimitive, ray: Ray) -> tuple[Array, Hit]:
        hit = primitive.intersect(ray)
        return ray.at(hit.t).z, hit

    slopes, hit = jax.jacfwd(surface, argnums=(0, 1), has_aux=True)(primitive, ray)
    depth = _change((primitive, ray), slopes)

    def normal(primitive: AbstractPrimitive, ray: Ray, t: Array) -> Array:
        return primitive.normal(ray, Hit(t, hit.on_cap, hit.part)).stack()

    *slopes, along = jax.jacfwd(normal, argnums=(0, 1, 2))(primitive, ray, hit.t)
    turn = _change((primitive, ray), tuple(slopes)) + depth * safe_norm(along)
    return jnp.stack([depth, turn])


def _change(inputs: Any, slopes: Any) -> Float[Array, ""]:
    """Sum of |x df/dx| over all inputs."""
    total = jnp.zeros(())
    leaves = jax.tree.leaves_with_path(inputs)
    for (path, x), slope in zip(leaves, jax.tree.leaves(slopes), strict=True):
        size = jnp.sqrt(jnp.sum(slope.reshape(-1, x.size) ** 2, axis=0))
        known_to = jnp.abs(x.ravel())
        if UNITS.get(path[-1].name) == "":
            known_to = jnp.max(known_to)
        total = total + jnp.sum(known_to * size)
    return total


@partial(quickly_compiled, optimized=False)
def _each_of(primitives: AbstractPrimitive, rays: Ray) -> Float[Array, "n 2"]:
    return jax.vmap(_condition)(primitives, rays)


@partial(quickly_compiled, optimized=False)
def _all_of(primitive: AbstractPrimitive, rays: Ray) -> Float[Array, "n 2"]:
    return jax.vmap(partial(_condition, primitive))(rays)
