"""A point cloud as files hold it, and what is checked of all of them."""

__all__ = ["SUFFIXES", "TEXT_SUFFIXES", "PointCloud", "cloud_of"]

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

TEXT_SUFFIXES = (".xyz", ".txt", ".csv", ".asc", ".pts")
"""Endings of files of columns of numbers."""

SUFFIXES = (".ply", ".pcd", ".las", ".laz", ".npy", *TEXT_SUFFIXES)
"""Endings of all files of points that are read."""


class PointCloud(NamedTuple):
    """The points of a file.

    Attributes:
        points: In meters and double precision, in the order and the frame of the file.
        origin: Where the sensor stood, in meters and in the same frame: one position,
            or that of each point. None where the file does not say.
    """

    points: Float[np.ndarray, "n 3"]
    origin: Float[np.ndarray, "3"] | Float[np.ndarray, "n 3"] | None = None


def cloud_of(points: Any, origin: Any, scale: float, what: str) -> PointCloud:
    """The cloud of what a file holds, without the points that are missing.

    Args:
        points: (n, 3), in the file's unit; one that is not finite is missing, as where
            a depth camera had no reading.
        origin: (3,), (n, 3) or None, in the file's unit.
        scale: Meters a unit.
        what: Names the file in errors.

    Raises:
        ValueError: No point is left, or an origin is not finite.
    """
    points = np.asarray(points, float) * scale
    is_there = np.isfinite(points).all(axis=1)
    if not is_there.any():
        raise ValueError(f"{what} must hold points, got none of {len(points)} rows")
    if origin is not None:
        origin = np.asarray(origin, float) * scale
        origin = origin if origin.ndim == 1 else origin[is_there]
        if not np.isfinite(origin).all():
            raise ValueError(f"{what} must hold finite positions of the sensor")
    return PointCloud(points[is_there], origin)
