"""What stands out of a wall through its middle, as a box's edge does.

What is in front of a wall hides it, and says nothing against it. But that begins with a
jump in depth: where readings rise from the wall without one, and fall back to it on the
other side, they are of the same surface, and that is no cylinder.
"""

__all__ = ["bulging"]

import numpy as np

from impostor_jax.find.evidence import INNER, LIMIT, Evidence, Scene, meeting, ring
from impostor_jax.fit.regions import CROSS
from impostor_jax.opencv import cv2

RISING = 2 * LIMIT
"""Deviations up to which a reading beside the wall rises from it, and does not jump."""

LEAST_RISING = 0.7
"""Part of the places where what is in front meets the wall at which it rises."""

LEAST_ASIDE = 0.15
"""Pixels of the wall to either side, around the axis, over those in front: beside what
touches a can, or what its wall seems to go on behind, there are some to one side, and
to none beside a hoop."""

FEWEST = 6
"""Places where it meets the wall, at least."""


def bulging(scene: Scene, evidence: Evidence) -> float:
    """Part of what is seen of a wall, between its ends, that stands out of it."""
    view, wall, (low, high) = scene.view, evidence.wall, evidence.ends
    box = view.box_around(ring(wall, evidence.ends, 1.05))
    if box is None or wall.side < 0:
        # In a tunnel things lie on its floor.
        return 0.0
    met = meeting(view, view.x[box], view.y[box], wall)
    seen = met.hit & (met.along > low) & (met.along < high) & (met.inside > INNER)
    seen &= scene.usable[box]
    depth = np.where(seen, met.depth, 1)
    deviation = view.deviation(depth, scene.noise * view.sigma[box], met.cosine)
    off = (view.depth[box] - depth) / deviation
    on = seen & (np.abs(off) < LIMIT)
    front = seen & scene.free[box] & (off < -LIMIT)
    count, label = cv2.connectedComponents(front.view(np.uint8), connectivity=4)
    if count == 1:
        return 0.0
    # How many neighbors of each pixel are on the wall.
    around = np.pad(on, 1).view(np.uint8)
    meets = cv2.filter2D(around, -1, CROSS)[1:-1, 1:-1][front]
    of, rises = label[front], off[front] > -RISING
    number, rising = (np.bincount(of, x, count) for x in (meets, meets * rises))
    stands = ((number >= FEWEST) & (rising > LEAST_RISING * number))[label]
    if not stands.any():
        return 0.0
    out = view.lifted(view.x[box], view.y[box], depth) - wall.center
    out = out - (out @ wall.axis)[..., None] * wall.axis
    ahead = out[seen].mean(axis=0)
    turn = np.arctan2(out @ np.cross(wall.axis, ahead), out @ ahead)
    bottom, top = np.quantile(met.along[stands], (0.1, 0.9))
    left, right = np.quantile(turn[stands], (0.05, 0.95))
    beside = turn[on & (met.along > bottom) & (met.along < top)]
    aside = np.count_nonzero(beside < left), np.count_nonzero(beside > right)
    bulge = np.count_nonzero(stands)
    if min(aside) < LEAST_ASIDE * bulge:
        return 0.0
    return bulge / (bulge + np.count_nonzero(on))
