"""The search of a cloud: the best supported wall first, whose points leave the pool."""

__all__ = ["Candidate", "Request", "belonging", "continues", "searched"]

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from impostor_jax.clouds.cloud import Cloud
from impostor_jax.clouds.planes import Planes
from impostor_jax.clouds.proposals import Proposal, proposed
from impostor_jax.clouds.support import Support, supported, with_rays
from impostor_jax.clouds.wall import Wall

MOST_TAKEN = 0.3
"""Part of a proposal's points that may be taken already."""

LEAST_RESOLVED = 2.5
"""Radius of a wall, in spacings of the points, at least."""

MOST_AGAINST = 0.5
"""Points within a wall, and rays through it, over those on it, at most."""

MOST_TURNED = np.radians(25)
"""Typical angle between normals of a wall and those of its points, at most."""

MOST_MISFIT = 2.5
"""Scatter of the points of a wall over that of neighbors about planes, at most."""

LEAST_FILLED = 0.25
"""Part of a wall, over the arc that is seen, that has points."""

LEAST_LENGTH = 0.5
"""Of a wall, in radii."""

BESIDE = 2.0
"""Distance from a wall up to which a point belongs to it, in thrice the scatter."""

SMALLER, CLOSER = 0.7, 0.4
"""Radius and scatter of walls of parts of a wall, over its own, up to which they are
others, as the pipes of a rack are."""

MOST_TRIES = 3
"""Of walls that lead to nearly the same one, which is refused."""

NEARLY, ALONG = 0.15, np.cos(np.radians(5))
"""Difference of places and radii of walls that are nearly one, in radii, and cosine
between their axes."""

COAXIAL = np.cos(np.radians(10))
"""Cosine between the axes of pieces of one thing, at least."""

SAME_RADIUS = 0.35
"""Difference of the radii of pieces of one thing, over the larger."""


@dataclasses.dataclass(frozen=True)
class Request:
    """What is looked for.

    Attributes:
        min_points: Fewest points of a cylinder, of those that are searched.
        min_arc: Smallest angle about its axis that is seen, in radians.
        radius_range: Smallest and largest radius, in meters.
        sigma: Standard deviation of a point, in meters; None if nobody tells.
        least_sure: Confidence of what is found: it is likelier than not.
    """

    min_points: int = 60
    min_arc: float = 0.6
    radius_range: tuple[float, float] = (0.003, 1.0)
    sigma: float | None = None
    least_sure: float = 0.5


class Candidate(NamedTuple):
    """A wall that may be a cylinder, and which points belong to it.

    Attributes:
        support: What points say of it.
        own: Those on it or beside it, and on its ends.
    """

    support: Support
    own: Int[np.ndarray, " k"]


def searched(cloud: Cloud, planes: Planes, request: Request) -> list[Candidate]:
    """Walls of a cloud that may be cylinders, each with points of its own."""
    free = planes.label == 0
    least = max(request.sigma or 0.0, 1e-4 * cloud.spacing)
    found: list[Candidate] = []
    left = proposed(cloud, free, request.radius_range)
    for is_last in (False, True):
        waiting: list[Proposal] = []
        # Until points are taken the same comes of the same.
        refused: list[Support] = []
        for number, proposal in enumerate(left):
            if np.mean(~free[proposal.sample]) > MOST_TAKEN:
                continue
            if sum(_leads_to(proposal.wall, one) for one in refused) >= MOST_TRIES:
                continue
            support = supported(cloud, free, proposal.wall, least)
            if support is None:
                continue
            told = with_rays(cloud, support) if _is_likely(support, request) else None
            if told is None or told.inner + told.behind > MOST_AGAINST:
                refused.append(support)
                continue
            if not is_last and _is_of_several(told, left[number:], len(cloud)):
                waiting.append(proposal)
                continue
            own = belonging(cloud.points, told, least)
            own = own[free[own]]
            free[own] = False
            refused.clear()
            found.append(Candidate(told, own))
        left = waiting
    return found


def _leads_to(wall: Wall, support: Support) -> bool:
    """Whether a wall is so near to what another led to that it leads there, too."""
    other = support.wall
    x, y, along = other.frame @ (wall.center - other.center)
    return bool(
        abs(wall.radius - other.radius) < NEARLY * other.radius
        and support.low <= along <= support.high
        and np.hypot(x, y) < NEARLY * other.radius
        and abs(wall.frame[2] @ other.frame[2]) > ALONG
    )


def _is_of_several(support: Support, others: list[Proposal], num_points: int) -> bool:
    """Whether a wall is one around smaller ones, each of which fits far closer."""
    on = np.zeros(num_points, bool)
    on[support.on] = True
    inside = np.mean(on[[one.sample for one in others]], axis=1) > 1 - MOST_TAKEN
    walls = [one.wall for one, is_in in zip(others, inside, strict=True) if is_in]
    smaller = [
        wall.radius < SMALLER * support.wall.radius
        and wall.scatter < CLOSER * support.wall.scatter
        for wall in walls
    ]
    return len(smaller) > 0 and bool(np.mean(smaller) > 0.5)


def _is_likely(support: Support, request: Request) -> bool:
    wall = support.wall
    low, high = request.radius_range
    return bool(
        low <= wall.radius <= high
        and wall.radius >= LEAST_RESOLVED * support.spacing
        and len(support.on) >= request.min_points
        and support.arc >= request.min_arc
        and support.length >= LEAST_LENGTH * wall.radius
        and support.inner <= MOST_AGAINST
        and support.turned <= MOST_TURNED
        and support.filled >= LEAST_FILLED
        and support.misfit <= MOST_MISFIT
        and wall.is_known
    )


def belonging(
    points: Float[np.ndarray, "n 3"], support: Support, least: float
) -> Int[np.ndarray, " k"]:
    """Points on a wall or near it between its ends, or on its ends."""
    wall = support.wall
    near = BESIDE * 3 * max(wall.scatter, least)
    along = (points - wall.center) @ wall.frame[2]
    off = wall.off(points)
    between = (along > support.low - near) & (along < support.high + near)
    at_end = (
        np.minimum(np.abs(along - support.low), np.abs(along - support.high)) < near
    )
    return np.flatnonzero(between & ((np.abs(off) < near) | ((off < 0) & at_end)))


def continues(first: Support, other: Support) -> bool:
    """Whether a wall goes on where another ends, as a stem that tapers or bends."""
    one, two = first.wall, other.wall
    if abs(one.frame[2] @ two.frame[2]) < COAXIAL:
        return False
    larger = max(one.radius, two.radius)
    if abs(one.radius - two.radius) > SAME_RADIUS * larger:
        return False
    middle = two.center + two.frame[2] * (other.low + other.high) / 2
    nearest = np.clip((middle - one.center) @ one.frame[2], first.low, first.high)
    beside = one.center + one.frame[2] * nearest
    ends = two.center + np.outer([other.low, other.high], two.frame[2])
    nearer = ends[np.argmin(np.linalg.norm(ends - beside, axis=1))]
    return bool(np.linalg.norm(one.across(nearer[None])) < larger)
