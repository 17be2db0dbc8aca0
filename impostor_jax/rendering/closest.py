"""What every ray meets first of a scene's many shapes.

The image is cut into blocks of pixels. Each shape is cast at the rays of those blocks
that its outline's bounds overlap, and what is nearer than before is kept: the work is
that of the pixels that shapes can cover, not of shapes times pixels.

The search has no derivative. What it found is cast once more for that alone, each type
at every pixel, with the fields of the shapes taken pixel by pixel.
"""

__all__ = ["closest"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.rendering.blocks import (
    COLS,
    ROWS,
    Extremes,
    blocks_of,
    extremes,
    whole_blocks,
)
from impostor_jax.rendering.scene import Group

Place = Int[Array, "h w"]
Surface = tuple[Float[Array, "h w"], Vec3 | None]
"""Depth, and the normal if it is wanted."""

Nearest = Float[Array, "planes h w"]
"""Depth of what is nearest, its place, and the components of its normal if wanted."""


def closest(
    groups: list[Group], rays: Ray, is_central: bool, with_normal: bool
) -> tuple[Surface, Place]:
    """Depth and normal of the closest shape among those of all groups, and its place.

    Differentiable in the shapes and the rays.

    Args:
        groups: In the camera frame. Places count through their shapes, group by group,
            and are -1 where nothing is hit.
        rays: One for each pixel; NaN or infinite where a pixel sees nothing.
        is_central: Whether they start in one point.
        with_normal: Whether the normal is wanted; it is None if not.
    """
    surface, place = _search(
        *jax.lax.stop_gradient((groups, rays)), is_central, with_normal
    )
    return _followed((groups, rays), surface, place), place


@jax.custom_jvp
def _followed(
    scene: tuple[list[Group], Ray], surface: Surface, place: Place
) -> Surface:
    """The surface that was found, now with a derivative."""
    return surface


@_followed.defjvp
def _followed_jvp(primals, tangents):
    scene, surface, place = primals

    def cast(scene: tuple[list[Group], Ray]) -> Surface:
        return _cast_again(*scene, place, surface[1] is not None)

    _, change = jax.jvp(cast, (scene,), tangents[:1])
    return _followed(*primals), change


def _cast_again(
    groups: list[Group], rays: Ray, place: Place, with_normal: bool
) -> Surface:
    """Cast each ray at the shape of its place alone."""
    zero = jnp.zeros_like(rays.direction.z)
    t, normal = zero, Vec3(zero, zero, zero)
    first = 0
    for group in groups:
        count = group.index.shape[0]
        mine = (first <= place) & (place < first + count)
        member = jnp.clip(place - first, 0, count - 1)
        shape = jax.tree.map(lambda x, k=member: x[k], group.primitives)
        hit = shape.intersect(rays)
        # Two programs may round an outline's ray to either side.
        mine = mine & hit.mask
        t = jnp.where(mine, hit.t, t)
        if with_normal:
            own = Hit(jnp.where(mine, hit.t, jnp.inf), hit.on_cap, hit.part)
            normal = normal + shape.normal(rays, own)
        first += count
    return t, normal if with_normal else None


def _search(
    groups: list[Group], rays: Ray, is_central: bool, with_normal: bool
) -> tuple[Surface, Place]:
    """As `closest`, without a derivative."""
    height, width = rays.direction.z.shape
    rays = whole_blocks(rays)
    ends = extremes(rays, is_central)
    # All in one array, or XLA would copy all of one for each block of the other. A
    # place is a whole number that the type holds exactly.
    start = (np.inf, -1, 0, 0, 0) if with_normal else (np.inf, -1)
    start = jnp.asarray(start, rays.direction.z.dtype)
    nearest = jnp.broadcast_to(
        start[:, None, None], (len(start), *rays.direction.z.shape)
    )
    first = 0
    for group in groups:
        nearest = _cast(group, first, rays, is_central, ends, nearest)
        first += group.index.shape[0]
    t, place, *normal = nearest[:, :height, :width]
    return (t, Vec3(*normal) if with_normal else None), place.astype(jnp.int32)


def _cast(
    group: Group,
    first: int,
    rays: Ray,
    is_central: bool,
    ends: Extremes,
    nearest: Nearest,
) -> Nearest:
    """What is nearest after the shapes of one group."""
    blocks = blocks_of(group.primitives, group.index >= 0, ends, is_central)

    def draw(k: Array, nearest: Nearest) -> Nearest:
        shape, mine = jax.tree.map(lambda x: x[k], (group.primitives, blocks))
        place = (first + k).astype(nearest.dtype)

        def at_block(number: Array, nearest: Nearest) -> Nearest:
            y, x = mine.corner(number)
            cut = jax.lax.dynamic_slice
            ray = jax.tree.map(lambda a: cut(a, (y, x), (ROWS, COLS)), rays)
            hit = shape.intersect(ray)
            corner = (jnp.zeros_like(y), y, x)
            kept = cut(nearest, corner, (len(nearest), ROWS, COLS))
            found = [hit.t, jnp.full_like(hit.t, place)]
            if len(nearest) > 2:
                n = shape.normal(ray, hit)
                found += [n.x, n.y, n.z]
            # Chosen by an index and not stacked, which XLA does not vectorize: 1000
            # cylinders take twice as long otherwise.
            nearer = hit.t < kept[0]
            plane = jnp.arange(len(nearest))[:, None, None]
            for k, new in enumerate(found):
                kept = jnp.where(nearer[None] & (plane == k), new[None], kept)
            return jax.lax.dynamic_update_slice(nearest, kept, corner)

        return jax.lax.fori_loop(0, mine.count, at_block, nearest)

    count = jnp.asarray(group.index.shape[0], jnp.int32)
    return jax.lax.fori_loop(0, count, draw, nearest)
