"""Triangles of heightfields: of the sheet, and of the ground below it.

As many of each cell of a grid as its bend asks for; of a function, whose bend is known
by a bound at most, cells of one size.
"""

__all__ = ["ground_of", "sheet_of"]

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from impostor_jax.io.triangles import Corners, Triangles, check_count, moved, woven
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.heightfield_grid import all_control_points


def sheet_of(field: Heightfield, tolerance: float) -> Triangles:
    """The open sheet of a single heightfield, its normals up."""
    points, index = _corners_of(field, tolerance)
    points = moved(points, field.world_from_field)
    return Triangles(points, woven(index, False, False).reshape(-1, 3))


def ground_of(
    field: Heightfield, tolerance: float, box: Float[np.ndarray, "8 3"]
) -> Triangles:
    """The ground below a heightfield, closed by sides, and a bottom below a box.

    Args:
        field: A single one.
        tolerance: Largest distance from its surface, in meters.
        box: Corners of what it has to reach below.
    """
    points, index = _corners_of(field, tolerance)
    pose = field.world_from_field
    own = moved(box, None if pose is None else pose.inverse())
    lowest = min(own[:, 1].min(), points[:, 1].min())
    bottom = lowest - (own[:, 1].max() - lowest)
    # Around the border, the way of the triangles there.
    border = np.concatenate(
        [index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]]
    )
    below = points[border]
    below[:, 1] = bottom
    middle = below.mean(axis=0, keepdims=True)
    first = len(points) + np.arange(len(border))
    a, b = border, np.roll(border, -1)
    c, d = first, np.roll(first, -1)
    center = np.full_like(c, len(points) + len(border))
    around = [np.stack(three, -1) for three in ((b, a, c), (b, c, d), (d, c, center))]
    faces = np.concatenate([woven(index, False, False).reshape(-1, 3), *around])
    return Triangles(moved(np.concatenate([points, below, middle]), pose), faces)


def _corners_of(field: Heightfield, tolerance: float) -> Corners:
    """Points of a heightfield in its own frame, and which one is where, (x, z)."""
    (x0, x1), (z0, z1) = np.asarray(field.extent, float)
    if callable(field.height):
        step = _step(field, tolerance)
        counts = [max(1.0, np.ceil(length / step)) for length in (x1 - x0, z1 - z0)]
    else:
        points = np.asarray(all_control_points(field.height, field.interpolation))
        bend = _bend(points.astype(float))
        parts = max(1.0, np.ceil(np.sqrt(bend / (8 * tolerance))))
        counts = [parts * n for n in points.shape[2:]]
    check_count(2 * counts[0] * counts[1], tolerance)
    x, z = (
        np.linspace(low, high, int(count) + 1)
        for low, high, count in zip((x0, z0), (x1, z1), counts, strict=True)
    )
    x, z = np.meshgrid(x, z, indexing="ij")
    height, *_ = field.surface(*(jnp.asarray(v, field.dtype) for v in (x, z)))
    points = np.stack([x, np.asarray(height, float), z], axis=-1)
    return Corners(points.reshape(-1, 3), np.arange(x.size).reshape(x.shape))


def _step(field: Heightfield, tolerance: float) -> float:
    """Length of a cell's sides: what bounds of slope or curvature allow.

    By the slope alone a height is off by less than it times the circumradius.
    """
    assert field.lipschitz is not None
    slope = float(field.lipschitz)
    steps = [math.sqrt(2) * tolerance / slope if slope else math.inf]
    if field.curvature is not None:
        bend = float(field.curvature)
        steps.append(2 * math.sqrt(tolerance / bend) if bend else math.inf)
    return max(steps)


def _bend(points: Float[np.ndarray, "k k rows cols"]) -> float:
    """Bound of |h_uu| + 2 |h_uv| + |h_vv| of patches, by their control points."""
    degree = points.shape[0] - 1

    def largest(values: np.ndarray) -> float:
        return np.abs(values).max() if values.size else 0.0

    mixed = degree**2 * largest(np.diff(np.diff(points, axis=0), axis=1))
    along = [largest(np.diff(points, n=2, axis=axis)) for axis in (0, 1)]
    return 2 * mixed + degree * (degree - 1) * sum(along)
