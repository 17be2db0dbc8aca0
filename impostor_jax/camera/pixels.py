"""Pixels and blocks of pixels.

Arrays are indexed `[row, col]`; the center of pixel `[row, col]` has the image
coordinates `(u, v) = (col, row)`, as in OpenCV, BOP, TUM and PCL.
"""

__all__ = ["PixelBox", "Tile"]

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int


class Tile(eqx.Module):
    """A block of pixels whose size is known when the program is compiled.

    Attributes:
        row: First row; may be traced, so that a tile moves without a new compilation.
        col: First column; likewise.
        height: Number of rows.
        width: Number of columns.
    """

    row: int | Int[Array, ""]
    col: int | Int[Array, ""]
    height: int = eqx.field(static=True)
    width: int = eqx.field(static=True)

    def pixels(self) -> tuple[Int[Array, "h w"], Int[Array, "h w"]]:
        """Rows and columns of the tile's pixels."""
        shape = (self.height, self.width)
        row = jax.lax.broadcasted_iota(jnp.int32, shape, 0) + self.row
        col = jax.lax.broadcasted_iota(jnp.int32, shape, 1) + self.col
        return row, col


class PixelBox(eqx.Module):
    """Rows and columns of a block of pixels, both ends included.

    Empty where a first exceeds its last.
    """

    first_row: int | Int[Array, ""]
    last_row: int | Int[Array, ""]
    first_col: int | Int[Array, ""]
    last_col: int | Int[Array, ""]
