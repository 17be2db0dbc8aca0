"""Area of a polygon in each pixel, and its derivative.

Grid lines cut the polygon's edges, so that each piece lies in one pixel. A piece covers
what is to its right in its row, with the sign of its step down: part of its own pixel
and all of the later ones. Summed over a closed polygon and along the rows that is the
area inside, to rounding, at a cost that grows with the perimeter.

The derivative needs no cuts (Reynolds): a pixel's area changes by what the pieces of
edge in it sweep over. It is a sparse linear map of the vertices' velocities.

References:
    The sums are those of the font rasterizers FreeType (ftgrays.c) and font-rs.
"""

__all__ = ["BLOCK", "MARGIN", "polygon_coverage", "running_sum"]

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from impostor_jax.numerics import eps, safe_divide

MARGIN = 1
"""Pixels around the image on which edges outside are put."""
BLOCK = 32
"""Length of the blocks of a running sum."""


class _Pieces(eqx.Module):
    """Pieces of the edges, three of each, and the pixels that hold them.

    Attributes:
        pixel: Index in the flattened grid with its margin.
        middle: Middle of the piece, from the left side of its pixel.
        step: How far the piece goes down.
        start_share: Weight of the edge's start in the piece's part of the edge.
        stop_share: Weight of the edge's end.
    """

    pixel: Int[Array, "3 n"]
    middle: Float[Array, "3 n"]
    step: Float[Array, "3 n"]
    start_share: Float[Array, "3 n"]
    stop_share: Float[Array, "3 n"]


def _pieces(
    start: Float[Array, "n 2"], stop: Float[Array, "n 2"], shape: tuple[int, int]
) -> _Pieces:
    """Cut edges (x, y), whose coordinates count from the corner of the grid."""
    below, above = jnp.floor(start), jnp.floor(stop)
    crosses = below != above
    line = jnp.where(crosses, jnp.maximum(below, above), stop)
    t = jnp.where(crosses, safe_divide(line - start, stop - start), 1)
    # Where the edge crosses the line of the other coordinate. On its own line a cut has
    # the line's coordinate exactly, so that the steps of a row add up to whole numbers.
    other = t[:, ::-1]
    at = jnp.where(other < 1, start + other * (stop - start), stop)
    is_first = t < other
    cuts = jnp.stack(
        [start, jnp.where(is_first, line, at), jnp.where(is_first, at, line), stop]
    )
    first, second = jnp.minimum(t[:, 0], t[:, 1]), jnp.maximum(t[:, 0], t[:, 1])
    place = jnp.stack([jnp.zeros_like(first), first, second, jnp.ones_like(first)])
    middle = (cuts[1:] + cuts[:-1]) / 2
    last = jnp.array([shape[1] - 2, shape[0] - 1], start.dtype)
    cell = jnp.clip(jnp.floor(middle), 0, last[None, None])
    share = place[1:] - place[:-1]
    stop_share = share * (place[1:] + place[:-1]) / 2
    return _Pieces(
        pixel=cell[..., 1].astype(int) * shape[1] + cell[..., 0].astype(int),
        middle=(middle - cell)[..., 0],
        step=cuts[1:, :, 1] - cuts[:-1, :, 1],
        start_share=share - stop_share,
        stop_share=stop_share,
    )


def _edges(
    vertices: Float[Array, "n 2"], height: int, width: int
) -> tuple[Float[Array, "n 2"], Float[Array, "n 2"], tuple[int, int]]:
    """Starts and ends of the edges, and the shape of the grid with its margin.

    The grid has one column more, for what a piece in the last one covers later.
    """
    shape = (height + 2 * MARGIN, width + 2 * MARGIN + 1)
    size = jnp.array([shape[1] - 1, shape[0]], vertices.dtype)
    start = jnp.clip(vertices + (0.5 + MARGIN), 0, size[None])
    return start, jnp.roll(start, -1, axis=0), shape


@partial(jax.custom_jvp, nondiff_argnums=(1, 2))
def polygon_coverage(
    vertices: Float[Array, "n 2"], height: int, width: int
) -> Float[Array, "{height} {width}"]:
    """Part of each pixel that a polygon covers, in [0, 1].

    Args:
        vertices: Image coordinates (u, v), in pixels, counterclockwise as one sees them
            (v counts downwards).
        height: Number of rows of the image.
        width: Number of columns.

    Returns:
        Exact areas as long as every edge in the image crosses at most one grid line in
        each direction, which those no longer than a pixel do. Anything may lie outside.

    Derivatives:
        Exact, of first order, in the vertices.
    """
    start, stop, shape = _edges(vertices, height, width)
    pieces = _pieces(start, stop, shape)
    later = pieces.step * pieces.middle
    pixel = jnp.stack([pieces.pixel, pieces.pixel + 1])
    sums = jnp.zeros(shape[0] * shape[1], vertices.dtype)
    sums = sums.at[pixel].add(jnp.stack([pieces.step - later, later]))
    covered = _image(running_sum(sums.reshape(shape)))
    # Steps that cancel leave a rounding where no edge passes.
    whole = jnp.round(covered)
    near_whole = jnp.abs(covered - whole) < eps(covered.dtype, 64)
    return jnp.clip(jnp.where(near_whole, whole, covered), 0, 1)


@polygon_coverage.defjvp
def _polygon_coverage_jvp(height, width, primals, tangents):
    (vertices,), (moved,) = primals, tangents
    covered = polygon_coverage(vertices, height, width)
    start, stop, shape = _edges(vertices, height, width)
    pieces = _pieces(start, stop, shape)
    # What an edge sweeps over, per share of its length, as its ends move.
    step = stop - start
    across = jnp.stack([-step[:, 1], step[:, 0]], axis=1)
    start_swept = jnp.sum(moved * across, axis=1)
    stop_swept = jnp.sum(jnp.roll(moved, -1, axis=0) * across, axis=1)
    swept = (
        pieces.start_share * start_swept[None] + pieces.stop_share * stop_swept[None]
    )
    change = jnp.zeros(shape[0] * shape[1], swept.dtype).at[pieces.pixel].add(swept)
    return covered, _image(change.reshape(shape))


def _image(grid: Array) -> Array:
    return grid[MARGIN:-MARGIN, MARGIN : -MARGIN - 1]


def running_sum(values: Float[Array, "*batch n"]) -> Float[Array, "*batch n"]:
    """Sums of the values up to each one, along the last axis.

    By products with triangles of ones, in blocks: `jnp.cumsum` has six kernels to
    compile, this has two.
    """
    length = values.shape[-1]
    count = -(-length // BLOCK)
    before = [(0, 0)] * (values.ndim - 1)
    blocks = jnp.pad(values, [*before, (0, count * BLOCK - length)])
    blocks = blocks.reshape(*values.shape[:-1], count, BLOCK)
    triangle = np.triu(np.ones((BLOCK, BLOCK), values.dtype))
    within = jnp.matmul(blocks, triangle, precision="highest")
    triangle = np.triu(np.ones((count, count), values.dtype), 1)
    earlier = jnp.matmul(within[..., -1], triangle, precision="highest")
    sums = within + earlier[..., None]
    return sums.reshape(*values.shape[:-1], -1)[..., :length]
