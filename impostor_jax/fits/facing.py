"""Whether points of a wall face the place that they are said to be seen from.

Points alone tell the cylinder near which they lie, by their distances from its wall: no
sensor has a part in it. From outside of that only the near half of the wall is seen.
Points of the far half, whose rays would go through the near one, contradict their
origin, however well a cylinder can be bent to their rays.
"""

__all__ = ["WELL_OUTSIDE", "share_away", "tested_by_facing"]

import numpy as np
from jaxtyping import Float

from impostor_jax.clouds.wall import Wall, wall_near, wall_of
from impostor_jax.fit.result import Fit
from impostor_jax.fit.surface import at_most
from impostor_jax.primitives.cylinder import Cylinder

MOST_POINTS = 1000
"""Points that are looked at, evenly spread over all in their order."""

LEAST_ON_WALL = 0.5
"""Share of the points that a wall must have."""

WELL_OUTSIDE = 1.1
"""Distance of an origin from the axis, in radii, from which it is outside."""

LEAST_TURNED = 0.1
"""Cosine of the angle between the wall's normal and the ray from which a point is of
the far half; or three times the scatter in radii, which noise along the ray turns a
point beside the outline by."""

BESIDE_END = 0.05
"""Part of a wall's length, beside either end, that is not looked at."""

FEWEST = 20
"""Points of a wall, away from its ends, that tell."""

MOST_AWAY = 0.05
"""Share of the points of a wall that may face away."""


def tested_by_facing(
    fit: Fit, ends: Float[np.ndarray, "n 3"], starts: Float[np.ndarray, "n 3"]
) -> Fit:
    """The fit, or a failed one where too many points face away from their origin.

    Args:
        fit: Of the points; a wall is looked for beside its own at first.
        ends: The points.
        starts: Where each was seen from.
    """
    share = share_away(ends, starts, fit.cylinder if fit.is_shape else None)
    if share is None or share <= MOST_AWAY:
        return fit
    return fit.contradicted(
        f"{100 * share:.0f} % of the wall's points face away from the origin that they "
        "were seen from: it is wrong, or in another frame than the points."
    )


def share_away(
    ends: Float[np.ndarray, "n 3"],
    starts: Float[np.ndarray, "n 3"],
    near: Cylinder | None = None,
) -> float | None:
    """Share of a wall's points that face away; None where that cannot be told.

    Args:
        ends: The points.
        starts: Where each was seen from.
        near: Beside which a wall is looked for at first.
    """
    some = at_most(len(ends), MOST_POINTS)
    points, origins = ends[some], starts[some]
    wall = None if near is None else wall_near(points, near)
    if wall is None or not _holds(wall, points):
        wall = wall_of(points)
        if wall is None or not _holds(wall, points):
            return None
    across = wall.across(points)
    distance = np.linalg.norm(across, axis=1)
    off = np.abs(distance - wall.radius) / wall.scatter
    # A cap that is seen has a rim all around.
    along = (points - wall.center) @ wall.frame[2]
    low, high = np.percentile(along[off <= 3], [2, 98])
    margin = max(3 * wall.scatter, BESIDE_END * (high - low))
    between = (along > low + margin) & (along < high - margin)
    count = np.count_nonzero(between & (off <= 3))
    if count < FEWEST:
        return None
    # From inside the wall all of it is seen.
    outside = np.linalg.norm(wall.across(origins), axis=1)
    ray = (points - origins) @ wall.frame[:2].T
    toward = -np.sum(across * ray, axis=1)
    size = distance * np.linalg.norm(points - origins, axis=1)
    turned = max(LEAST_TURNED, 3 * wall.scatter / wall.radius)
    away = between & (outside > WELL_OUTSIDE * wall.radius) & (toward < -turned * size)
    # Outliers that lie near the wall by chance are as dense at other distances.
    by_chance = np.count_nonzero(away & (off > 3) & (off <= 9)) / 2
    return max(np.count_nonzero(away & (off <= 3)) - by_chance, 0.0) / count


def _holds(wall: Wall, points: Float[np.ndarray, "n 3"]) -> bool:
    """Whether enough points are of a wall that is known."""
    on_wall = np.abs(wall.off(points)) <= 3 * wall.scatter
    return wall.is_known and float(np.mean(on_wall)) >= LEAST_ON_WALL
