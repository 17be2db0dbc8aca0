"""Points of which nobody tells where they were seen from, as a merged cloud.

Parallel rays across the axis stand for it: to the half of the wall that faces most
points from outside, to the other from the axis. A scan from one place errs along them.
What errs in all directions, as the scans of several places together, errs across them
as much, and that is learned: errors that are taken for alike in all directions shrink
the radius of a scan from one place, by ten times what is left then.
"""

__all__ = ["Viewless", "seen_across"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.clouds.wall import Wall
from impostor_jax.primitives.cylinder import Cylinder

MOST_OFF = 3.0
"""Robust standard deviations from the wall beyond which a point is of a branch, a cap
or nothing: where branches begin a stem is wider, and 5 took 4 % more of a spruce's."""

AHEAD = 3.0
"""Distance of the places that stand for a viewpoint from the axis, in radii."""

LEAST = 0.01
"""Length of a ray that begins inside, in radii: one without length has no direction."""


class Viewless(NamedTuple):
    """What stands for a viewpoint.

    Attributes:
        starts: Where each point's ray begins.
        is_near: Which points lie near the wall.
        start: The wall between its outermost points, to begin a fit with.
    """

    starts: Float[np.ndarray, "n 3"]
    is_near: Bool[np.ndarray, " n"]
    start: Cylinder


def seen_across(points: Float[np.ndarray, "n 3"], wall: Wall) -> Viewless:
    """Rays across a wall's axis to points near it."""
    is_near = np.abs(wall.off(points)) <= MOST_OFF * wall.scatter
    across = wall.across(points)
    # Most points lie on the half that faces the rays.
    side = np.mean(across[is_near], axis=0)
    toward = -wall.frame[:2].T @ (side / max(np.linalg.norm(side), 1e-300))
    if not np.any(side):
        toward = wall.frame[0]
    depth = (points - wall.center) @ toward
    inside = np.maximum(depth, LEAST * wall.radius)
    back = np.where(depth < 0, AHEAD * wall.radius, inside)
    along = (points[is_near] - wall.center) @ wall.frame[2]
    low, high = along.min(), along.max()
    start = Cylinder(
        wall.center + wall.frame[2] * (low + high) / 2,
        wall.frame[2],
        wall.radius,
        max(high - low, 1e-3 * wall.radius),
    )
    return Viewless(points - back[:, None] * toward, is_near, start)
