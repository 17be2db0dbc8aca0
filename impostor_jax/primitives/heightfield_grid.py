"""A grid of heights as Bézier patches, and the range of heights of every block of them.

Between four samples both interpolations are Bézier patches: of degree 1 (bilinear) or 3
(bicubic, Catmull-Rom). A patch stays between its smallest and its largest control
point, which a bicubic surface needs: it leaves the range of its samples. So does each
second derivative, whose control points are differences of those of the patch.
"""

__all__ = [
    "INTERPOLATIONS",
    "Indices",
    "MaximumMipmap",
    "all_control_points",
    "control_points",
    "largest_curvature",
    "relief",
    "surface",
]

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from impostor_jax.numerics import Numbers

Indices = Int[Array, "*batch"]

INTERPOLATIONS = {
    "bilinear": np.eye(2),
    "bicubic": np.array([[0, 6, 0, 0], [-1, 6, 1, 0], [0, 1, 6, -1], [0, 0, 6, 0]]) / 6,
}
"""Control points of a segment, from the two or four samples around it.

Those of the second are by Catmull and Rom. Beyond its border a grid is continued so
that the slope there is that of the first segment.
"""


def control_points(
    grid: Float[Array, "n m"],
    interpolation: str,
    i: Indices,
    j: Indices,
) -> Float[Array, "k k *batch"]:
    """Control points of the patches between samples i, j and i + 1, j + 1."""
    matrix = INTERPOLATIONS[interpolation]
    count = len(matrix)
    near = jnp.arange(count, dtype=i.dtype).reshape((-1,) + (1,) * i.ndim)
    if count > 2:
        grid = jnp.pad(grid, 1, mode="reflect", reflect_type="odd")
    samples = grid[(i[None] + near)[:, None], (j[None] + near)[None]]
    change = jnp.asarray(matrix, grid.dtype)
    return jnp.einsum(
        "ap,bq,pq...->ab...", change, change, samples, precision="highest"
    )


def all_control_points(
    grid: Float[Array, "n m"], interpolation: str
) -> Float[Array, "k k rows cols"]:
    """Control points of every patch, rows = n - 1 by cols = m - 1 of them."""
    rows, cols = grid.shape[0] - 1, grid.shape[1] - 1
    i, j = jnp.meshgrid(jnp.arange(rows), jnp.arange(cols), indexing="ij")
    return control_points(grid, interpolation, i, j)


def relief(
    grid: Float[Array, "*batch n m"], interpolation: str
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Lowest and highest control point of each grid: the surface is between them."""

    def ends(grid: Float[Array, "n m"]) -> tuple[Array, Array]:
        points = all_control_points(grid, interpolation).ravel()
        # Taken by their places, so that the derivative is one of theirs.
        return points[jnp.argmin(points)], points[jnp.argmax(points)]

    return jnp.vectorize(ends, signature="(n,m)->(),()")(grid)


def surface(
    points: Float[Array, "k k *batch"], u: Numbers, v: Numbers
) -> tuple[Numbers, Numbers, Numbers]:
    """Height of a patch at (u, v) in [0, 1]^2, and its derivatives in u and v."""
    degree = points.shape[0] - 1
    at_u, slope_u = _basis(u, degree)
    at_v, slope_v = _basis(v, degree)
    across = jnp.sum(points * at_v[None], axis=1)
    height, by_u = jnp.sum(across * at_u, axis=0), jnp.sum(across * slope_u, axis=0)
    by_v = jnp.sum(jnp.sum(points * slope_v[None], axis=1) * at_u, axis=0)
    return height, by_u, by_v


def _basis(t: Numbers, degree: int) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Bernstein polynomials at t, (degree + 1, *batch), and their derivatives."""
    s, one = 1 - t, jnp.ones_like(t)
    if degree == 1:
        return jnp.stack([s, t]), jnp.stack([-one, one])
    values = jnp.stack([s * s * s, 3 * s * s * t, 3 * s * t * t, t * t * t])
    middle = s * (s - 2 * t), t * (2 * s - t)
    return values, 3 * jnp.stack([-s * s, *middle, t * t])


def largest_curvature(
    points: Float[Array, "k k *batch"], p: Numbers, q: Numbers
) -> Float[Array, "*batch"]:
    """Upper bound of the patch's second derivative along (p, q).

    Exact where the patch is bilinear: then it is 2 p q times one number.
    """
    degree = points.shape[0] - 1
    by_u, by_v = jnp.diff(points, axis=0), jnp.diff(points, axis=1)
    mixed = degree**2 * jnp.diff(by_u, axis=1)
    twice = 2 * p * q
    curvature = jnp.maximum(
        twice * jnp.max(mixed, axis=(0, 1)), twice * jnp.min(mixed, axis=(0, 1))
    )
    if degree > 1:
        along_u = jnp.max(jnp.diff(by_u, axis=0), axis=(0, 1))
        along_v = jnp.max(jnp.diff(by_v, axis=1), axis=(0, 1))
        curvature += degree * (degree - 1) * (along_u * p * p + along_v * q * q)
    return curvature


class MaximumMipmap(eqx.Module):
    """Highest control point of every block of 2^level by 2^level patches.

    Attributes:
        tops: All levels one after the other, row by row; then those of the blocks
            upside down, whose tops are minus the lowest control points.
        shapes: Number of rows and columns of blocks at each level; the last is (1, 1).
    """

    tops: Float[Array, " blocks"]
    shapes: tuple[tuple[int, int], ...] = eqx.field(static=True)

    @staticmethod
    def of(points: Float[Array, "k k rows cols"]) -> "MaximumMipmap":
        """Merge the patches two by two until one block is left."""
        levels = [jnp.stack([jnp.max(p, axis=(0, 1)) for p in (points, -points)])]
        while levels[-1].shape[1:] != (1, 1):
            levels.append(_merged(levels[-1]))
        flat = jnp.concatenate([level.reshape(2, -1) for level in levels], axis=1)
        shapes = tuple((level.shape[1], level.shape[2]) for level in levels)
        return MaximumMipmap(tops=flat.ravel(), shapes=shapes)

    def shape(self, level: Indices) -> tuple[Indices, Indices]:
        """Number of rows and columns of blocks at a level."""
        rows, cols = self.shapes[0]
        return (
            jnp.right_shift(rows - 1, level) + 1,
            jnp.right_shift(cols - 1, level) + 1,
        )

    def top(self, level: Indices, i: Indices, j: Indices, side: Numbers) -> Numbers:
        """Highest point of a block; where `side` is -1, of the block upside down."""
        sizes = [rows * cols for rows, cols in self.shapes]
        start = np.cumsum([0, *sizes[:-1]], dtype=np.int32)
        _, cols = self.shape(level)
        k = jnp.asarray(start)[level] + i * cols + j
        return self.tops[jnp.where(side > 0, k, k + sum(sizes))]


def _merged(tops: Float[Array, "2 rows cols"]) -> Float[Array, "2 _ _"]:
    _, rows, cols = tops.shape
    padding = ((0, 0), (0, rows % 2), (0, cols % 2))
    tops = jnp.pad(tops, padding, constant_values=-np.inf)
    parts = tops.reshape(2, (rows + 1) // 2, 2, (cols + 1) // 2, 2)
    return jnp.max(parts, axis=(2, 4))
