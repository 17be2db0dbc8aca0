"""First guess of a tube: a cylinder's, and the wall that is seen within it.

Normals face the camera. On the outer wall they lead away from the axis, on that of the
bore towards it, so they tell which of two circles about one center a point is on.
"""

__all__ = ["closed", "guess_tubes"]

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.fit.guess_round import guess_cylinders
from impostor_jax.fit.rounds import (
    FEWEST_POINTS,
    RIDGE,
    ROUNDING,
    Guess,
    largest_of,
    median_of,
)
from impostor_jax.fit.surface import MAX_POINTS, Samples
from impostor_jax.fit.tube_body import TubeBody
from impostor_jax.geometry.so3 import directions_across

MOST_LENGTHWISE = 0.5
"""Cosine with the axis up to which a normal is a wall's."""

LEAST_RADIAL = 0.5
"""Cosine with the direction from the axis from which a wall's normal tells its side."""

LEAST, MOST = 0.02, 0.97
"""Inner radius of a guess, in outer ones."""

CLOSED = 0.01
"""The same of one without a bore."""

UNSEEN = 0.5
"""The same of one whose ends are not seen."""

NEAR = 0.15
"""Distance from a wall, in radii, within which a point is on it."""

STRAY = 0.01
"""Share of a wall's points, at each end of it, that are strays."""


def guess_tubes(samples: Samples) -> list[Guess]:
    """Tubes about `guess_cylinders`, in their order."""
    return [_with_bore(guess, samples) for guess in guess_cylinders(samples)]


def closed(body: TubeBody) -> TubeBody:
    """The same outside, with hardly any bore."""
    return eqx.tree_at(lambda b: b.inner_radius, body, CLOSED * body.radius)


def _with_bore(cylinder: Guess, samples: Samples) -> Guess:
    center, axis, radius, height = (
        cylinder[name] for name in ("center", "axis", "radius", "height")
    )
    frame = np.vstack([directions_across(axis), axis])
    points = (samples.points - center) @ frame.T
    places = (samples.normal_points - center) @ frame.T
    normals = samples.normals @ frame.T
    from_axis = np.hypot(places[:, 0], places[:, 1])
    radial = np.sum(normals[:, :2] * places[:, :2], axis=1)
    radial = radial / np.maximum(from_axis, np.finfo(float).tiny)
    is_wall = np.abs(normals[:, 2]) < MOST_LENGTHWISE
    outside = is_wall & (radial > LEAST_RADIAL)
    inside = is_wall & (radial < -LEAST_RADIAL)
    fewest = FEWEST_POINTS * max(MAX_POINTS / max(samples.num_normals, 1), 1)
    has_outer, has_inner = (wall.sum() >= fewest for wall in (outside, inside))
    middle, outer, inner = _circles(places[:, :2], outside, inside)
    # A cylinder's guess may be a circle through both walls.
    is_better = has_inner and np.all(np.isfinite(middle)) and outer > 0 and inner > 0
    if not is_better:
        middle, inner = np.zeros(2), 0.0
    rho = np.hypot(*(points[:, :2] - middle).T)
    if is_better and has_outer:
        radius = outer
    elif is_better:
        # Without an outer wall the ring around the bore tells how thick it is.
        widest = largest_of(rho, rho > inner, _strays(rho > inner))
        radius = max(widest if np.isfinite(widest) else 0.0, inner / MOST)
    along = points[:, 2]
    near = np.abs(rho - radius) < NEAR * radius
    if is_better:
        near |= np.abs(rho - inner) < NEAR * radius
    rank = _strays(near)
    low, high = -largest_of(-along, near, rank), largest_of(along, near, rank)
    if not (is_better and high > low and np.isfinite(high - low)):
        low, high = -height / 2, height / 2
    if not is_better:
        # The end that faces the camera, and what of it is seen beside the wall.
        faces = low if center @ axis > 0 else high
        on_end = np.abs(along - faces) < 0.1 * (high - low)
        on_end &= rho < (1 - NEAR) * radius
        inner = 0.8 * rho[on_end].min() if on_end.any() else UNSEEN * radius
    return {
        "center": center + np.append(middle, (low + high) / 2) @ frame,
        "axis": axis,
        "radius": radius,
        "inner_radius": np.clip(inner, LEAST * radius, MOST * radius),
        "height": high - low,
    }


def _strays(among: Bool[np.ndarray, " n"]) -> np.integer:
    """How many of some points are strays."""
    return np.ceil(STRAY * among.sum()).astype(int)


def _circles(
    points: Float[np.ndarray, "n 2"],
    outside: Bool[np.ndarray, " n"],
    inside: Bool[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, "2"], float, float]:
    """Center and radii of two circles about it, by least squares; 0 or NaN if none.

    |x|^2 = 2 c.x + (r^2 - |c|^2) is linear in the center and one number for each. They
    are fitted once more to the points that lie close.
    """
    scale = max(np.max(np.abs(points)), np.finfo(float).tiny)
    x = points / scale
    squares = np.sum(x * x, axis=1)

    def fitted(
        outside: np.ndarray, inside: np.ndarray
    ) -> tuple[np.ndarray, float, float]:
        rows = np.column_stack([2 * x, outside, inside])
        rows = rows * (outside | inside)[:, None]
        equations = rows.T @ rows + RIDGE * len(x) * np.eye(4)
        solution = np.linalg.solve(equations, rows.T @ squares)
        center = solution[:2]
        outer, inner = np.sqrt(np.maximum(solution[2:] + np.sum(center**2), 0))
        return center, float(outer), float(inner)

    center, outer, inner = fitted(outside, inside)
    rho = np.hypot(*(x - center).T)
    kept = []
    for among, radius in ((outside, outer), (inside, inner)):
        miss = np.abs(rho - radius)
        limit = 3 * 1.4826 * median_of(miss, among) + ROUNDING
        kept.append(among & (miss <= limit))
    center, outer, inner = fitted(*kept)
    return center * scale, outer * scale, inner * scale
