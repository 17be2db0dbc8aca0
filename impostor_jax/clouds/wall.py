"""The round wall near which points lie, of which nobody tells from where it was seen.

By their distances from it alone, orthogonally and robustly: no sensor has a part in it.
It is rough beside a fit, but needs no start, no noise and no viewpoint, and half of the
points may be others'.
"""

__all__ = ["Wall", "apart", "refined_walls", "wall_near", "wall_of", "walls_of"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

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

APART = np.radians(20)
"""Angle between axes from which walls are two."""

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

WIDE_GAP = np.radians(60)
"""Angle about the axis over which there is no point, from which on one is wide."""

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

    def is_split(self, points: Float[np.ndarray, "n 3"]) -> bool:
        """Whether points lie on parts of it that are apart, and on none between."""
        x, y = self.across(points).T
        angle = np.sort(np.arctan2(y, x))
        gap = np.diff(angle, append=angle[:1] + 2 * np.pi)
        return bool(np.count_nonzero(gap > WIDE_GAP) > 1)

    def across(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """From the axis, across it."""
        return (points - self.center) @ self.frame[:2].T

    def off(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance from the wall, positive outside."""
        return np.linalg.norm(self.across(points), axis=1) - self.radius


def wall_near(points: Float[np.ndarray, "n 3"], cylinder: Cylinder) -> Wall | None:
    """The wall near which points lie, from one that is nearly it; None if none is."""
    parts = cylinder.axis, cylinder.center, cylinder.radius
    axis, center, radius = (np.asarray(part, np.float64)[None] for part in parts)
    size = np.linalg.norm(points - np.median(points, axis=0), axis=1).max()
    return refined_walls(points[None], axis, center, radius, size[None])[0]


def wall_of(points: Float[np.ndarray, "n 3"]) -> Wall | None:
    """The first of `walls_of`; None where there is none."""
    return next(iter(walls_of(points)), None)


def walls_of(points: Float[np.ndarray, "n 3"]) -> list[Wall]:
    """The walls with the least median distances from points, the least first.

    Their axes are apart. They are looked for about the principal axes of the points
    and those of the world: stems and pipes stand or lie.

    References:
        Rousseeuw, Least median of squares regression (1984), for the circle about each
        axis.
    """
    points = points[at_most(len(points), MOST_POINTS)]
    middle = np.median(points, axis=0)
    size = float(np.linalg.norm(points - middle, axis=1).max())
    _, _, principal = np.linalg.svd(points - middle, full_matrices=False)
    axes = np.concatenate([principal, np.eye(3)])
    circles = [_circle_about(points - middle, size, one) for one in axes]
    medians = np.array([circle.median for circle in circles])
    order = np.argsort(medians)[: np.count_nonzero(np.isfinite(medians))]
    chosen = np.union1d(order[:REFINED], order[apart(axes[order])])
    walls = refined_walls(
        np.repeat(points[None], len(chosen), axis=0),
        axes[chosen],
        np.array([middle + circles[k].center for k in chosen]).reshape(-1, 3),
        np.array([circles[k].radius for k in chosen]),
        np.full(len(chosen), size),
    )
    found = [wall for wall in walls if wall is not None]
    found.sort(key=lambda wall: wall.scatter)
    axes = np.array([wall.frame[2] for wall in found]).reshape(-1, 3)
    return [found[k] for k in apart(axes)]


def apart(axes: Float[np.ndarray, "k 3"]) -> list[int]:
    """Which of some axes are apart from all that come before and are."""
    kept: list[int] = []
    for k, axis in enumerate(axes):
        if np.all(np.abs(axes[kept] @ axis) < np.cos(APART)):
            kept.append(k)
    return kept


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


def refined_walls(
    points: Float[np.ndarray, "p n 3"],
    axis: Float[np.ndarray, "p 3"],
    center: Float[np.ndarray, "p 3"],
    radius: Float[np.ndarray, " p"],
    size: Float[np.ndarray, " p"],
) -> list[Wall | None]:
    """Walls with the least distances from groups of points, robustly.

    By Gauss-Newton steps, of all groups together; None where they lead to none.

    Args:
        points: In the world.
        axis: To start from.
        center: Likewise.
        radius: Likewise.
        size: Of all points, in meters.
    """
    frame = turned_to(axis)
    center, radius = center.copy(), radius.copy()
    count = len(points)
    scatter, information = np.full(count, np.inf), np.tile(np.eye(5), (count, 1, 1))
    is_good = np.ones(count, bool)
    going = np.arange(count)
    for _ in range(MOST_STEPS):
        if not len(going):
            break
        about = points[going] - center[going, None]
        x, y, z = np.moveaxis(about @ frame[going].transpose(0, 2, 1), 2, 0)
        distance = np.maximum(np.hypot(x, y), np.finfo(float).tiny)
        off = distance - radius[going, None]
        # Of the points that are near already: half of all may be others'.
        away = np.abs(off)
        near = away < TUKEY * scatter[going, None]
        scatter[going] = 1.4826 * _median_of(away, near)
        scatter[going] = np.maximum(scatter[going], 1e-9 * size[going])
        # Tukey's weights: far points, of branches, caps or none, count nothing.
        wide = TUKEY * scatter[going, None]
        root = np.maximum(1 - (off / wide) ** 2, 0)
        own = size[going, None]
        slope = np.stack([x, y, x * z / own, y * z / own, distance], axis=2)
        slope *= (root / distance)[:, :, None]
        across = slope.transpose(0, 2, 1)
        information[going] = across @ slope
        values = np.linalg.eigvalsh(information[going])
        is_sane = values[:, -1] < MOST_CONDITION * values[:, 0]
        is_good[going[~is_sane]] = False
        pull = (across @ (root * off)[:, :, None])[is_sane]
        going = going[is_sane]
        step = np.linalg.solve(information[going], pull)[:, :, 0]
        first, second, third = frame[going].transpose(1, 0, 2)
        own = size[going, None]
        center[going] += first * step[:, :1] + second * step[:, 1:2]
        turned = third + first * step[:, 2:3] / own + second * step[:, 3:4] / own
        frame[going] = turned_to(turned)
        radius[going] += step[:, 4]
        has_size = (radius[going] > 0) & (radius[going] < 1e3 * size[going])
        is_good[going[~has_size]] = False
        is_last = np.abs(step).max(axis=1, initial=0) < ENOUGH * scatter[going]
        going = going[has_size & ~is_last]
    walls: list[Wall | None] = [None] * count
    for k in np.flatnonzero(is_good):
        variance = np.linalg.inv(information[k])[4, 4]
        deviation = float(scatter[k] * np.sqrt(variance))
        own = float(radius[k]), float(scatter[k]), deviation
        walls[k] = Wall(frame[k], center[k], *own)
    return walls


def _median_of(
    values: Float[np.ndarray, "p n"], counts: Bool[np.ndarray, "p n"]
) -> Float[np.ndarray, " p"]:
    """Median of those values of each row that count; 0 where none does."""
    ordered = np.sort(np.where(counts, values, np.inf), axis=1)
    number = np.count_nonzero(counts, axis=1)
    low, high = np.maximum(number - 1, 0) // 2, number // 2
    rows = np.arange(len(values))
    high = np.minimum(high, values.shape[1] - 1)
    middle = (ordered[rows, low] + ordered[rows, high]) / 2
    return np.where(number > 0, middle, 0)
