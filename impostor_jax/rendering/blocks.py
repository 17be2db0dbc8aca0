"""Blocks of pixels that a shape's image can cover.

An image is cut into blocks of so many rows and columns. A shape is cast at the rays of
those blocks alone that its outline's bounds overlap: a rectangle of them.
"""

__all__ = ["Blocks", "Extent", "blocks_of", "extent_of"]

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from impostor_jax.geometry.rays import Ray
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.rendering.bounds import image_bounds

Extent = tuple[tuple[Array, Array], tuple[Array, Array]]
"""Smallest and largest y of the rays of each row of blocks, and x of each column."""


class Blocks(eqx.Module):
    """The blocks of one shape: a rectangle of them, empty where it is not seen.

    Attributes:
        row: Number of the first row of blocks.
        num_rows: Number of rows.
        col: Number of the first column.
        num_cols: Number of columns.
    """

    row: Int[Array, "*batch"]
    num_rows: Int[Array, "*batch"]
    col: Int[Array, "*batch"]
    num_cols: Int[Array, "*batch"]

    @property
    def count(self) -> Int[Array, "*batch"]:
        """Number of blocks."""
        return self.num_rows * self.num_cols


def extent_of(rays: Ray, is_central: bool, rows: int, cols: int) -> Extent:
    """Where the rays of blocks are.

    Args:
        rays: Of an image; NaN or infinite where a pixel sees nothing.
        is_central: Whether they start in one point.
        rows: Of pixels, in a block.
        cols: Of pixels, in a block.
    """
    across = rays.direction if is_central else rays.origin

    def ends(values: Array, step: int) -> tuple[Array, Array]:
        found = []
        for reduce, nothing in ((jnp.min, np.inf), (jnp.max, -np.inf)):
            known = jnp.where(jnp.isfinite(values), values, nothing)
            line = reduce(known, axis=1)
            more = jnp.full(-line.shape[0] % step, nothing, line.dtype)
            line = jnp.concatenate([line, more])
            found.append(reduce(line.reshape(-1, step), axis=1))
        return found[0], found[1]

    return ends(across.y, rows), ends(across.x.T, cols)


def blocks_of(
    shapes: AbstractPrimitive,
    seen: Bool[Array, " n"],
    extent: Extent,
    is_central: bool,
) -> Blocks:
    """The blocks that each shape of a batch (n,) can cover.

    Args:
        shapes: In the camera frame.
        seen: Whether each is to be seen at all.
        extent: What `extent_of` found.
        is_central: Whether the camera's rays start in its origin; else along z.
    """
    bounds = jax.vmap(lambda shape: image_bounds(shape, is_central))(shapes)
    spans = []
    for (low, high), axis in zip(extent, (1, 0), strict=True):
        overlaps = low[None] <= bounds.high[:, axis, None]
        overlaps &= high[None] >= bounds.low[:, axis, None]
        overlaps &= seen[:, None]
        number = jnp.arange(low.shape[0], dtype=jnp.int32)
        start = jnp.min(jnp.where(overlaps, number[None], low.shape[0]), axis=1)
        stop = jnp.max(jnp.where(overlaps, number[None] + 1, 0), axis=1)
        spans += [start, jnp.maximum(stop - start, 0)]
    return Blocks(*spans)
