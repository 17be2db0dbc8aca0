"""What JAX draws of the cylinders that a driver draws."""

__all__ = ["draw_with_jax"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.rays import Hit
from impostor_jax.glsl.conventions import DrawnMaps
from impostor_jax.glsl.request import batch_in_camera
from impostor_jax.primitives.cylinder import Cylinder


def draw_with_jax(cylinders: Cylinder, camera: AbstractCamera) -> DrawnMaps:
    """Maps of the closest cylinder at every pixel, in the precision of the cylinders.

    Every pixel's ray meets every cylinder, one after the other: exact, and slow for
    thousands of them.

    Args:
        cylinders: One, or a batch (n,), in the world frame.
        camera: As `OffscreenRenderer.draw` takes it.
    """
    cylinders = batch_in_camera(cylinders, camera)
    depth, point, normal, index, on_cap = map(np.asarray, _closest(cylinders, camera))
    return DrawnMaps(depth, point, normal, index >= 0, index, on_cap, depth)


@jax.jit
def _closest(cylinders: Cylinder, camera: AbstractCamera) -> tuple[Array, ...]:
    row, col = camera.frame.pixels()
    ray = camera.rays(row, col, cylinders.radius.dtype)

    def nearer(best: tuple[Hit, Array], given: tuple[Array, Cylinder]):
        (kept, index), (k, one) = best, given
        hit = one.intersect(ray)
        closer = hit.t < kept.t
        hit = jax.tree.map(lambda a, b: jnp.where(closer, a, b), hit, kept)
        return (hit, jnp.where(closer, k, index)), None

    nothing = Hit(
        t=jnp.full(row.shape, jnp.inf, cylinders.radius.dtype),
        on_cap=jnp.zeros(row.shape, bool),
    )
    count = jnp.arange(cylinders.radius.shape[0], dtype=jnp.int32)
    start = nothing, jnp.full(row.shape, -1, jnp.int32)
    (hit, index), _ = jax.lax.scan(nearer, start, (count, cylinders))
    seen = jax.tree.map(lambda a: jnp.asarray(a)[jnp.maximum(index, 0)], cylinders)
    point = ray.at(jnp.where(hit.mask, hit.t, 0)).stack()
    point = jnp.where(hit.mask[..., None], point, jnp.inf)
    return hit.t, point, seen.normal(ray, hit).stack(), index, hit.on_cap
