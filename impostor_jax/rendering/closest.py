"""Which shape of a scene every ray meets first.

The image is cut into blocks of pixels. Each shape is cast at the rays of those blocks
that its outline's bounds overlap, and what is nearer than before is kept: the work is
that of the pixels that shapes can cover, not of shapes times pixels.
"""

__all__ = ["closest"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from impostor_jax.geometry.rays import Ray
from impostor_jax.rendering.bounds import image_bounds
from impostor_jax.rendering.scene import Group

ROWS, COLS = 8, 32
"""Size of a block. Long rows fill the processor's lanes."""

Nearest = Float[Array, "2 h w"]
"""Depth of what is nearest, and its place."""


def closest(
    groups: list[Group], rays: Ray, is_central: bool
) -> tuple[Int[Array, "h w"], Float[Array, "h w"]]:
    """Place of the closest shape among those of all groups, -1 for none, and its depth.

    Without a derivative; the shape's own formulas have that.

    Args:
        groups: In the camera frame. Places count through their shapes, group by group.
        rays: One for each pixel; NaN or infinite where a pixel sees nothing.
        is_central: Whether they start in one point.
    """
    groups, rays = jax.lax.stop_gradient((groups, rays))
    height, width = rays.direction.z.shape
    rows, cols = -(-height // ROWS) * ROWS, -(-width // COLS) * COLS
    # The last rays once more, so that blocks are whole.
    pad = ((0, rows - height), (0, cols - width))
    rays = jax.tree.map(lambda x: jnp.pad(x, pad, mode="edge"), rays)
    low, high = _extremes(rays, is_central)
    # Depth and place in one array, or XLA would copy all of one for each block of the
    # other. A place is a whole number that the type holds exactly.
    dtype = rays.direction.z.dtype
    nearest = jnp.stack(
        [jnp.full((rows, cols), jnp.inf, dtype), jnp.full((rows, cols), -1, dtype)]
    )
    first = 0
    for group in groups:
        nearest = _cast(group, first, rays, is_central, low, high, nearest)
        first += group.index.shape[0]
    t, place = nearest[:, :height, :width]
    return place.astype(jnp.int32), t


def _extremes(rays: Ray, is_central: bool) -> tuple[tuple[Array, Array], ...]:
    """Smallest and largest x and y of the rays of each block."""
    across = rays.direction if is_central else rays.origin
    found = []
    for reduce, nothing in ((jnp.min, np.inf), (jnp.max, -np.inf)):
        corner = []
        for x in (across.x, across.y):
            rows, cols = x.shape
            blocks = x.reshape(rows // ROWS, ROWS, cols // COLS, COLS)
            blocks = jnp.where(jnp.isfinite(blocks), blocks, nothing)
            corner.append(reduce(blocks, axis=(1, 3)))
        found.append(tuple(corner))
    return tuple(found)


def _cast(
    group: Group,
    first: int,
    rays: Ray,
    is_central: bool,
    low: tuple[Array, Array],
    high: tuple[Array, Array],
    nearest: Nearest,
) -> Nearest:
    """What is nearest after the shapes of one group."""
    bounds = jax.vmap(lambda shape: image_bounds(shape, is_central))(group.primitives)

    def blocks_of(bound, index):
        """First row and column of the blocks, and how many of each."""
        overlaps = bound.overlaps(low, high) & (index >= 0)
        found = []
        for axis in (1, 0):
            seen = jnp.any(overlaps, axis=axis)
            number = jnp.arange(seen.shape[0], dtype=jnp.int32)
            start = jnp.min(jnp.where(seen, number, seen.shape[0]))
            found += [start, jnp.maximum(jnp.max(jnp.where(seen, number, -1)) + 1, 0)]
        row, last_row, col, last_col = found
        num_rows, num_cols = last_row - row, last_col - col
        return row, col, num_cols, jnp.where(num_rows > 0, num_rows * num_cols, 0)

    # A shape at a time, lest all of them times all blocks be held.
    blocks = jax.lax.map(lambda x: blocks_of(*x), (bounds, group.index), batch_size=64)

    def draw(k: Array, nearest: Nearest) -> Nearest:
        shape = jax.tree.map(lambda x: x[k], group.primitives)
        row, col, num_cols, count = (x[k] for x in blocks)
        place = (first + k).astype(nearest.dtype)

        def at_block(number: Array, nearest: Nearest) -> Nearest:
            y = ROWS * (row + number // num_cols)
            x = COLS * (col + number % num_cols)
            cut = jax.lax.dynamic_slice
            ray = jax.tree.map(lambda a: cut(a, (y, x), (ROWS, COLS)), rays)
            seen = shape.intersect(ray).t
            corner = (jnp.zeros_like(y), y, x)
            kept = cut(nearest, corner, (2, ROWS, COLS))
            found = jnp.stack([seen, jnp.full_like(seen, place)])
            found = jnp.where((seen < kept[0])[None], found, kept)
            return jax.lax.dynamic_update_slice(nearest, found, corner)

        return jax.lax.fori_loop(0, count, at_block, nearest)

    count = jnp.asarray(group.index.shape[0], jnp.int32)
    return jax.lax.fori_loop(0, count, draw, nearest)
