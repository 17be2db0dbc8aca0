"""What every ray meets first of a scene's many shapes.

The image is cut into blocks of pixels, and each block lists the shapes whose outline's
bounds overlap it. Then the blocks are cast at their shapes side by side, each at the
first of its list, at the second, and so on, and what is nearer than before is kept: the
work is that of the pixels that shapes can cover, not of shapes times pixels. Blocks
with lists of about the same length go together, so that none waits for another.

A block keeps the depth of what it sees and its code. The normal and the derivative
follow from these once, of all pixels (`impostor_jax.rendering.follow`).
"""

__all__ = ["closest"]

from collections.abc import Callable, Iterator
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from impostor_jax.camera.base import Projection
from impostor_jax.device import is_processor
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.rendering.blocks import Extent, Pairs, Tiling, pairs_of, rectangles_of
from impostor_jax.rendering.clipping import Clipping
from impostor_jax.rendering.follow import code_of, followed, normals_of, stride_of
from impostor_jax.rendering.group import Group

TILING = Tiling(8, 16)
"""Blocks: smaller ones list more shapes, larger cast more rays in vain."""

TOGETHER = 64
"""Blocks that are cast side by side: what they hold stays in a processor's cache."""

MANY_TOGETHER = 4096
"""The same on a graphics card, which takes longer to begin than to cast few: with 64, a
scene of 10,000 cylinders takes seven times as long."""

MOST_PAIRS = 1 << 16
"""Pairs of a block and a shape that are listed at a time; more take more rounds."""

Surface = tuple[Float[Array, "h w"], Vec3 | None]
"""Depth, and the normal if it is wanted."""

_Places = tuple[int, int]
"""Place of a group's first shape, and the stride of codes."""


def closest(
    groups: list[Group],
    rays: Ray,
    clipping: Clipping | None,
    projection: Projection,
    with_normal: bool,
) -> tuple[Surface, Int[Array, "h w"], Int[Array, "h w"]]:
    """Depth and normal of the closest shape among those of all groups, place and part.

    Differentiable in the shapes and the rays.

    Args:
        groups: In the camera frame. Places count through their shapes, group by group,
            and are -1 where nothing is hit.
        rays: Of a camera, one for each pixel; NaN or infinite where one sees nothing.
        clipping: Where they start; None where the camera lets them.
        projection: Of the camera.
        with_normal: Whether the normal is wanted; it is None if not.
    """
    still_groups, still_rays = jax.lax.stop_gradient((groups, rays))
    blocks = jax.tree.map(TILING.cut, _coordinates(still_rays, projection))

    def rays_of(block: Int[Array, " b"]) -> Ray:
        return _started(_ray_at(_of_blocks(blocks, block), projection), clipping)

    extent, stride = TILING.extent(still_rays, projection), stride_of(groups)
    t, code = _search(still_groups, rays_of, extent, projection)
    t, code = (TILING.joined(x, *rays.direction.z.shape) for x in (t, code))
    seen = groups, _started(rays, clipping)
    normal = normals_of(*seen, t, code) if with_normal else None
    surface = followed(seen, t, code, normal)
    return surface, code // stride, code % stride // 2


def _started(rays: Ray, clipping: Clipping | None) -> Ray:
    return rays if clipping is None else clipping.started(rays)


def _coordinates(rays: Ray, projection: Projection) -> tuple[Array, ...]:
    """What rays of a camera differ in."""
    o, d = rays.origin, rays.direction
    if projection == "parallel":
        return o.x, o.y
    return (d.x, d.y) if projection == "planar" else (d.x, d.y, d.z)


def _ray_at(coordinates: tuple[Array, ...], projection: Projection) -> Ray:
    """The rays again: what they have in common XLA sees, and does not look up."""
    zero = jnp.zeros_like(coordinates[0])
    origin = Vec3(zero, zero, zero)
    if projection == "spherical":
        return Ray(origin, Vec3(*coordinates))
    x, y = coordinates
    if projection == "planar":
        return Ray(origin, Vec3(x, y, zero + 1))
    return Ray(Vec3(x, y, zero), Vec3(zero, zero, zero + 1))


