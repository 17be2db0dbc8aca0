"""What every ray meets first of a scene's many shapes.

The image is cut into blocks of pixels, and each block lists the shapes whose outline's
bounds overlap it. Then the blocks are cast at their shapes side by side, each at the
first of its list, at the second, and so on, and what is nearer than before is kept: the
work is that of the pixels that shapes can cover, not of shapes times pixels. Blocks
with lists of about the same length go together, so that none waits for another.

A block keeps the depth of what it sees and its code: which shape, and which part of it.
The normal follows from these once, of all pixels, and so does the derivative, which
does not pass through the search.
"""

__all__ = ["closest"]

from collections.abc import Iterator
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.compiling import computed_apart
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.rendering.blocks import Extent, blocks_of, extent_of
from impostor_jax.rendering.scene import Group

ROWS, COLS = 8, 16
"""Size of a block: smaller ones list more shapes, larger cast more rays in vain."""

TOGETHER = 64
"""Blocks that are cast side by side: what they hold stays in a processor's cache."""

PARTS = 16
"""Codes of a shape: more than pieces of any, times two for a cap or none."""

MOST_PAIRS = 1 << 16
"""Pairs of a block and a shape that are listed at a time; more take more rounds."""

Surface = tuple[Float[Array, "h w"], Vec3 | None]
"""Depth, and the normal if it is wanted."""

Code = Int[Array, "h w"]
"""Place of what is seen among all shapes, times `PARTS`, and its part; below 0 where
nothing is."""


class _Lists(eqx.Module):
    """Some pairs of a block and a shape, sorted by blocks.

    Attributes:
        shape: Number of the shape in its group.
        first: Place of each block's first pair.
        count: Its number of pairs.
        order: The blocks, those with the longest lists first.
    """

    shape: Int[Array, " p"]
    first: Int[Array, " c"]
    count: Int[Array, " c"]
    order: Int[Array, " c"]


def closest(
    groups: list[Group], rays: Ray, is_central: bool, with_normal: bool
) -> tuple[Surface, Int[Array, "h w"], Int[Array, "h w"]]:
    """Depth and normal of the closest shape among those of all groups, place and part.

    Differentiable in the shapes and the rays.

    Args:
        groups: In the camera frame. Places count through their shapes, group by group,
            and are -1 where nothing is hit.
        rays: One for each pixel; NaN or infinite where a pixel sees nothing.
        is_central: Whether they start in one point.
        with_normal: Whether the normal is wanted; it is None if not.
    """
    t, code = _search(*jax.lax.stop_gradient((groups, rays)), is_central)
    surface = _followed((groups, rays), t, code, with_normal)
    return surface, code // PARTS, code % PARTS // 2


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def _followed(
    scene: tuple[list[Group], Ray],
    t: Float[Array, "h w"],
    code: Code,
    with_normal: bool,
) -> Surface:
    """The surface that was found, now with a derivative."""
    if not with_normal:
        return t, None
    groups, rays = scene
    zero = jnp.zeros_like(t)
    normal = Vec3(zero, zero, zero)
    for shape, mine, hit in _seen(groups, t, code):
        normal = shape.normal(rays, hit).where(mine, normal)
    return t, normal


@_followed.defjvp
def _followed_jvp(with_normal, primals, tangents):
    scene, t, code = primals

    def cast(scene: tuple[list[Group], Ray]) -> Surface:
        groups, rays = scene
        depth = jnp.zeros_like(t)
        normal = Vec3(depth, depth, depth)
        for shape, mine, _ in _seen(groups, t, code):
            hit = shape.intersect(rays)
            # Two programs may round an outline's ray to either side.
            mine = mine & hit.mask
            depth = jnp.where(mine, hit.t, depth)
            if with_normal:
                own = Hit(jnp.where(mine, hit.t, jnp.inf), hit.on_cap, hit.part)
                normal = normal + shape.normal(rays, own)
        return depth, normal if with_normal else None

    _, change = jax.jvp(cast, (scene,), tangents[:1])
    return _followed(scene, t, code, with_normal), change


