"""Departures of a surface from a cylinder: a cone, a ball, a box's edge, a bend.

Distances from a wall are fitted by what no cylinder gives: growth along the axis, a
barrel, an ellipse, a bend. Each comes with its standard deviation, so that what the
image leaves open is told from what it refutes.
"""

__all__ = [
    "Deformation",
    "Wall",
    "bending",
    "deformation",
    "solved",
    "wall_readings",
]

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from impostor_jax.find.evidence import LIMIT, Evidence, Scene, directions_across
from impostor_jax.opencv import cv2

PRICE = 30.0
"""Of a second cylinder, in chi-squared: five numbers more, at many places."""

SEAM_BINS = 32
"""Places where two cylinders may meet."""

ALL_AROUND = 0.5
"""Length of the mean of the directions out of a wall, below which these go all around:
of those over half a turn it is 0.64."""

FEWEST = 20
"""Readings that it takes."""


class Deformation(NamedTuple):
    """What departs from a cylinder.

    Attributes:
        value: Over the radius, at the ends of the wall: taper, barrel, two of an
            ellipse, two of a bend.
        deviation: Their standard deviations.
        seam: Where along the axis two cylinders meet; None where there is one.
    """

    value: Float[np.ndarray, "6"]
    deviation: Float[np.ndarray, "6"]
    seam: float | None

    @property
    def vague(self) -> float:
        """Typical deviation of taper, barrel and ellipse; from 1 on nothing is told."""
        return float(np.sqrt(np.mean(self.deviation[:4] ** 2)))


