"""Pixels and blocks of pixels.

Arrays are indexed `[row, col]`; the center of pixel `[row, col]` has the image
coordinates `(u, v) = (col, row)`, as in OpenCV, BOP, TUM and PCL.
"""

__all__ = [
    "PixelBox",
    "Pixels",
    "Tile",
    "first_and_last",
    "linear_pixel_box",
    "strided_intrinsics",
]

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

Pixels = Int[Array, "*batch"]
"""Rows, or columns."""


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


def strided_intrinsics(camera: Any, stride: int) -> dict[str, Any]:
    """Intrinsics of every n-th row and column, from the first on.

    Args:
        camera: Has fx, fy, cx, cy, width and height.
        stride: n.
    """
    scaled = {name: getattr(camera, name) / stride for name in ("fx", "fy", "cx", "cy")}
    sizes = {name: -(-getattr(camera, name) // stride) for name in ("width", "height")}
    return scaled | sizes


def linear_pixel_box(
    camera: Any, low: Float[Array, "2"], high: Float[Array, "2"]
) -> PixelBox:
    """Block of pixels whose centers lie in a box, u = fx x + cx and v = fy y + cy.

    Args:
        camera: Has fx, fy, cx, cy, width and height.
        low: Smallest x and y of the box.
        high: Largest x and y.
    """
    size = jnp.array([camera.width, camera.height], low.dtype)
    focal = jnp.array([camera.fx, camera.fy], low.dtype)
    principal = jnp.array([camera.cx, camera.cy], low.dtype)
    # Clipped while they are floats: an integer cannot hold a far-away pixel.
    first = jnp.clip(jnp.ceil(focal * low + principal), 0, size).astype(int)
    last = jnp.clip(jnp.floor(focal * high + principal), -1, size - 1).astype(int)
    return PixelBox(first[1], last[1], first[0], last[0])


def first_and_last(seen: Bool[Array, " n"]) -> tuple[Int[Array, ""], Int[Array, ""]]:
    """First and last index that holds True; the number of all and -1 if none does."""
    index = jnp.arange(seen.shape[0])
    first = jnp.min(jnp.where(seen, index, seen.shape[0]))
    return first, jnp.max(jnp.where(seen, index, -1))
