"""The round wall near which points lie, of which nobody tells from where it was seen.

By their distances from it alone, orthogonally and robustly: no sensor has a part in it.
It is rough beside a fit, but needs no start, no noise and no viewpoint, and half of the
points may be others'.
"""

__all__ = ["Wall", "wall_near", "wall_of"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from impostor_jax.camera.ray_table import turned_to
from impostor_jax.fit.surface import at_most
from impostor_jax.primitives.cylinder import Cylinder

MOST_POINTS = 600
"""Points that are looked at, evenly spread over all in their order."""

CIRCLES = 300
"""Through three points each, about each axis; where half of the points are the wall's,
all but one in 1e17 of such draws hold one that is of the wall alone."""

REFINED = 2
"""Axes about which the best circle is refined."""

MOST_STEPS = 30
"""Gauss-Newton steps to a wall; from an axis 30 degrees off they took 12 at most."""

ENOUGH = 0.01
"""Step, in robust standard deviations of a point, from which no more are made."""

TUKEY = 4.685
"""Standard deviations from which a point counts nothing: the usual number, which takes
5 % of the efficiency."""

MOST_CONDITION = 1e12
"""Of the information of a wall; beyond, as of points of a line, there is none."""

MOST_SCATTER = 0.2
"""Robust standard deviation of the distances from a wall, in radii, up to which there
is one."""

LEAST_KNOWN = 10.0
"""Radius in its standard deviations from which points tell to which side a wall bends:
of a narrow arc they do not."""


class Wall(NamedTuple):
    """The wall of an infinite cylinder.

    Attributes:
        frame: Rotation into its frame, whose z is the axis.
        center: Point of the axis.
        radius: In meters.
        scatter: Robust standard deviation of distances from it, in meters.
        deviation: Standard deviation of the radius, in meters.
    """

    frame: Float[np.ndarray, "3 3"]
    center: Float[np.ndarray, "3"]
    radius: float
    scatter: float
    deviation: float

    @property
    def is_known(self) -> bool:
        """Whether the points tell that it is round, and how far they scatter."""
        return (
            self.scatter <= MOST_SCATTER * self.radius
            and self.radius >= LEAST_KNOWN * self.deviation
        )

    def across(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """From the axis, across it."""
        return (points - self.center) @ self.frame[:2].T

    def off(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance from the wall, positive outside."""
        return np.linalg.norm(self.across(points), axis=1) - self.radius


def wall_near(points: Float[np.ndarray, "n 3"], cylinder: Cylinder) -> Wall | None:
    """The wall near which points lie, from one that is nearly it; None if none is."""
    parts = cylinder.axis, cylinder.center
    axis, center = (np.asarray(part, np.float64) for part in parts)
    size = float(np.linalg.norm(points - np.median(points, axis=0), axis=1).max())
    return _refined(points, axis, center, float(cylinder.radius), size)


def wall_of(points: Float[np.ndarray, "n 3"]) -> Wall | None:
    """The wall with the least median distance from points; None where there is none.

    It is looked for about the principal axes of the points and those of the world:
    stems and pipes stand or lie.

    References:
        Rousseeuw, Least median of squares regression (1984), for the circle about each
        axis.
    """
    points = points[at_most(len(points), MOST_POINTS)]
    middle = np.median(points, axis=0)
    size = float(np.linalg.norm(points - middle, axis=1).max())
    _, _, principal = np.linalg.svd(points - middle, full_matrices=False)
    axes = [*principal, *np.eye(3)]
    circles = [_circle_about(points - middle, size, one) for one in axes]
    order = np.argsort([circle.median for circle in circles])
    walls = [
        _refined(points, axes[k], middle + circles[k].center, circles[k].radius, size)
        for k in order[:REFINED]
        if np.isfinite(circles[k].median)
    ]
    return min(
        (wall for wall in walls if wall is not None),
        key=lambda wall: wall.scatter,
        default=None,
    )


class _Circle(NamedTuple):
    """A circle about an axis, and the median distance of points from it."""

    center: Float[np.ndarray, "3"]
    radius: float
    median: float


def _circle_about(
    points: Float[np.ndarray, "n 3"], size: float, axis: Float[np.ndarray, "3"]
) -> _Circle:
    """The circle about an axis with the least median distance from points.

    Args:
        points: About their middle.
        size: Of all points: a larger radius is a plane's.
        axis: Along which they are looked at.
    """
    frame = turned_to(axis)
    flat = (points @ frame.T)[:, :2]
    a, b, c = flat[np.random.default_rng(0).integers(0, len(flat), (3, CIRCLES))]
    square_b, square_c = (np.sum((x - a) ** 2, axis=1) for x in (b, c))
    (bx, by), (cx, cy) = (b - a).T, (c - a).T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        away = np.stack([cy * square_b - by * square_c, bx * square_c - cx * square_b])
        away /= 2 * (bx * cy - by * cx)
        radius = np.hypot(*away)
    sane = radius < size
    if not sane.any():
        return _Circle(np.zeros(3), np.inf, np.inf)
    centers, radius = a[sane] + away.T[sane], radius[sane]
    distance = np.hypot(*(flat.T[:, None] - centers.T[:, :, None]))
    medians = np.median(np.abs(distance - radius[:, None]), axis=1)
    best = np.argmin(medians)
    middle = frame[:2].T @ centers[best]
    return _Circle(middle, float(radius[best]), float(medians[best]))


def _refined(
    points: Float[np.ndarray, "n 3"],
    axis: Float[np.ndarray, "3"],
    center: Float[np.ndarray, "3"],
    radius: float,
    size: float,
) -> Wall | None:
    """Wall with the least distances from points, robustly, by Gauss-Newton steps.

    Args:
        points: In the world.
        axis: To start from.
        center: Likewise.
        radius: Likewise.
        size: Of all points, in meters.
    """
    frame = turned_to(axis)
    scatter, information = np.inf, np.eye(5)
    for _ in range(MOST_STEPS):
        x, y, z = ((points - center) @ frame.T).T
        distance = np.maximum(np.hypot(x, y), np.finfo(float).tiny)
        off = distance - radius
        # Of the points that are near already: half of all may be others'.
        near = np.abs(off[np.abs(off) < TUKEY * scatter])
        scatter = 1.4826 * float(np.median(near)) if len(near) else 0.0
        scatter = max(scatter, 1e-9 * size)
        # Tukey's weights: far points, of branches, caps or none, count nothing.
        root = np.maximum(1 - (off / (TUKEY * scatter)) ** 2, 0)
        slope = np.stack([x, y, x * z / size, y * z / size, distance], axis=1)
        slope *= (root / distance)[:, None]
        information = slope.T @ slope
        if not np.linalg.cond(information) < MOST_CONDITION:
            return None
        step = np.linalg.solve(information, slope.T @ (root * off))
        moved = frame.T @ np.array([step[0], step[1], 0.0])
        turned = frame[2] + frame.T @ np.array([step[2] / size, step[3] / size, 0.0])
        frame, center, radius = turned_to(turned), center + moved, radius + step[4]
        if not (0 < radius < 1e3 * size):
            return None
        if np.abs(step).max() < ENOUGH * scatter:
            break
    deviation = scatter * float(np.sqrt(np.linalg.inv(information)[4, 4]))
    return Wall(frame, center, float(radius), scatter, deviation)
