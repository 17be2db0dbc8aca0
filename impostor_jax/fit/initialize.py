"""First guess of a cylinder or a frustum from a depth image, with no user input.

Surface normals of the wall are perpendicular to the axis and those of a cap are
parallel to it, so one axis explains both. Axes are proposed by pairs of normals (the
wall), by single normals (a cap) and by the directions in which the region is longest
and shortest in the image, each in a fixed order, and scored by how many normals they
explain. The best few are carried on to a circle across the axis and an extent along it,
and the one whose surface lies closest to the points comes first.

The normals of a frustum's wall make one angle with the axis, not a right one, and its
radius grows along it: where a taper is looked for, both are found as well.

Everything here runs outside JAX, on NumPy and scikit-image.
"""

__all__ = ["Guess", "first_guesses"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from skimage.measure import CircleModel

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.surface import (
    MAX_POINTS,
    Surface,
    surface_of,
    thinned,
    within_deviations,
)

MAX_AXES = 5
"""Axes that are carried on to a circle."""

MOST_LEANING = 0.9
"""Cosine with the axis from which a normal is no wall's, however tapered."""

BEYOND = 0.03
"""Part of its visible length by which a wall goes on past each end that shows no cap:
of a guess that is too short the readings past its end lie on nothing, and a fit does
not reach out for them; one that is too long is drawn in by what shows its end."""

SIN_TOLERANCE = np.sin(np.radians(15.0))
"""Normals farther than this from perpendicular or parallel do not vote."""


class Guess(NamedTuple):
    """A body in the camera frame, in meters, and how far the points lie from it."""

    center: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float
    height: float
    misfit: float
    slope: float = 0.0


class _Circle(NamedTuple):
    """Circle across an axis, and how its radius grows along it from a place."""

    middle: Float[np.ndarray, "2"]
    radius: float
    slope: float = 0.0
    place: float = 0.0

    def radius_at(
        self, along: float | Float[np.ndarray, " n"]
    ) -> float | Float[np.ndarray, " n"]:
        return self.radius + self.slope * (along - self.place)


def first_guesses(
    depth: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
    sigma: float,
    tapered: bool = False,
    only_one: bool = False,
) -> list[Guess]:
    """Guess cylinders from the readings of a region, for each likely axis.

    Args:
        depth: In meters; 0 where there is no reading.
        region: Pixels of the object, wall and caps together.
        camera: Concrete; its pose is not used.
        sigma: Typical deviation of a reading, in meters.
        tapered: Whether to look for frusta, too.
        only_one: Whether to look along the likeliest axis alone.

    Returns:
        Guesses in the camera frame: the best of each axis first, those that lie closer
        to the readings before others; none where the readings admit no cylinder.
    """
    surface = surface_of(depth, region, camera, sigma)
    if surface is None:
        return []
    ranked = [
        (place, guess)
        for axis in _axes(surface, tapered, only_one)
        for place, guess in enumerate(
            sorted(
                _guesses_along(axis, surface, tapered), key=lambda guess: guess.misfit
            )
        )
    ]
    # The second of an axis comes after the first of all.
    ranked.sort(key=lambda entry: (entry[0] > 0, entry[1].misfit))
    guesses = [guess for _, guess in ranked]
    around = [_around_camera(guess) for guess in guesses[:1]]
    return [*guesses[:1], *(guess for guess in around if guess), *guesses[1:]]


def _around_camera(guess: Guess) -> Guess | None:
    """The same wall, drawn out around a camera on its axis: a pipe seen from inside.

    What is seen of a pipe begins in front of the camera, as a can does that is seen end
    on; the fit tells which it is.
    """
    place = -float(guess.center @ guess.axis)
    aside = guess.center + place * guess.axis
    if np.linalg.norm(aside) > 0.95 * guess.radius or abs(place) < guess.height / 2:
        return None
    low = min(-guess.height / 2, place - guess.radius)
    high = max(guess.height / 2, place + guess.radius)
    center = guess.center + (low + high) / 2 * guess.axis
    return guess._replace(center=center, height=high - low)


def _axes(
    surface: Surface, tapered: bool, only_one: bool
) -> list[Float[np.ndarray, "3"]]:
    """Candidate axes, at least 10 degrees apart."""
    n = surface.normals
    if len(n) < 10:
        return [*surface.drawn]
    # Pairs of normals that are far apart in the image, in a fixed pattern.
    first = np.linspace(0, len(n) - 1, 64).astype(int)
    candidates = [surface.drawn, n[first]]
    for part in (0.21, 0.38, 0.5):
        pair = np.cross(n[first], n[(first + int(part * len(n))) % len(n)])
        candidates.append(pair[np.linalg.norm(pair, axis=1) > 0.3])
    if tapered:
        # Normals of one angle with the axis end on a circle across it.
        others = [n[(first + int(part * len(n))) % len(n)] for part in (0.21, 0.5)]
        across = np.cross(others[0] - n[first], others[1] - n[first])
        candidates.append(across[np.linalg.norm(across, axis=1) > 0.1])
    axes = np.concatenate(candidates)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    order = np.argsort(_unexplained(axes, n, tapered), kind="stable")
    # The cap of a cylinder seen end on: noise in two directions, and axes across the
    # view that explain it as a wall, keep its normal from the front of the list.
    _, vectors = np.linalg.eigh(n.T @ n)
    likely = np.concatenate([vectors[:, 2][None], axes[order[: 4 * MAX_AXES]]])
    refined = _refined(likely, n, tapered)
    if only_one:
        return [refined[np.argmin(_unexplained(refined, n, tapered))]]
    first, *others = refined
    longest, shortest = surface.drawn
    kept = []
    for axis in (first, longest, *others[:1], shortest, *others[1:]):
        if all(abs(axis @ other) < np.cos(np.radians(10.0)) for other in kept):
            kept.append(axis)
        if len(kept) == MAX_AXES:
            break
    return kept


def _levels(
    cosine: Float[np.ndarray, "k m"], tapered: bool
) -> Float[np.ndarray, "k 1"]:
    """Cosine of the wall's normals with each axis."""
    if not tapered:
        return np.zeros((len(cosine), 1))
    # Of all but the caps' normals.
    ordered = np.sort(np.where(np.abs(cosine) < MOST_LEANING, cosine, np.inf), axis=1)
    count = np.count_nonzero(np.isfinite(ordered), axis=1)
    middle = np.take_along_axis(ordered, count[:, None] // 2, axis=1)
    return np.where(np.isfinite(middle), middle, 0)


def _unexplained(
    axes: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "m 3"], tapered: bool
) -> Float[np.ndarray, " k"]:
    """Mean squared sine between each normal and the nearer of wall and cap."""
    cosine = axes @ normals.T
    off_wall = np.abs(cosine - _levels(cosine, tapered))
    off_cap = np.sqrt(np.maximum(1 - cosine**2, 0))
    miss = np.minimum(np.minimum(off_wall, off_cap), SIN_TOLERANCE)
    return np.mean(miss**2, axis=1)


def _refined(
    axes: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "m 3"], tapered: bool
) -> Float[np.ndarray, "k 3"]:
    """Least-squares axes of the normals that each explains.

    They minimize the sum of (n.a)^2 over the wall's normals, from their mean where it
    is tapered, and of 1 - (n.a)^2 over the caps': the eigenvector to the smallest
    eigenvalue of a difference of scatters.
    """
    products = (normals[:, :, None] * normals[:, None, :]).reshape(-1, 9)
    for _ in range(3):
        cosine = axes @ normals.T
        cap = np.abs(cosine) > np.sqrt(1 - (2 * SIN_TOLERANCE) ** 2)
        wall = np.abs(cosine - _levels(cosine, tapered)) < 2 * SIN_TOLERANCE
        wall = wall & ~cap
        scatter = ((wall.astype(float) - cap) @ products).reshape(-1, 3, 3)
        if tapered:
            total, count = wall @ normals, np.count_nonzero(wall, axis=1)
            mean = total / np.maximum(count, 1)[:, None]
            scatter -= total[:, :, None] * mean[:, None, :]
        _, vectors = np.linalg.eigh(scatter)
        axes = vectors[:, :, 0]
    return axes


