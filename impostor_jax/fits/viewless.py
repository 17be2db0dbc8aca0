"""Points of which nobody tells where they were seen from, as a merged cloud.

Parallel rays across the axis stand for it: to the half of the wall that faces most
points from outside, to the other from the axis. A scan from one place errs along them.
So do two from opposite sides, of which the points face none more than the other: there
the direction is that in which points scatter most about the wall. Across it, of two
scans of a stem, a radius was 32 deviations off.
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

ROUNDS = 3
"""Times that points near the wall tell how they scatter about it, and that which are
near."""

MOST_UNEVEN = 2.0
"""Scatter where rays are steep, over that all around, up to which it is believed: of
errors along rays alone it is 1.7 times as large. What is beyond three of the latter
alone is no outlier there, and without it a radius was a deviation too small."""

FACES = 0.6
"""Length of the mean of the normals at the points, from which on they face one side:
of the half of a wall it is .64, of more of it less."""

AHEAD = 3.0
"""Distance of the places that stand for a viewpoint from the axis, in radii."""

RIM = 0.01
"""Part of the height by which the wall of a start goes on beyond the outermost points
at each end."""

BESIDE = 5.0
"""Times `MOST_OFF` within which points off a wall tell how many are near by chance."""

SECTORS = 12
"""Parts about the axis, and along it, in which they are counted."""

LEAST = 0.01
"""Length of a ray that begins inside, in radii: one without length has no direction."""


class Viewless(NamedTuple):
    """What stands for a viewpoint.

    Attributes:
        toward: Unit vector along all rays.
        starts: Where each point's ray begins.
        is_near: Which points lie near the wall.
        start: The wall between its outermost points, to begin a fit with.
    """

    toward: Float[np.ndarray, "3"]
    starts: Float[np.ndarray, "n 3"]
    is_near: Bool[np.ndarray, " n"]
    start: Cylinder


def seen_across(points: Float[np.ndarray, "n 3"], wall: Wall) -> Viewless:
    """Rays across a wall's axis to points near it."""
    off = wall.off(points)
    is_near = np.abs(off) <= MOST_OFF * wall.scatter
    across = wall.across(points)
    normal = across / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
    side = _side(normal[is_near], off[is_near])
    # The part of its variance that a distance from the wall has of errors along rays.
    steep = (normal @ side) ** 2
    parts = np.stack([steep, 1 - steep], axis=1)
    scatter = np.full_like(off, wall.scatter)
    for _ in range(ROUNDS):
        of_both, *_ = np.linalg.lstsq(parts[is_near], off[is_near] ** 2, rcond=None)
        scatter = np.sqrt(np.maximum(parts @ of_both, 0))
        scatter = np.clip(scatter, wall.scatter, MOST_UNEVEN * wall.scatter)
        is_near = np.abs(off) <= MOST_OFF * scatter
    is_beside = ~is_near & (np.abs(off) <= BESIDE * MOST_OFF * scatter)
    is_near &= _is_dense(points, wall, is_near, is_beside)
    toward = -wall.frame[:2].T @ side
    depth = (points - wall.center) @ toward
    inside = np.maximum(depth, LEAST * wall.radius)
    back = np.where(depth < 0, AHEAD * wall.radius, inside)
    along = (points[is_near] - wall.center) @ wall.frame[2]
    # Two rings would lie on the rims, and be beyond them by rounding.
    low, high = along.min(), along.max()
    low, high = low - RIM * (high - low), high + RIM * (high - low)
    start = Cylinder(
        wall.center + wall.frame[2] * (low + high) / 2,
        wall.frame[2],
        wall.radius,
        max(high - low, 1e-3 * wall.radius),
    )
    starts = points - back[:, None] * toward
    return Viewless(toward, starts, is_near, start)


def _is_dense(
    points: Float[np.ndarray, "n 3"],
    wall: Wall,
    is_near: Bool[np.ndarray, " n"],
    is_beside: Bool[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Which points lie where more are near a wall than outliers are by chance.

    Beyond an arc of it a few that are near by chance have all the leverage.

    Args:
        points: All of them.
        wall: Near which some lie.
        is_near: Which of them do.
        is_beside: Which lie off it in `BESIDE` - 1 times the room.
    """
    x, y = wall.across(points).T
    along = (points - wall.center) @ wall.frame[2]
    low, high = along[is_near].min(), along[is_near].max()
    turn = (np.arctan2(y, x) / np.pi + 1) / 2
    height = (along - low) / max(high - low, np.finfo(float).tiny)
    dense = (height >= 0) & (height <= 1)
    for place in (turn, height):
        part = np.clip((place * SECTORS).astype(int), 0, SECTORS - 1)
        near, beside = (
            np.bincount(part[dense & one], minlength=SECTORS)
            for one in (is_near, is_beside)
        )
        by_chance = np.maximum(beside, beside.mean()) / (BESIDE - 1)
        dense &= (near > by_chance + 3 * np.sqrt(by_chance))[part]
    return dense


def _side(
    normal: Float[np.ndarray, "n 2"], off: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "2"]:
    """Direction across the axis from which points were seen, of unit length.

    With errors of a variance s^2 along a direction u and a^2 across it, distances from
    the wall have s^2 (n.u)^2 + a^2 (1 - (n.u)^2), with the normal n. That is linear in
    the cosine and sine of twice the angle about the axis.

    Args:
        normal: At the points.
        off: Their distances from the wall.
    """
    mean = np.mean(normal, axis=0)
    length = float(np.linalg.norm(mean))
    if length >= FACES:
        return mean / length
    x, y = normal.T
    terms = np.stack([np.ones_like(x), x * x - y * y, 2 * x * y], axis=1)
    (_, cos, sin), *_ = np.linalg.lstsq(terms, off**2, rcond=None)
    angle = np.arctan2(sin, cos) / 2
    side = np.array([np.cos(angle), np.sin(angle)])
    return side if side @ mean >= 0 else -side