class Wall(NamedTuple):
    """Readings of a wall, without those near its ends and its outline.

    Attributes:
        pixels: Flat indices of them.
        place: Along the axis, from -1 to 1.
        out: Unit vectors away from the axis.
        miss: Distances from the wall, over the radius.
        deviation: Of these.
        middle: Of the wall along its axis, in meters from its center.
        half: Half of its length, in meters.
    """

    pixels: Int[np.ndarray, " n"]
    place: Float[np.ndarray, " n"]
    out: Float[np.ndarray, "n 3"]
    miss: Float[np.ndarray, " n"]
    deviation: Float[np.ndarray, " n"]
    middle: float
    half: float

    def terms(self, axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 5"]:
        """How distances change with the radius, and with the axis at either end."""
        first, second = directions_across(axis)
        c, s = self.out @ first, self.out @ second
        return np.stack([np.ones_like(c), c, s, self.place * c, self.place * s], axis=1)


def wall_readings(scene: Scene, evidence: Evidence) -> Wall | None:
    """The readings that tell of a wall's shape; None where they are too few."""
    view, (center, axis, radius, side, _) = scene.view, evidence.wall
    index = _within(scene, evidence)
    off = view.points.reshape(-1, 3)[index] - center
    along = off @ axis
    across = off - along[:, None] * axis
    distance = np.sqrt((across**2).sum(axis=1))
    out = across / np.maximum(distance, 1e-9)[:, None]
    cosine = -(out * view.views.reshape(-1, 3)[index]).sum(axis=1)
    middle = (evidence.ends[0] + evidence.ends[1]) / 2
    half = max((evidence.ends[1] - evidence.ends[0]) / 2, 1e-9)
    place = (along - middle) / half
    # Near the ends and the outline readings are of more than one surface.
    told = (side * cosine > 0.2) & (np.abs(place) < 0.95)
    told &= np.abs(distance - radius) < 0.3 * radius
    if np.count_nonzero(told) < FEWEST:
        return None
    index, cosine = index[told], cosine[told]
    sigma = scene.noise * view.sigma.ravel()[index]
    deviation = view.deviation(view.depth.ravel()[index], sigma, cosine)
    return Wall(
        index,
        place[told],
        out[told],
        distance[told] / radius - 1,
        deviation * np.abs(cosine) / radius,
        middle,
        half,
    )


def bending(axis: Float[np.ndarray, "3"], wall: Wall, shared: float) -> float:
    """Standard deviations by which a wall is bent across its axis, and no plane.

    Infinite where it is seen from all around, as a pipe is from inside.

    Args:
        axis: Of the wall.
        wall: Its readings.
        shared: How many of them share an error.
    """
    forward = wall.out.mean(axis=0)
    length = np.linalg.norm(forward)
    if length < ALL_AROUND:
        return np.inf
    forward /= length
    place = wall.out * (1 + wall.miss)[:, None]
    aside, ahead = place @ np.cross(axis, forward), place @ forward
    aside = aside - aside.mean()
    terms = np.stack([np.ones_like(aside), aside, wall.place, aside**2], axis=1)
    found = solved(terms, ahead, wall.deviation)
    return float(abs(found.value[3]) / found.deviation[3] / np.sqrt(shared))


def deformation(axis: Float[np.ndarray, "3"], wall: Wall, shared: float) -> Deformation:
    """How far a surface is from a cylinder's, by the readings of its wall.

    Args:
        axis: Of the wall.
        wall: Its readings.
        shared: How many of them share an error.
    """
    place, own = wall.place, wall.terms(axis)
    c, s = own[:, 1], own[:, 2]
    others = [place, place**2, c * c - s * s, 2 * c * s, place**2 * c, place**2 * s]
    terms = np.column_stack([own, *others])
    found = solved(terms, wall.miss, wall.deviation)
    price = PRICE * shared
    seam = _seam(place, terms, wall.miss, wall.deviation * found.scatter, price)
    return Deformation(
        found.value[5:],
        np.sqrt(shared) * found.deviation[5:],
        None if seam is None else wall.middle + wall.half * seam,
    )


class Solution(NamedTuple):
    """Of linear equations, most of whose rows are right.

    Attributes:
        value: The unknowns.
        deviation: Of these.
        rest: What is left of each row, in deviations.
        scatter: Of that; 1 where it is less.
    """

    value: Float[np.ndarray, " m"]
    deviation: Float[np.ndarray, " m"]
    rest: Float[np.ndarray, " n"]
    scatter: float


def solved(
    terms: Float[np.ndarray, "n m"],
    miss: Float[np.ndarray, " n"],
    deviation: Float[np.ndarray, " n"],
) -> Solution:
    """Solve terms @ value = miss, with little weight for rows that are far off.

    With a prior of deviation 1, for what the rows leave open.
    """
    weight, rest = 1 / deviation, miss
    inverse, value = np.eye(terms.shape[1]), np.zeros(terms.shape[1])
    for _ in range(3):
        rows = terms * weight[:, None]
        inverse = np.linalg.inv(rows.T @ rows + np.eye(terms.shape[1]))
        value = inverse @ (rows.T @ (miss * weight))
        rest = (miss - terms @ value) / deviation
        weight = 1 / deviation / (1 + (rest / LIMIT) ** 2)
    scatter = max(1.4826 * float(np.median(np.abs(rest))), 1.0)
    return Solution(value, scatter * np.sqrt(np.diag(inverse)), rest, scatter)


def _seam(
    place: Float[np.ndarray, " n"],
    terms: Float[np.ndarray, "n 11"],
    miss: Float[np.ndarray, " n"],
    deviation: Float[np.ndarray, " n"],
    price: float,
) -> float | None:
    """Where two cylinders meet that explain the readings better than one; None if none.

    Each half gets five numbers of its own, by the normal equations of bins added up
    from either end. A cone, a ball or a bend is no two cylinders: a smooth departure
    must explain less.

    Args:
        place: Along the axis, from -1 to 1.
        terms: The five of a wall and six of smooth departures.
        miss: Distances from the wall.
        deviation: Of these.
        price: Of a second cylinder, in chi-squared.
    """
    rows = np.column_stack([terms, miss]) / deviation[:, None]
    kept = np.abs(rows[:, -1]) < 2 * LIMIT
    rows, place = rows[kept], place[kept]
    bins = ((place + 1) / 2 * SEAM_BINS).astype(int).clip(0, SEAM_BINS - 1)
    order = np.argsort(bins, kind="stable")
    rows, edges = rows[order], np.searchsorted(bins[order], np.arange(SEAM_BINS + 1))
    products = np.array([rows[a:b].T @ rows[a:b] for a, b in itertools.pairwise(edges)])
    total = products.sum(axis=0)
    wall = [*range(5), 11]

    before = np.cumsum(products[:, wall][:, :, wall], axis=0)[2:-3]
    after = total[np.ix_(wall, wall)] - before
    halves = _left_over(before) + _left_over(after)
    # Some of either side must be seen.
    counts = np.cumsum(np.diff(edges))[2:-3]
    few = np.minimum(counts, len(rows) - counts) < max(FEWEST, 0.1 * len(rows))
    halves = np.where(few, np.inf, halves)
    best = int(np.argmin(halves))
    smooth = float(_left_over(total))
    alone = float(_left_over(total[np.ix_(wall, wall)]))
    if min(alone - 2 * price, smooth) - halves[best] < price:
        return None
    return 2 * (best + 3) / SEAM_BINS - 1


def _left_over(products: Float[np.ndarray, "*b m m"]) -> Float[np.ndarray, "*b"]:
    """Chi-squared of the best solution of normal equations, whose last row is data."""
    size = products.shape[-1] - 1
    equations = products[..., :size, :size] + 1e-6 * np.eye(size)
    right = products[..., :size, size]
    solution = np.linalg.solve(equations, right[..., None])[..., 0]
    return np.asarray(products[..., size, size] - (right * solution).sum(axis=-1))


def _within(scene: Scene, evidence: Evidence) -> np.ndarray:
    """Pixels that a wall explains, but for those beside others."""
    index = evidence.pixels
    # Where only some were looked at, none has a neighbor.
    if evidence.share == 1:
        explained = np.zeros(scene.view.depth.shape, np.uint8)
        explained.ravel()[index] = 1
        inner = np.flatnonzero(cv2.erode(explained, np.ones((3, 3), np.uint8)))
        if len(inner) >= min(FEWEST, len(index) / 4):
            index = inner
    return index[:: max(1, len(index) // 2000)]
