"""Blocks of pixels that a shape's image can cover.

An image is cut into blocks of `ROWS` times `COLS` pixels. A shape is cast at the rays
of those blocks alone that its outline's bounds overlap.
"""

__all__ = [
    "COLS",
    "ROWS",
    "Blocks",
    "Extremes",
    "blocks_of",
    "extremes",
    "whole_blocks",
]

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from impostor_jax.geometry.rays import Ray
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.rendering.bounds import image_bounds

ROWS, COLS = 8, 32
"""Size of a block. Long rows fill the processor's lanes."""

Extremes = tuple[tuple[Array, Array], tuple[Array, Array]]
"""Smallest and largest x and y of the rays of each block."""


class Blocks(eqx.Module):
    """The blocks of one shape: a rectangle of them.

    Attributes:
        row: Number of the first row of blocks.
        col: Number of the first column.
        num_cols: Number of columns.
        count: Number of blocks, 0 where the shape is not seen.
    """

    row: Int[Array, "*batch"]
    col: Int[Array, "*batch"]
    num_cols: Int[Array, "*batch"]
    count: Int[Array, "*batch"]

    def corner(self, number: Int[Array, ""]) -> tuple[Int[Array, ""], Int[Array, ""]]:
        """First row and column of pixels of one of a single shape's blocks."""
        row = ROWS * (self.row + number // self.num_cols)
        return row, COLS * (self.col + number % self.num_cols)


def whole_blocks(rays: Ray) -> Ray:
    """The rays of an image, the last ones once more, so that blocks are whole."""
    height, width = rays.direction.z.shape
    pad = ((0, -height % ROWS), (0, -width % COLS))
    return jax.tree.map(lambda x: jnp.pad(x, pad, mode="edge"), rays)


def extremes(rays: Ray, is_central: bool) -> Extremes:
    """Smallest and largest x and y of the rays of each block.

    Args:
        rays: Of whole blocks; NaN or infinite where a pixel sees nothing.
        is_central: Whether they start in one point.
    """
    across = rays.direction if is_central else rays.origin
    found = []
    for reduce, nothing in ((jnp.min, np.inf), (jnp.max, -np.inf)):
        corner = []
        for x in (across.x, across.y):
            cols = x.shape[1]
            x = jnp.where(jnp.isfinite(x), x, nothing).reshape(-1, ROWS, cols)
            # Over rows first, whose pixels lie side by side: a third of the time less.
            x = reduce(x, axis=1).reshape(-1, cols // COLS, COLS)
            corner.append(reduce(x, axis=2))
        found.append((corner[0], corner[1]))
    return found[0], found[1]


def blocks_of(
    shapes: AbstractPrimitive,
    seen: Bool[Array, " n"],
    ends: Extremes,
    is_central: bool,
) -> Blocks:
    """The blocks that each shape of a batch (n,) can cover.

    Args:
        shapes: In the camera frame.
        seen: Whether each is to be seen at all.
        ends: What `extremes` found.
        is_central: Whether the camera's rays start in its origin; else along z.
    """
    bounds = jax.vmap(lambda shape: image_bounds(shape, is_central))(shapes)

    def covered(bound, is_seen):
        overlaps = bound.overlaps(*ends) & is_seen
        found = []
        for axis in (1, 0):
            any_ = jnp.any(overlaps, axis=axis)
            number = jnp.arange(any_.shape[0], dtype=jnp.int32)
            start = jnp.min(jnp.where(any_, number, any_.shape[0]))
            stop = jnp.maximum(jnp.max(jnp.where(any_, number, -1)) + 1, 0)
            found += [start, stop]
        row, last_row, col, last_col = found
        num_rows, num_cols = last_row - row, last_col - col
        count = jnp.where(num_rows > 0, num_rows * num_cols, 0)
        return Blocks(row, col, num_cols, count)

    # A shape at a time, lest all of them times all blocks be held.
    return jax.lax.map(lambda x: covered(*x), (bounds, seen), batch_size=64)
