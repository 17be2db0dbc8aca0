"""What else a surface may be: a cone, a ball or a box's edge instead of a cylinder.

Caps are told from the wall here: they stand across the axis, so that a wall that is too
short to tell its own tilt from a taper tells them apart.
"""

__all__ = ["Rivals", "rivals"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from impostor_jax.find.caps import Inner
from impostor_jax.find.deformation import Wall
from impostor_jax.find.evidence import LIMIT, Evidence, Scene
from impostor_jax.fit.seam import solved

LEAST_FACING = 0.1
"""Cosine of the incidence on a ball, at least: at its outline it tells nothing."""

STEPS = 4
"""Of Gauss and Newton, towards the best ball."""

KNEES = np.linspace(0.15, 0.85, 9)
"""Parts of a wall's readings on one side of where two planes may meet."""

LEAST_ALONG = 0.2
"""Cosine of a view and the middle direction out of a wall, at least."""

NO_EDGE = -10.0
"""Logarithm of a misfit over another's where the other is none."""


class Rivals(NamedTuple):
    """A cone, a ball and an edge, beside a cylinder.

    Attributes:
        slope: Of the wall against the axis, in radians.
        deviation: Of that.
        ball: Logarithm of the misfit of a cylinder over that of a ball.
        edge: The same over that of two planes that meet along it, of the wall alone.
    """

    slope: float
    deviation: float
    ball: float
    edge: float


def rivals(scene: Scene, evidence: Evidence, wall: Wall, cap: Inner) -> Rivals:
    """Compare a cylinder with its rivals, by the readings of wall and cap."""
    axis, radius = evidence.wall.axis, evidence.wall.radius
    n = len(wall.pixels)
    terms = np.zeros((n + len(cap.pixels), 7))
    terms[:n, :5] = wall.terms(axis)
    # As the axis turns a cap tilts, and its end may be elsewhere.
    terms[n:, 3:5], terms[n:, 5] = -cap.across * radius / wall.half, 1.0
    terms[:n, 6] = wall.place
    miss = np.concatenate([wall.miss, cap.along])
    deviation = np.concatenate([wall.deviation, cap.deviation])
    cone = solved(terms, miss, deviation)
    cylinder = solved(terms[:, :6], miss, deviation)
    ball = _ball_misfit(scene, np.concatenate([wall.pixels, cap.pixels]))
    scale = radius / wall.half
    noise = scale * np.sqrt(scene.shared) * cone.deviation[6]
    # Ends are off by a third of a pixel sideways, which tilts a short wall.
    middle = evidence.wall.center + wall.middle * axis
    sideways = scene.view.width(max(float(middle[2]), 0.0)) / 3 / wall.half
    return Rivals(
        scale * float(cone.value[6]),
        float(np.hypot(noise, sideways)),
        float(np.log(_misfit(cylinder.rest) / ball)),
        _edge(scene, axis, wall),
    )


def _edge(scene: Scene, axis: Float[np.ndarray, "3"], wall: Wall) -> float:
    """Logarithm of the misfit of a wall over that of two planes."""
    found = wall.ahead(axis)
    if found is None:
        return NO_EDGE
    forward, (aside, ahead) = found
    views = scene.view.views.reshape(-1, 3)[wall.pixels]
    # What is known along a ray, as a distance ahead.
    cosine = np.abs((wall.out * views).sum(axis=1))
    along = np.maximum(np.abs(views @ forward), LEAST_ALONG)
    deviation = wall.deviation / np.maximum(cosine, LEAST_ALONG) * along
    own = solved(wall.terms(axis), wall.miss, wall.deviation)
    plane = np.stack([np.ones_like(aside), aside, wall.place], axis=1)
    misfits = []
    for knee in np.quantile(aside, KNEES):
        left = (aside < knee)[:, None]
        terms = np.hstack([plane * left, plane * ~left])
        misfits.append(_misfit(solved(terms, ahead, deviation).rest))
    return float(np.log(_misfit(own.rest) / max(min(misfits), 1e-9)))


def _ball_misfit(scene: Scene, index: Int[np.ndarray, " n"]) -> float:
    """Of the ball that some readings lie on best."""
    view = scene.view
    points = view.points.reshape(-1, 3)[index]
    views, depth = view.views.reshape(-1, 3)[index], view.depth.ravel()[index]
    sigma = scene.noise * view.sigma.ravel()[index]
    # Of |p|^2 = 2 c.p + k, about the middle of the points.
    middle = points.mean(axis=0)
    off = points - middle
    square = (off**2).sum(axis=1)
    rows = np.column_stack([2 * off, np.ones(len(off))])
    center = np.linalg.lstsq(rows, square, rcond=None)[0][:3]
    radius = float(np.median(np.sqrt(((off - center) ** 2).sum(axis=1))))
    rest = np.zeros(len(off))
    for _ in range(STEPS):
        away = off - center
        distance = np.sqrt((away**2).sum(axis=1))
        out = away / np.maximum(distance, 1e-9)[:, None]
        cosine = np.maximum(np.abs((out * views).sum(axis=1)), LEAST_FACING)
        deviation = view.deviation(depth, sigma, cosine) * cosine
        rest = (distance - radius) / deviation
        weight = 1 / deviation / (1 + (rest / LIMIT) ** 2)
        rows = np.column_stack([-out, -np.ones(len(out))]) * weight[:, None]
        step = np.linalg.lstsq(rows, -weight * (distance - radius), rcond=None)[0]
        center, radius = center + step[:3], radius + float(step[3])
    return _misfit(rest)


def _misfit(rest: Float[np.ndarray, " n"]) -> float:
    """Mean square of deviations, of which none counts as more than the limit."""
    square = rest**2
    return float(np.mean(square / (1 + square / LIMIT**2)))
