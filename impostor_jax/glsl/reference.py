"""What JAX draws of the primitives that a driver draws."""

__all__ = ["draw_with_jax"]

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.rays import Hit
from impostor_jax.glsl.conventions import DrawnMaps
from impostor_jax.glsl.request import batches_in_camera
from impostor_jax.primitives.base import AbstractPrimitive


def draw_with_jax(
    primitives: AbstractPrimitive | Sequence[AbstractPrimitive],
    camera: AbstractCamera,
) -> DrawnMaps:
    """Maps of the closest primitive at every pixel, in the precision of the primitives.

    Every pixel's ray meets every primitive, one after the other: exact, and slow for
    thousands of them.

    Args:
        primitives: As `OffscreenRenderer.draw` takes them.
        camera: As `OffscreenRenderer.draw` takes it.
    """
    best = None
    for batch in batches_in_camera(primitives, camera):
        found = DrawnMaps(*map(np.asarray, _closest(batch.primitives, camera)))
        index = np.where(found.mask, found.index + batch.first, -1)
        found = dataclasses.replace(found, index=index)
        best = found if best is None else _nearer(best, found)
    assert best is not None
    return best


def _nearer(kept: DrawnMaps, given: DrawnMaps) -> DrawnMaps:
    """The nearer of two renderings at every pixel; the first where they are equal."""
    closer = given.depth < kept.depth

    def chosen(name: str) -> np.ndarray:
        old, new = getattr(kept, name), getattr(given, name)
        return np.where(closer if old.ndim == 2 else closer[..., None], new, old)

    return DrawnMaps(*(chosen(field.name) for field in dataclasses.fields(DrawnMaps)))


@jax.jit
def _closest(
    primitives: AbstractPrimitive, camera: AbstractCamera
) -> tuple[Array, ...]:
    """Fields of the `DrawnMaps` of a batch."""
    row, col = camera.frame.pixels()
    ray = camera.rays(row, col, primitives.dtype)

    def nearer(best: tuple[Hit, Array], given: tuple[Array, AbstractPrimitive]):
        (kept, index), (k, one) = best, given
        hit = one.intersect(ray)
        closer = hit.t < kept.t
        hit = jax.tree.map(lambda a, b: jnp.where(closer, a, b), hit, kept)
        return (hit, jnp.where(closer, k, index)), None

    nothing = Hit(
        t=jnp.full(row.shape, jnp.inf, primitives.dtype),
        on_cap=jnp.zeros(row.shape, bool),
        part=jnp.zeros(row.shape, int),
    )
    (count,) = primitives.batch_shape
    start = nothing, jnp.full(row.shape, -1, jnp.int32)
    numbered = jnp.arange(count, dtype=jnp.int32), primitives
    (hit, index), _ = jax.lax.scan(nearer, start, numbered)
    # One needs no copy for every pixel.
    chosen = jnp.maximum(index, 0) if count > 1 else 0
    seen = jax.tree.map(lambda a: jnp.asarray(a)[chosen], primitives)
    point = ray.at(jnp.where(hit.mask, hit.t, 0)).stack()
    point = jnp.where(hit.mask[..., None], point, jnp.inf)
    normal = seen.normal(ray, hit).stack()
    return hit.t, point, normal, hit.mask, index, hit.on_cap, hit.t
