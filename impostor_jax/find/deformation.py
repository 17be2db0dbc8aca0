"""Departures of a surface from a cylinder: a cone, a ball, a box's edge, a bend.

Distances from a wall are fitted by what no cylinder gives: growth along the axis, a
barrel, an ellipse, a bend. Each comes with its standard deviation, so that what the
image leaves open is told from what it refutes.
"""

__all__ = ["Deformation", "Wall", "bending", "deformation", "wall_readings"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from impostor_jax.find.evidence import LIMIT, Evidence, Scene
from impostor_jax.fit.regions import SQUARE
from impostor_jax.fit.seam import (
    ALONG,
    FACING,
    FEWEST,
    WITHIN,
    about_axis,
    best_split,
    departures,
    solved,
    wall_terms,
)
from impostor_jax.opencv import cv2

PRICE = 30.0
"""Of a second cylinder, in chi-squared: five numbers more, at many places."""

ALL_AROUND = 0.5
"""Length of the mean of the directions out of a wall, below which these go all around:
of those over half a turn it is 0.64."""


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
        return wall_terms(self.place, self.out, axis)

    def ahead(
        self, axis: Float[np.ndarray, "3"]
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "2 n"]] | None:
        """Mean direction out of it, and places aside of the axis and along that.

        Over the radius. None where the directions go all around.
        """
        forward = self.out.mean(axis=0)
        length = np.linalg.norm(forward)
        if length < ALL_AROUND:
            return None
        forward /= length
        place = self.out * (1 + self.miss)[:, None]
        return forward, np.stack([place @ np.cross(axis, forward), place @ forward])


def wall_readings(scene: Scene, evidence: Evidence) -> Wall | None:
    """The readings that tell of a wall's shape; None where they are too few."""
    view, (center, axis, radius, side, _) = scene.view, evidence.wall
    index = _within(scene, evidence)
    points = view.points.reshape(-1, 3)[index]
    along, distance, out = about_axis(points, center, axis)
    cosine = -(out * view.views.reshape(-1, 3)[index]).sum(axis=1)
    middle = (evidence.ends[0] + evidence.ends[1]) / 2
    half = max((evidence.ends[1] - evidence.ends[0]) / 2, 1e-9)
    place = (along - middle) / half
    told = (side * cosine > FACING) & (np.abs(place) < ALONG)
    told &= np.abs(distance - radius) < WITHIN * radius
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
    found = wall.ahead(axis)
    if found is None:
        return np.inf
    _, (aside, ahead) = found
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
    terms = departures(wall.place, wall.out, axis)
    found = solved(terms, wall.miss, wall.deviation)
    deviation = wall.deviation * found.scatter
    kept = np.abs(wall.miss) < 2 * LIMIT * deviation
    rows = np.column_stack([terms, wall.miss])[kept] / deviation[kept, None]
    split, price, seam = best_split(wall.place[kept], rows), PRICE * shared, None
    if split and min(split.alone - 2 * price, split.smooth) - split.halves >= price:
        seam = wall.middle + wall.half * split.place
    return Deformation(found.value[5:], np.sqrt(shared) * found.deviation[5:], seam)


def _within(scene: Scene, evidence: Evidence) -> np.ndarray:
    """Pixels that a wall explains, but for those beside others."""
    index = evidence.pixels
    # Where only some were looked at, none has a neighbor.
    if evidence.share == 1:
        explained = np.zeros(scene.view.depth.shape, np.uint8)
        explained.ravel()[index] = 1
        inner = np.flatnonzero(cv2.erode(explained, SQUARE))
        if len(inner) >= min(FEWEST, len(index) / 4):
            index = inner
    return index[:: max(1, len(index) // 2000)]
