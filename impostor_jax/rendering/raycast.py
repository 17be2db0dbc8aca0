"""Exact rendering: one ray through the center of every pixel."""

__all__ = ["raycast"]

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.base import in_camera_frame
from impostor_jax.rendering.clipping import Clipping
from impostor_jax.rendering.closest import closest
from impostor_jax.rendering.group import is_searched
from impostor_jax.rendering.scene import Scene, Shown

Places = Int[Array, "h w"]
FirstHit = tuple[Float[Array, "h w"], Vec3 | None, Places, Places]
"""What rays meet: the depth, the normal if it is wanted, and which part of which shape
that is, the shape first."""


def raycast(
    primitive: Shown,
    camera: AbstractCamera,
    row: Int[Array, "h w"],
    col: Int[Array, "h w"],
    with_normal: bool,
    clipping: Clipping | None = None,
) -> dict[str, Array]:
    """Maps of some pixels, all but the coverage, by the names of `GeometryMaps`.

    Of a compiled program no more than what is taken of them is left.

    Args:
        primitive: One shape or a scene, in the world frame.
        camera: The camera.
        row: Rows of the pixels.
        col: Columns of the pixels.
        with_normal: Whether the normal is wanted; it is not among them if not.
        clipping: What depths are seen; None for all.

    Derivatives:
        As of `render`.
    """
    ray = camera.rays(row, col, primitive.dtype)
    t, normal, index, part = _first_surface(
        primitive, camera, ray, clipping, with_normal
    )
    sees = camera.sees(row, col)
    if sees is not None:
        t = jnp.where(sees, t, jnp.inf)
    if clipping is not None:
        t = clipping.depth(t)
    mask = jnp.isfinite(t)
    if normal is not None and not (sees is None and clipping is None):
        zero = jnp.zeros_like(t)
        normal = normal.where(mask, Vec3(zero, zero, zero))
    point = ray.at(jnp.where(mask, t, 0)).stack()
    maps = {
        "depth": t,
        "range": t * ray.direction.norm(),
        "point": jnp.where(mask[..., None], point, jnp.inf),
        "mask": mask,
        "index": jnp.where(mask, index, -1),
        "part": jnp.where(mask, part, -1),
    }
    return maps if normal is None else {**maps, "normal": normal.stack()}


def _first_surface(
    primitive: Shown,
    camera: AbstractCamera,
    ray: Ray,
    clipping: Clipping | None,
    with_normal: bool,
) -> FirstHit:
    """What rays of pixels meet first, of what is clipped."""
    started = ray if clipping is None else clipping.started(ray)
    if not isinstance(primitive, Scene):
        primitive = in_camera_frame(primitive, camera)
        hit = primitive.intersect(started)
        normal = primitive.normal(started, hit) if with_normal else None
        return hit.t, normal, jnp.zeros(hit.t.shape, jnp.int32), _numbers(hit)
    # Search among many shapes of a type; those alone or not searched see every ray.
    many, few = [], []
    for group in primitive.seen_by(camera).groups:
        count = group.index.shape[0]
        if count > 1 and is_searched(group.primitives):
            many.append(group)
        else:
            few += [jax.tree.map(lambda x, k=k: x[k], group) for k in range(count)]
    shape = ray.direction.z.shape
    t, index = jnp.full(shape, jnp.inf, primitive.dtype), jnp.full(shape, -1, jnp.int32)
    part = index
    zero = jnp.zeros_like(t)
    normal = Vec3(zero, zero, zero) if with_normal else None
    if many:
        (t, normal), place, part = closest(
            many, ray, clipping, camera.projection, with_normal
        )
        given = jnp.concatenate([group.index for group in many])
        index = given[jnp.maximum(place, 0)]
    for group in few:
        only = group.primitives
        hit = only.intersect(started)
        nearer = hit.t < t
        if normal is not None:
            own = Hit(jnp.where(nearer, hit.t, jnp.inf), hit.on_cap, hit.part)
            normal = only.normal(started, own).where(nearer, normal)
        t = jnp.where(nearer, hit.t, t)
        index = jnp.where(nearer, group.index, index)
        part = jnp.where(nearer, _numbers(hit), part)
    return t, normal, index, part


def _numbers(hit: Hit) -> Places:
    """Parts in the type of the index, in either precision."""
    return hit.part.astype(jnp.int32)