def _guesses_along(
    axis: Float[np.ndarray, "3"], surface: Surface, tapered: bool
) -> list[Guess]:
    """Guesses from the circle that the wall makes, and from the disc of each cap."""
    points = thinned(surface.points, MAX_POINTS)
    basis = np.linalg.svd(axis[None])[2][1:]
    across, along = points @ basis.T, points @ axis
    caps = _caps(axis, surface)
    thickness = 0.05 * float(np.ptp(along))
    on_wall = np.ones(len(points), dtype=bool)
    circles = []
    for end in caps.values():
        on_cap = np.abs(along - end) <= thickness
        on_wall &= ~on_cap
        if np.count_nonzero(on_cap) >= 10:
            middle = across[on_cap].mean(axis=0)
            # In an even disc the mean square distance is half the radius squared.
            squared = np.mean(np.sum((across[on_cap] - middle) ** 2, axis=1))
            circles.append(_Circle(middle, float(np.sqrt(2 * squared))))
    if np.count_nonzero(on_wall) >= 10:
        circles.append(_circle(thinned(across[on_wall])))
        circles.append(_silhouette(across[on_wall]))
        if tapered:
            circles.append(_growing(thinned(across[on_wall]), thinned(along[on_wall])))
    found = (circle for circle in circles if circle is not None)
    guesses = [_extended(axis, basis, circle, caps, across, along) for circle in found]
    return [guess for guess in guesses if guess is not None]