def _search(
    groups: list[Group],
    rays_of: Callable[[Int[Array, " b"]], Ray],
    extent: Extent,
    projection: Projection,
) -> tuple[Float[Array, "blocks pixels"], Int[Array, "blocks pixels"]]:
    """Depth and code of what is nearest, block by block, without a derivative."""
    stride = stride_of(groups)
    size = len(extent[0][0]) * len(extent[1][0]), TILING.rows * TILING.cols
    t = jnp.full(size, jnp.inf, extent[0][0].dtype)
    code = jnp.full(size, -stride, jnp.int32)
    first = 0
    for group in groups:
        for part in _parts(group, size[0]):
            places = first, stride
            t, code = _cast(part, places, rays_of, projection, extent, (t, code))
            first += part.index.shape[0]
    return t, code


Values = TypeVar("Values")


def _of_blocks(values: Values, block: Int[Array, " b"]) -> Values:
    """What some blocks hold; beyond the last block, what that holds."""
    return jax.tree.map(lambda x: x.at[block].get(mode="clip"), values)


def _parts(group: Group, num_blocks: int) -> Iterator[Group]:
    """Parts of a group whose pairs with all blocks can be counted."""
    most = np.iinfo(np.int32).max // num_blocks
    for start in range(0, group.index.shape[0], most):
        yield jax.tree.map(lambda x, k=start: x[k : k + most], group)


def _cast(
    group: Group,
    places: _Places,
    rays_of: Callable[[Int[Array, " b"]], Ray],
    projection: Projection,
    extent: Extent,
    nearest: tuple[Array, Array],
) -> tuple[Array, Array]:
    """What is nearest after the shapes of one group."""
    mine = rectangles_of(group.primitives, group.index >= 0, extent, projection)
    ending = jnp.cumsum(mine.count)
    most = int(np.clip(8 * group.index.shape[0], 2048, MOST_PAIRS))

    def round_(turn: Array, nearest: tuple[Array, Array]) -> tuple[Array, Array]:
        pairs = pairs_of(mine, ending, turn * most, most, extent)
        return _cast_pairs(group.primitives, places, rays_of, pairs, nearest)

    turns = -(-ending[-1] // most)
    return jax.lax.fori_loop(0, turns, round_, nearest)


def _cast_pairs(
    shapes: AbstractPrimitive,
    places: _Places,
    rays_of: Callable[[Int[Array, " b"]], Ray],
    pairs: Pairs,
    nearest: tuple[Array, Array],
) -> tuple[Array, Array]:
    """What is nearest after the shapes of all blocks' pairs."""
    first_place, stride = places
    num_blocks = pairs.order.shape[0]
    together = TOGETHER if is_processor() else MANY_TOGETHER
    # Beyond the last block there is none, and nothing is written.
    more = jnp.full(-num_blocks % together, num_blocks, jnp.int32)
    order = jnp.concatenate([pairs.order, more]).reshape(-1, together)
    lengths = pairs.count.at[order].get(mode="fill", fill_value=0)

    def at_chunk(number: Array, nearest: tuple[Array, Array]) -> tuple[Array, Array]:
        block, count = order[number], lengths[number]
        ray = rays_of(block)
        start = _of_blocks(pairs.first, block)

        def at_slot(slot: Array, nearest: tuple[Array, Array]):
            t, code = nearest
            pair = jnp.minimum(start + slot, pairs.shape.shape[0] - 1)
            number = pairs.shape[pair]
            shape = jax.tree.map(
                lambda x: jnp.broadcast_to(
                    x[number][:, None], (*ray.direction.z.shape, *x.shape[1:])
                ),
                shapes,
            )
            hit = shape.intersect(ray)
            nearer = (hit.t < t) & (slot < count)[:, None]
            own = code_of((first_place + number)[:, None], hit, stride)
            return jnp.where(nearer, hit.t, t), jnp.where(nearer, own, code)

        kept = _of_blocks(nearest, block)
        kept = jax.lax.fori_loop(0, count[0], at_slot, kept)
        return jax.tree.map(
            lambda x, new: x.at[block].set(new, mode="drop", unique_indices=True),
            nearest,
            kept,
        )

    used = jnp.sum(lengths[:, 0] > 0)
    return jax.lax.fori_loop(0, used, at_chunk, nearest)