def _seen(
    groups: list[Group], t: Float[Array, "h w"], code: Code
) -> Iterator[tuple[AbstractPrimitive, Bool[Array, "h w"], Hit]]:
    """Of each group: the shapes pixel by pixel, where they are seen, and the hits."""
    place, part = code // PARTS, code % PARTS
    first = 0
    for group in groups:
        count = group.index.shape[0]
        mine = (first <= place) & (place < first + count)
        member = jnp.clip(place - first, 0, count - 1)
        shape = jax.tree.map(lambda x, k=member: x[k], group.primitives)
        hit = Hit(jnp.where(mine, t, jnp.inf), part % 2 == 1, part // 2)
        yield shape, mine, hit
        first += count


def _search(
    groups: list[Group], rays: Ray, is_central: bool
) -> tuple[Float[Array, "h w"], Code]:
    """Depth and code of what is nearest, without a derivative."""
    height, width = rays.direction.z.shape
    blocks = jax.tree.map(_as_blocks, rays)
    extent = extent_of(rays, is_central, ROWS, COLS)
    size = blocks.direction.z.shape
    t = jnp.full(size, jnp.inf, rays.direction.z.dtype)
    code = jnp.full(size, -PARTS, jnp.int32)
    first = 0
    for group in groups:
        for part in _parts(group, size[0]):
            t, code = _cast(part, first, blocks, is_central, extent, (t, code))
            first += part.index.shape[0]
    return _as_image(t, height, width), _as_image(code, height, width)


def _parts(group: Group, num_blocks: int) -> Iterator[Group]:
    """Parts of a group whose pairs with all blocks can be counted."""
    most = np.iinfo(np.int32).max // num_blocks
    for start in range(0, group.index.shape[0], most):
        yield jax.tree.map(lambda x, k=start: x[k : k + most], group)


def _as_blocks(image: Array) -> Array:
    """Blocks of an image, row by row; the last pixels once more to make them whole."""
    height, width = image.shape
    pad = ((0, -height % ROWS), (0, -width % COLS))
    image = jnp.pad(image, pad, mode="edge")
    parts = image.reshape(image.shape[0] // ROWS, ROWS, -1, COLS).swapaxes(1, 2)
    return parts.reshape(-1, ROWS * COLS)


def _as_image(blocks: Array, height: int, width: int) -> Array:
    """The image that blocks were cut from."""
    rows, cols = -(-height // ROWS), -(-width // COLS)
    parts = blocks.reshape(rows, cols, ROWS, COLS).swapaxes(1, 2)
    return parts.reshape(rows * ROWS, cols * COLS)[:height, :width]


def _cast(
    group: Group,
    first: int,
    blocks: Ray,
    is_central: bool,
    extent: Extent,
    nearest: tuple[Array, Array],
) -> tuple[Array, Array]:
    """What is nearest after the shapes of one group."""
    mine = blocks_of(group.primitives, group.index >= 0, extent, is_central)
    num_blocks, line = blocks.direction.z.shape[0], extent[1][0].shape[0]
    ending = jnp.cumsum(mine.count)
    most = int(np.clip(16 * group.index.shape[0], 2048, MOST_PAIRS))

    def listed(turn: Array) -> _Lists:
        """The pairs of one round."""
        pair = turn * most + jnp.arange(most, dtype=jnp.int32)
        shape = jnp.searchsorted(ending, pair, side="right").astype(jnp.int32)
        shape = jnp.minimum(shape, group.index.shape[0] - 1)
        within = pair - (ending - mine.count)[shape]
        wide = jnp.maximum(mine.num_cols[shape], 1)
        row, col = mine.row[shape] + within // wide, mine.col[shape] + within % wide
        block = row * line + col
        block = jnp.where(pair < ending[-1], block, num_blocks).astype(jnp.int32)
        block, shape = _sorted_pairs(block, shape, num_blocks, group.index.shape[0])
        start = jnp.searchsorted(block, jnp.arange(num_blocks + 1, dtype=jnp.int32))
        count = jnp.diff(start).astype(jnp.int32)
        order = jnp.argsort(-count).astype(jnp.int32)
        return _Lists(shape, start[:-1].astype(jnp.int32), count, order)

    def round_(turn: Array, nearest: tuple[Array, Array]) -> tuple[Array, Array]:
        return _cast_lists(group, first, blocks, listed(turn), nearest)

    turns = -(-ending[-1] // most)
    return jax.lax.fori_loop(0, turns, round_, nearest)


def _sorted_pairs(
    block: Int[Array, " p"], shape: Int[Array, " p"], num_blocks: int, num_shapes: int
) -> tuple[Int[Array, " p"], Int[Array, " p"]]:
    """Pairs in the order of their blocks.

    As one number each where they fit: 65536 are sorted in 4 ms, and in 14 as two.
    """
    bits = (num_shapes - 1).bit_length()
    if (num_blocks + 1) << bits > np.iinfo(np.int32).max:
        block, shape = jax.lax.sort((block, shape), num_keys=1)
        return block, shape
    both = jnp.sort((block << bits) | shape)
    return both >> bits, both & ((1 << bits) - 1)


def _cast_lists(
    group: Group,
    first: int,
    blocks: Ray,
    lists: _Lists,
    nearest: tuple[Array, Array],
) -> tuple[Array, Array]:
    """What is nearest after the shapes of all lists."""
    num_blocks = lists.order.shape[0]
    # Beyond the last block there is none, and nothing is written.
    more = jnp.full(-num_blocks % TOGETHER, num_blocks, jnp.int32)
    order = jnp.concatenate([lists.order, more]).reshape(-1, TOGETHER)
    lengths = lists.count.at[order].get(mode="fill", fill_value=0)

    def at_chunk(number: Array, nearest: tuple[Array, Array]) -> tuple[Array, Array]:
        block, count = order[number], lengths[number]
        ray = jax.tree.map(lambda x: x.at[block].get(mode="clip"), blocks)
        start = lists.first.at[block].get(mode="clip")

        def at_slot(slot: Array, nearest: tuple[Array, Array]):
            t, code = nearest
            pair = jnp.minimum(start + slot, lists.shape.shape[0] - 1)
            number = lists.shape[pair]
            shape = jax.tree.map(
                lambda x: jnp.broadcast_to(
                    x[number][:, None], (*ray.direction.z.shape, *x.shape[1:])
                ),
                group.primitives,
            )
            hit = computed_apart(lambda: shape.intersect(ray), ray.direction.z)
            nearer = (hit.t < t) & (slot < count)[:, None]
            piece = 2 * hit.part.astype(jnp.int32) + hit.on_cap.astype(jnp.int32)
            own = PARTS * (first + number)[:, None] + piece
            return jnp.where(nearer, hit.t, t), jnp.where(nearer, own, code)

        kept = jax.tree.map(lambda x: x.at[block].get(mode="clip"), nearest)
        kept = jax.lax.fori_loop(0, count[0], at_slot, kept)
        return jax.tree.map(
            lambda x, new: x.at[block].set(new, mode="drop", unique_indices=True),
            nearest,
            kept,
        )

    used = jnp.sum(lengths[:, 0] > 0)
    return jax.lax.fori_loop(0, used, at_chunk, nearest)
