"""Where a surface goes on though the cylinder that it was taken for ends.

A wall ends at a cap, at what stands in front, or before what is far behind it. The
surface of a bottle, an arm or a towel goes on: beyond the ends there are readings that
face as the wall would, near it and not on it.
"""

__all__ = ["NOTHING", "Continuation", "continuation"]

from typing import NamedTuple

import numpy as np

from impostor_jax.find.evidence import AGREEING, LIMIT, UNSURE, Evidence, Scene, ring

REACH = 0.4
"""How far beyond an end, and off the wall, a surface is looked for, in radii."""

LEAST_TOLD = 0.7
"""Part of that within which a reading must be known to be on the wall or off it."""

CLEAR = 2.0
"""Pixels from an end within which nothing is looked at: edges are rounded there."""

FEWEST = 10.0
"""Readings of a stretch as long as the reach, of which a part is told, at least."""


class Continuation(NamedTuple):
    """What goes on, as a part of what the wall shows.

    Attributes:
        off: Beyond the end where it is more: readings near the wall, and not on it,
            over those of as long a stretch of the wall.
        on: The same of readings that are near it or on it.
    """

    off: float
    on: float


NOTHING = Continuation(0.0, 0.0)


def continuation(scene: Scene, evidence: Evidence) -> Continuation:
    """Look for what goes on around a wall, among the readings that are free."""
    view, (center, axis, radius, side, _) = scene.view, evidence.wall
    low, high = evidence.ends
    width, more = evidence.width, REACH * radius
    reach = max(more, 3 * width)
    far = reach + CLEAR * width
    around = ring(evidence.wall, (low - far, high + far), 1 + REACH)
    box = view.box_around(around)
    if box is None:
        return NOTHING
    off = view.points[box] - center.astype(np.float32)
    along = off @ axis.astype(np.float32)
    across = off - along[..., None] * axis.astype(np.float32)
    distance = np.sqrt(np.maximum((across**2).sum(axis=-1), 1e-12))
    out = across / distance[..., None]
    cosine = np.maximum(np.abs((out * view.views[box]).sum(axis=-1)), 0.05)
    sigma = scene.noise * view.sigma[box]
    limit = LIMIT * cosine * view.deviation(view.depth[box], sigma, cosine)
    miss = np.abs(distance - radius)
    agrees = side * (scene.normals.normal[box] * out).sum(axis=-1) > AGREEING
    agrees &= scene.normals.error[box] < 2 * UNSURE
    near = scene.usable[box] & scene.free[box] & agrees
    near &= (miss < more) & (limit < LEAST_TOLD * more)
    stretch = max(evidence.explained / max(high - low, width) * reach, FEWEST)
    past = np.maximum(low - along, along - high)
    is_beyond = (past > CLEAR * width) & (past < far)
    is_low = along < low

    def most(goes_on: np.ndarray) -> float:
        of_end = is_beyond & goes_on
        counts = np.count_nonzero(of_end & is_low), np.count_nonzero(of_end & ~is_low)
        return float(max(counts) / stretch)

    return Continuation(most(near & (miss > limit)), most(near))
