"""What points say of a wall: how far it goes, and what speaks against it.

A wall goes on along its axis as long as it is as dense as elsewhere, over gaps of a few
radii, as of an occluder. Points within it, and rays that pass through it to what lies
behind, say that nothing is there.
"""

__all__ = ["Support", "is_on", "supported", "with_rays"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.clouds.cloud import Cloud
from impostor_jax.clouds.wall import Wall, refined_walls
from impostor_jax.primitives.cylinder import Cylinder

NEAR = 3.0
"""Robust standard deviations from a wall up to which a point is on it."""

TURNED = np.cos(np.radians(35))
"""Cosine between the normal of a wall and that of a point on it, at least."""

BIN = 0.25
"""Length along the axis in which points are counted, in radii; at least 2 spacings."""

FULL = 0.25
"""Of the typical number of points of a bin, from which it is full."""

GAP = 3.0
"""Length of a gap that a wall goes on behind, in radii."""

SECTORS = 36
"""Parts of a turn in which an arc is counted."""

CORE = 0.7
"""Part of the radius within which nothing is of a wall."""

MOST_SWAYED, MOST_TILTED = 0.5, 0.2
"""Change of a radius or a place by its fits, in radii, and slope of its axis to what it
was, at most."""

ROUNDS = 3
"""Times that a wall is fitted to all points on it and its ends are found."""

MOST_POINTS = 4000
"""Points of a wall that it is fitted to."""

MOST_RAYS = 60_000
"""Rays that are asked whether they go through it."""


class Support(NamedTuple):
    """A wall, and what points say of it.

    Attributes:
        wall: Fitted to all points on it; its center is where it was proposed.
        low: Where it ends along its axis, from the center, in meters.
        high: Where it ends on the other side.
        on: Points on it.
        arc: Angle about the axis over which there are any, in radians.
        filled: Part of the cells of that arc, between the ends, in which there are, of
            those that as many points, evenly spread, are in.
        inner: Points within it, over those on it.
        behind: Rays through it, over those to it, of `with_rays`; 0 where nobody tells
            of rays.
        turned: Typical angle between its normals and those of the points, in radians.
        spacing: Typical distance of its points from their neighbors, in meters.
        misfit: Scatter of its points over that of neighbors about their planes.
        is_inside: Whether it is seen from inside, where somebody tells.
    """

    wall: Wall
    low: float
    high: float
    on: Int[np.ndarray, " k"]
    arc: float
    filled: float
    inner: float
    behind: float
    turned: float
    spacing: float
    misfit: float
    is_inside: bool

    def moved(self, by: Float[np.ndarray, "3"]) -> "Support":
        """The same in another frame, whose origin lies so far away."""
        return self._replace(wall=self.wall._replace(center=self.wall.center + by))

    @property
    def start(self) -> Cylinder:
        """The cylinder between its ends."""
        axis = self.wall.frame[2]
        middle = self.wall.center + axis * (self.low + self.high) / 2
        return Cylinder(middle, axis, self.wall.radius, self.length)

    @property
    def visible(self) -> float:
        """Part of the wall that has points."""
        return self.filled * min(self.arc / (2 * np.pi), 1.0)

    @property
    def length(self) -> float:
        """From end to end, in meters."""
        return self.high - self.low


def is_on(
    wall: Wall,
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    deviation: float,
) -> Bool[np.ndarray, " n"]:
    """Which points lie on a wall, and face as it does."""
    across = wall.across(points)
    distance = np.maximum(np.linalg.norm(across, axis=1), 1e-300)
    faces = np.sum((normals @ wall.frame[:2].T) * across, axis=1) / distance
    near = np.abs(distance - wall.radius) < NEAR * deviation
    return near & (np.abs(faces) > TURNED)


def supported(
    cloud: Cloud, free: Bool[np.ndarray, " n"], wall: Wall, least: float
) -> Support | None:
    """A proposed wall, grown over all free points on it; None where it comes to none.

    Args:
        cloud: The points.
        free: Which are of nothing else.
        wall: As it was proposed.
        least: Standard deviation of a point from a wall at least, in meters.
    """
    places = np.flatnonzero(free & _may_be_on(cloud, wall, least))
    low = high = 0.0
    on = places[:0]
    for number in range(ROUNDS):
        deviation = max(wall.scatter, least)
        own = is_on(wall, cloud.points[places], cloud.normals[places], deviation)
        on = places[own]
        along = (cloud.points[on] - wall.center) @ wall.frame[2]
        if not len(on):
            return None
        width = max(BIN * wall.radius, 2 * float(np.median(cloud.gaps[on])))
        ends = _ends(along, width, wall.radius)
        if ends is None:
            return None
        low, high = ends
        within = (along >= low) & (along <= high)
        on, along = on[within], along[within]
        if number == ROUNDS - 1:
            break
        some = on[:: max(1, len(on) // MOST_POINTS)]
        start = wall.frame[2][None], wall.center[None], np.array([wall.radius])
        size = np.array([max(high - low, wall.radius)])
        (refined,) = refined_walls(cloud.points[some][None], *start, size)
        if refined is None:
            return None
        # The center stays where it was along the axis.
        moved = (wall.center - refined.center) @ refined.frame[2]
        wall = refined._replace(center=refined.center + moved * refined.frame[2])
    return _told(cloud, wall, low, high, on)


def _may_be_on(cloud: Cloud, wall: Wall, least: float) -> Bool[np.ndarray, " n"]:
    """Points that may be on a wall, however it turns and moves as it is fitted."""
    x, y, along = wall.frame @ (cloud.points - wall.center).T
    off = np.abs(np.hypot(x, y) - wall.radius)
    reach = MOST_SWAYED * wall.radius + NEAR * max(wall.scatter, least)
    return off < reach + MOST_TILTED * np.abs(along)


def _ends(
    along: Float[np.ndarray, " n"], width: float, radius: float
) -> tuple[float, float] | None:
    """Where a wall ends to both sides of 0, by how dense its points are."""
    place = np.floor(along / width).astype(int)
    first = place.min()
    counts = np.bincount(place - first)
    full = counts >= max(FULL * float(np.median(counts[counts > 0])), 1)
    runs = np.flatnonzero(full)
    here = np.argmin(np.abs(runs + first))
    if abs(runs[here] + first) * width > 2 * radius + width:
        return None
    apart = np.diff(runs) > max(2, GAP * radius / width)
    part = np.concatenate([[0], np.cumsum(apart)])
    run = runs[part == part[here]] + first
    inside = (place >= run.min()) & (place <= run.max())
    return float(along[inside].min()), float(along[inside].max())


def _told(
    cloud: Cloud, wall: Wall, low: float, high: float, on: Int[np.ndarray, " k"]
) -> Support | None:
    """What points say of a wall between its ends."""
    if len(on) < 2:
        return None
    across = wall.across(cloud.points[on])
    distance = np.linalg.norm(across, axis=1)
    facing = (cloud.normals[on] @ wall.frame[:2].T) * across
    cosine = np.sum(facing, axis=1) / np.maximum(distance, 1e-300)
    angle = np.arctan2(across[:, 1], across[:, 0])
    sector = np.floor((angle / (2 * np.pi) + 0.5) * SECTORS).astype(int) % SECTORS
    counts = np.bincount(sector, minlength=SECTORS)
    seen = counts >= 0.2 * counts[counts > 0].mean()
    along = (cloud.points[on] - wall.center) @ wall.frame[2]
    spacing = float(np.median(cloud.gaps[on]))
    width = max(wall.radius / 2, 2 * spacing)
    rows = np.floor((along - low) / width).astype(int)
    own = seen[sector]
    full = len(np.unique(rows[own] * SECTORS + sector[own]))
    # Of few points that are evenly spread, as many cells have some by chance.
    cells = np.count_nonzero(seen) * (rows.max() + 1)
    filled = full / (cells * -np.expm1(-np.count_nonzero(own) / cells))
    inner = _within(cloud, wall, low, high)
    is_inside = cloud.origins is not None and float(np.mean(cosine)) < 0
    return Support(
        wall=wall,
        low=low,
        high=high,
        on=on,
        arc=2 * np.pi * np.count_nonzero(seen) / SECTORS,
        filled=min(float(filled), 1.0),
        inner=0.0 if is_inside else inner / len(on),
        behind=0.0,
        turned=float(np.arccos(np.clip(np.median(np.abs(cosine)), 0, 1))),
        spacing=spacing,
        misfit=wall.scatter / max(float(np.median(cloud.rough[on])), 1e-300),
        is_inside=bool(is_inside),
    )


def _within(cloud: Cloud, wall: Wall, low: float, high: float) -> int:
    """Points in the core of a wall, away from its ends."""
    margin = 0.1 * (high - low)
    middle = wall.center + wall.frame[2] * (low + high) / 2
    reach = np.hypot((high - low) / 2, wall.radius)
    near = cloud.tree.query_ball_point(middle, reach, return_sorted=False)
    points = cloud.points[np.asarray(near, int)]
    along = (points - wall.center) @ wall.frame[2]
    core = np.linalg.norm(wall.across(points), axis=1) < CORE * wall.radius
    return int(
        np.count_nonzero(core & (along > low + margin) & (along < high - margin))
    )


def with_rays(cloud: Cloud, support: Support) -> Support:
    """The same, and which rays pass through the core of a wall to points behind it.

    That takes longer than all else that points say.
    """
    if cloud.origins is None or support.is_inside:
        return support
    wall, low, high = support.wall, support.low, support.high
    step = max(1, len(cloud) // MOST_RAYS)
    start = (cloud.origins[::step] - wall.center) @ wall.frame.T
    ray = (cloud.points[::step] - cloud.origins[::step]) @ wall.frame.T
    (ox, oy, oz), (dx, dy, dz) = start.T, ray.T
    square = np.maximum(dx * dx + dy * dy, 1e-300)
    nearest = -(ox * dx + oy * dy) / square
    off = np.abs(ox * dy - oy * dx) / np.sqrt(square)
    place = oz + nearest * dz
    margin = 0.1 * (high - low)
    # The point lies beyond the far side of the wall.
    beyond = (1 - nearest) * np.sqrt(square) > 1.2 * wall.radius
    hits = (off < CORE * wall.radius) & (nearest > 0) & beyond
    hits &= (place > low + margin) & (place < high - margin)
    behind = step * np.count_nonzero(hits) / len(support.on)
    return support._replace(behind=float(behind))