def _silhouette(
    points: Float[np.ndarray, "n 2"],
) -> _Circle | None:
    """Circle as wide as the points appear, behind those in its middle.

    Noise of the readings, which ruins a circle through an arc of few deviations, hardly
    moves the sides.
    """
    view = points.mean(axis=0)
    distance = np.linalg.norm(view)
    if not distance > 0:
        return None
    view = view / distance
    aside, ahead = points @ np.array([-view[1], view[0]]), points @ view
    low, high = np.percentile(aside, (1, 99))
    radius = float(high - low) / 2
    near = np.abs(aside - (low + high) / 2) < radius / 3
    if np.count_nonzero(near) < 5 or not radius > 0:
        return None
    middle = np.array([-view[1], view[0]]) * (low + high) / 2
    return _Circle(middle + view * (np.median(ahead[near]) + 0.98 * radius), radius)


def _extended(
    axis: Float[np.ndarray, "3"],
    basis: Float[np.ndarray, "2 3"],
    circle: _Circle,
    caps: dict[int, float],
    across: Float[np.ndarray, "n 2"],
    along: Float[np.ndarray, " n"],
) -> Guess | None:
    """Body over a circle, from cap to cap or as far as its wall is seen."""
    distance = np.linalg.norm(across - circle.middle, axis=1)
    beyond_wall = distance - circle.radius_at(along)
    near_wall = np.abs(beyond_wall) < 0.15 * circle.radius
    if np.count_nonzero(near_wall) < 10:
        return None
    low, high = np.percentile(along[near_wall], (1, 99))
    beyond = BEYOND * (high - low)
    low, high = caps.get(-1, float(low - beyond)), caps.get(1, float(high + beyond))
    if not high > low:
        return None
    radius = float(circle.radius_at((low + high) / 2))
    # What tapers to less than nothing is cut off before.
    slope = np.clip(circle.slope, *np.array([-1, 1]) * 1.9 * radius / (high - low))
    if not radius > 0:
        return None
    beyond_cap = np.maximum(low - along, along - high)
    outside = np.hypot(np.maximum(beyond_wall, 0), np.maximum(beyond_cap, 0))
    inside = np.minimum(np.abs(beyond_wall), np.abs(beyond_cap))
    is_inside = (beyond_wall < 0) & (beyond_cap < 0)
    miss = np.where(is_inside, inside, outside)
    return Guess(
        center=circle.middle @ basis + (low + high) / 2 * axis,
        axis=axis,
        radius=radius,
        height=high - low,
        misfit=float(np.mean(np.minimum(miss, 0.3 * radius))),
        slope=float(slope),
    )


def _caps(axis: Float[np.ndarray, "3"], surface: Surface) -> dict[int, float]:
    """Positions along the axis of the caps that are seen, by the sign of their normal.

    A camera sees at most one cap from outside and both from between their planes.
    """
    cosine, along = surface.normals @ axis, surface.normal_points @ axis
    caps = {}
    for sign in (-1, 1):
        # A cap that is seen edge on may give normals of either sign; one is true.
        facing = (sign * cosine > np.cos(np.radians(30.0))) & (sign * along < 0)
        # A few stray normals at the edge of the region do not make a cap.
        if np.count_nonzero(facing) >= max(8, 0.03 * len(cosine)):
            caps[sign] = float(np.median(along[facing]))
    return caps


def _growing(
    points: Float[np.ndarray, "n 2"], along: Float[np.ndarray, " n"]
) -> _Circle | None:
    """Circles of one axis whose radius grows along it; trimmed as `_circle` is.

    |x|^2 = 2 c.x + r^2 - |c|^2 + 2 r k l + k^2 l^2 is linear in what is left of the
    unknown, if k^2 is taken for one of them.
    """
    place = float(along.mean())
    scale = float(np.ptp(points, axis=0).max())
    away = along - place
    full = np.stack([*(2 * points.T), np.ones_like(away), away, away**2], axis=1)
    squares = np.sum(points**2, axis=1)
    kept, circle = np.ones(len(points), dtype=bool), None
    for _ in range(3):
        if np.count_nonzero(kept) < 10:
            return None
        x, y, constant, linear, _ = np.linalg.lstsq(
            full[kept], squares[kept], rcond=None
        )[0]
        radius_squared = constant + x * x + y * y
        if not 0 < radius_squared < (50 * scale) ** 2:
            return None
        radius = float(np.sqrt(radius_squared))
        circle = _Circle(np.array([x, y]), radius, float(linear / (2 * radius)), place)
        distance = np.linalg.norm(points - circle.middle, axis=1)
        miss = np.abs(distance - circle.radius_at(along))
        kept = within_deviations(miss, scale)
    return circle


def _circle(
    points: Float[np.ndarray, "n 2"],
) -> _Circle | None:
    """Circle through most of the points: fitted, trimmed at 3 deviations, repeated."""
    scale = float(np.ptp(points, axis=0).max())
    if not scale > 0:
        return None
    kept, middle, radius = points, np.zeros(2), np.inf
    for _ in range(3):
        model = CircleModel.from_estimate(kept)
        if not model:
            return None
        middle, radius = np.asarray(model.center), float(model.radius)
        miss = np.abs(np.linalg.norm(points - middle, axis=1) - radius)
        kept = points[within_deviations(miss, scale)]
        if len(kept) < 10:
            return None
    # A circle far larger than what is seen of it is a plane.
    return _Circle(middle, radius) if radius < 50 * scale else None
