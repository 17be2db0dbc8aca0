"""Meshes of triangles, and the grids of corners that they are woven from."""

__all__ = [
    "Corners",
    "Faces",
    "Points",
    "Triangles",
    "check_count",
    "compact",
    "merged",
    "moved",
    "woven",
]

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from impostor_jax.geometry.frames import RigidTransform

MOST_TRIANGLES = 10**7
"""Of a shape; more would take gigabytes."""

Points = Float[np.ndarray, "n 3"]
Faces = Int[np.ndarray, "m 3"]


class Triangles(NamedTuple):
    """A mesh.

    Attributes:
        vertices: In meters.
        faces: Corners of each triangle, counterclockwise as seen from outside.
    """

    vertices: Points
    faces: Faces


class Corners(NamedTuple):
    """Points of a surface, and which one is where in a grid."""

    points: Points
    grid: Int[np.ndarray, "k n"]


def check_count(count: float, tolerance: float) -> None:
    """Raise a `ValueError` where a shape would have too many triangles."""
    if count > MOST_TRIANGLES:
        raise ValueError(
            f"tolerance must be larger, in meters, got {tolerance:.3g}: a shape would "
            f"have {count:.3g} triangles, and {MOST_TRIANGLES} are the most"
        )


def woven(
    index: Int[np.ndarray, "k n"], closes_turn: bool, closes_profile: bool
) -> Int[np.ndarray, "rows cols 2 3"]:
    """Two triangles of each cell of a grid of corners; at a tip one has no area."""
    if closes_turn:
        index = np.concatenate([index, index[:, :1]], axis=1)
    if closes_profile:
        index = np.concatenate([index, index[:1]])
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    return np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2)


def compact(points: Points, faces: Faces) -> Triangles:
    """Without triangles of fewer than three corners, and without points of none."""
    spans = np.all(faces != np.roll(faces, 1, axis=1), axis=1)
    used, faces = np.unique(faces[spans], return_inverse=True)
    return Triangles(points[used], faces.reshape(-1, 3))


def merged(points: Points, faces: Faces, width: float) -> Triangles:
    """With one point for all that are in one place, to a width; 0 is exactly."""
    places = np.round(points / width) if width else points
    # 0 and -0 are one place.
    _, kept, number = np.unique(
        places + 0.0, axis=0, return_index=True, return_inverse=True
    )
    return Triangles(points[kept], number.reshape(-1)[faces])


def moved(points: Points, transform: RigidTransform | None) -> Points:
    """Points in another frame, in double precision."""
    if transform is None:
        return points
    rotation = np.asarray(transform.rotation, float)
    return points @ rotation.T + np.asarray(transform.translation, float)
