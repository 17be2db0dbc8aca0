"""First guess of a cylinder or a frustum from a depth image, with no user input.

Surface normals of the wall are perpendicular to the axis and those of a cap are
parallel to it, so one axis explains both. Axes are proposed by pairs of normals (the
wall), by single normals (a cap) and by the directions in which the region is longest
and shortest in the image, each in a fixed order, and scored by how many normals they
explain. The best few are carried on to a circle across the axis and an extent along it,
and the one whose surface lies closest to the points comes first.

The normals of a frustum's wall make one angle with the axis, not a right one, and its
radius grows along it: where a taper is looked for, both are found as well.
"""

__all__ = ["guess_cylinders", "guess_frusta"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.fit.rounds import (
    FEWEST_POINTS,
    Guess,
    Round,
    largest_of,
    median_of,
    round_through,
)
from impostor_jax.fit.surface import Samples
from impostor_jax.geometry.so3 import directions_across

MAX_AXES = 5
"""Axes that are carried on to a circle, but for that of the longest direction."""

MOST_GUESSES = 8
"""That are returned, but for one around the camera."""

MOST_LEANING = 0.9
"""Cosine with the axis from which a normal is no wall's, however tapered."""

BEYOND = 0.03
"""Part of its visible length by which a wall goes on past each end that shows no cap:
of a guess that is too short the readings past its end lie on nothing, and a fit does
not reach out for them; one that is too long is drawn in by what shows its end."""

CAP_COSINE = float(np.cos(np.radians(30.0)))
"""Cosine with the axis from which a normal may be a cap's."""

NEAR_COSINE = float(np.cos(np.radians(10.0)))
"""Of the angle below which two axes are taken for one."""

PERCENTILE = 0.01
"""Share of the points beyond each end, or side, of what is seen: strays."""

SIN_TOLERANCE = float(np.sin(np.radians(15.0)))
"""Normals farther than this from perpendicular or parallel do not vote."""


def guess_cylinders(samples: Samples) -> list[Guess]:
    """Cylinders, those that lie closer to the readings before others.

    The best of each axis come first.
    """
    return _guessed(samples, tapered=False)


def guess_frusta(samples: Samples) -> list[Guess]:
    """The same of frusta."""
    return _guessed(samples, tapered=True)


class _Body(NamedTuple):
    """A wall between two ends.

    Attributes:
        center: In the camera frame.
        axis: A unit vector.
        radius: In the middle.
        height: Distance of the ends.
        slope: Growth of the radius along the axis.
    """

    center: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float
    height: float
    slope: float


def _guessed(samples: Samples, tapered: bool) -> list[Guess]:
    bodies = _bodies_along(_axes(samples, tapered), samples, tapered)
    around = _around_camera(bodies[0], samples.deepest) if bodies else None
    if around is not None:
        bodies.insert(1, around)
    guesses = []
    for center, axis, radius, height, slope in bodies:
        growth = {"growth": slope * height / 2} if tapered else {}
        own = {"center": center, "axis": axis, "radius": radius, "height": height}
        guesses.append(own | growth)
    return guesses


def _around_camera(body: _Body, deepest: float) -> _Body | None:
    """The same wall, drawn out around a camera on its axis: a pipe seen from inside.

    What is seen of a pipe begins in front of the camera, as a can does that is seen end
    on; the fit tells which it is. Its far end shows in so few pixels that only the
    deepest of all readings tells it. None where the camera is not on the axis.
    """
    place = float(-body.center @ body.axis)
    aside = body.center + place * body.axis
    half = body.height / 2
    if aside @ aside > (0.95 * body.radius) ** 2 or abs(place) < half:
        return None
    behind = np.sign(place)
    # The axis of what is seen from inside leads away from the camera.
    reach = (deepest - body.center[2]) / max(abs(body.axis[2]), 0.5)
    ends = -behind * max(half, reach), place + behind * body.radius
    low, high = min(ends), max(ends)
    center = body.center + (low + high) / 2 * body.axis
    return body._replace(center=center, height=high - low)


def _axes(samples: Samples, tapered: bool) -> Float[np.ndarray, "k 3"]:
    """Likely axes, at least 10 degrees apart but for the longest direction."""
    n, drawn = samples.normals, samples.drawn
    # Pairs of normals that are far apart in the image, in a fixed pattern.
    first = np.arange(40) * len(n) // 40
    apart = (np.array([[0.21], [0.38], [0.5]]) * len(n)).astype(int)
    others = n[(first + apart) % len(n)]
    pairs = np.cross(n[first][None], others).reshape(-1, 3)
    candidates = [drawn, n[first], pairs]
    least = [np.zeros(2), np.zeros(40), np.full(len(pairs), 0.3)]
    if tapered:
        # Normals of one angle with the axis end on a circle across it.
        candidates.append(np.cross(others[0] - n[first], others[2] - n[first]))
        least.append(np.full(40, 0.1))
    axes = np.concatenate(candidates)
    length = np.linalg.norm(axes, axis=1)
    axes = axes / np.maximum(length, 1e-6)[:, None]
    unexplained = _unexplained(axes, n[::2], tapered)
    unexplained[length < np.concatenate(least)] = np.inf
    order = np.argsort(unexplained, kind="stable")[: 3 * MAX_AXES]
    # The cap of a cylinder seen end on: noise in two directions, and axes across the
    # view that explain it as a wall, keep its normal from the front of the list.
    _, vectors = np.linalg.eigh(n.T @ n)
    refined = _refined(np.concatenate([vectors[:, 2][None], axes[order]]), n, tapered)
    likeliest = refined[np.argmin(_unexplained(refined, n, tapered))]
    longest, shortest = drawn
    axes = np.stack([likeliest, longest, *refined[:2], shortest, *refined[2:]])
    places = np.arange(len(axes))
    are_any = (samples.num_normals >= FEWEST_POINTS) | (places == 1) | (places == 4)
    kept = _apart(axes, are_any)
    # A rod's image tells its axis better than its normals do, also where they are near.
    kept = (kept & (np.cumsum(kept) <= MAX_AXES)) | (places == 1)
    return axes[kept]


def _apart(
    axes: Float[np.ndarray, "k 3"], are_any: Bool[np.ndarray, " k"]
) -> Bool[np.ndarray, " k"]:
    """Which axes are at least 10 degrees from all such before them."""
    is_near = np.abs(axes @ axes.T) > NEAR_COSINE
    kept = np.zeros(len(axes), bool)
    for place in np.flatnonzero(are_any):
        kept[place] = not np.any(is_near[place] & kept)
    return kept


def _off_wall(
    cosine: Float[np.ndarray, "k m"], tapered: bool
) -> Float[np.ndarray, "k m"]:
    """Cosines of normals with each axis, less that of the wall's normals."""
    if not tapered:
        return cosine
    # Of all but the caps' normals.
    middle = median_of(cosine, np.abs(cosine) < MOST_LEANING)[:, None]
    return cosine - np.where(np.isfinite(middle), middle, 0)


def _unexplained(
    axes: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "m 3"], tapered: bool
) -> Float[np.ndarray, " k"]:
    """Mean squared sine between each normal and the nearer of wall and cap."""
    cosine = axes @ normals.T
    miss = np.minimum(_off_wall(cosine, tapered) ** 2, 1 - cosine**2)
    return np.minimum(miss, SIN_TOLERANCE**2).mean(axis=1)


def _refined(
    axes: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "m 3"], tapered: bool
) -> Float[np.ndarray, "k 3"]:
    """Least-squares axes of the normals that each explains.

    They minimize the sum of (n.a)^2 over the wall's normals, from their mean where it
    is tapered, and of 1 - (n.a)^2 over the caps': the eigenvector to the smallest
    eigenvalue of a difference of scatters.
    """
    products = (normals[:, :, None] * normals[:, None, :]).reshape(-1, 9)
    for _ in range(2):
        cosine = axes @ normals.T
        cap = cosine**2 > 1 - (2 * SIN_TOLERANCE) ** 2
        wall = (_off_wall(cosine, tapered) ** 2 < (2 * SIN_TOLERANCE) ** 2) & ~cap
        is_wall = wall.astype(float)
        scatter = ((is_wall - cap) @ products).reshape(-1, 3, 3)
        if tapered:
            total, count = is_wall @ normals, wall.sum(axis=1)
            mean = total / np.maximum(count, 1)[:, None]
            scatter -= total[:, :, None] * mean[:, None, :]
        _, vectors = np.linalg.eigh(scatter)
        axes = vectors[:, :, 0]
    return axes


def _bodies_along(
    axes: Float[np.ndarray, "k 3"], samples: Samples, tapered: bool
) -> list[_Body]:
    """Bodies from the circle that the wall makes, and from the disc of each cap.

    The best of each axis first.
    """
    middle = samples.points.mean(axis=0)
    # Frames whose third direction is the axis.
    frames = np.stack([np.vstack([directions_across(axis), axis]) for axis in axes])
    from_camera = frames @ middle[:, None]
    local = frames @ (samples.points - middle).T
    across, along = local[:, :2], local[:, 2]
    caps = _caps(axes, samples, middle)
    length = np.ptp(along, axis=1)
    on_cap = np.abs(along[:, None] - caps[..., None]) <= 0.05 * length[:, None, None]
    on_wall = ~np.any(on_cap, axis=1)
    fewest = FEWEST_POINTS * samples.copies
    circles = [
        _silhouette(across, on_wall, from_camera[:, :2], samples.copies),
        round_through(across, on_wall, fewest=fewest),
    ]
    if tapered:
        circles.append(round_through(across, on_wall, along, fewest=fewest))
    discs = _discs(across, on_cap, fewest)
    circle = Round(
        *(
            np.concatenate([disc, np.stack(others, axis=1)], axis=1)
            for disc, *others in zip(discs, *circles, strict=True)
        )
    )
    low, high, misfit = _extended(circle, caps[:, None], local, fewest)
    height, place = high - low, (high + low) / 2
    radius = circle.radius + circle.slope * (place - circle.place)
    # What tapers to less than nothing is cut off before.
    steepest = 1.9 * radius / height
    slope = np.clip(circle.slope, -steepest, steepest)
    center = np.concatenate([circle.center, place[..., None]], -1) @ frames + middle
    # Of axes that are near each other the best counts.
    best = misfit.min(axis=1)
    by_misfit = np.argsort(best, kind="stable")
    is_second = misfit > best[:, None]
    is_second[by_misfit[~_apart(axes[by_misfit], np.ones(len(axes), bool))]] = True
    order = np.lexsort((misfit.ravel(), is_second.ravel()))[:MOST_GUESSES]
    return [
        _Body(center[k], axes[k[0]], *(float(x[k]) for x in (radius, height, slope)))
        for k in zip(*np.unravel_index(order, misfit.shape), strict=True)
        if np.isfinite(misfit[k])
    ]


def _caps(
    axes: Float[np.ndarray, "k 3"], samples: Samples, middle: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "k 2"]:
    """Places along each axis, from a middle, of the caps that are seen; else NaN.

    A camera sees at most one cap from outside and both from between their planes.
    """
    cosine, along = axes @ samples.normals.T, axes @ samples.normal_points.T
    sign = np.array([-1, 1])[:, None]
    # A cap that is seen edge on may give normals of either sign; one is true.
    facing = (sign * cosine[:, None] > CAP_COSINE) & (sign * along[:, None] < 0)
    # A few stray normals at the edge of the region do not make a cap.
    least = max(8 / max(samples.num_normals, 1), 0.03)
    is_seen = facing.mean(axis=-1) >= least
    place = median_of(along[:, None], facing) - (axes @ middle)[:, None]
    return np.where(is_seen, place, np.nan)


def _discs(
    across: Float[np.ndarray, "k 2 n"], on_cap: Bool[np.ndarray, "k 2 n"], fewest: float
) -> Round:
    """Circles of even discs: the mean square distance is half the radius squared."""
    counts = on_cap.astype(float)
    count = counts.sum(axis=-1, keepdims=True)
    moments = np.concatenate([across, across**2], axis=1)
    sums = counts @ np.swapaxes(moments, 1, 2)
    mean = sums / np.where(count < fewest, np.nan, count)
    center = mean[..., :2]
    radius = np.sqrt(2 * (mean[..., 2:] - center**2).sum(axis=-1))
    return Round(center, radius, 0 * radius, 0 * radius)


def _silhouette(
    across: Float[np.ndarray, "k 2 n"],
    on_wall: Bool[np.ndarray, "k n"],
    from_camera: Float[np.ndarray, "k 2 1"],
    copies: float,
) -> Round:
    """Circle as wide as the points appear, behind those in its middle.

    Noise of the readings, which ruins a circle through an arc of few standard
    deviations, hardly moves the sides.
    """
    across = across + from_camera
    x, y = np.moveaxis(across @ on_wall[..., None].astype(float), 1, 0)
    length = np.hypot(x, y)
    x, y = x / length, y / length
    turned = np.stack([-y, x, x, y], axis=-1).reshape(-1, 2, 2)
    aside, ahead = np.moveaxis(turned @ across, 1, 0)
    rank = np.round(PERCENTILE * (on_wall.sum(axis=1) - 1)).astype(int)
    high = largest_of(aside, on_wall, rank)[:, None]
    low = -largest_of(-aside, on_wall, rank)[:, None]
    radius, place = (high - low) / 2, (high + low) / 2
    near = on_wall & (np.abs(aside - place) < radius / 3)
    is_seen = near.sum(axis=1, keepdims=True) >= 5 * copies
    radius = np.where(is_seen & (radius > 0), radius, np.nan)
    behind = median_of(ahead, near)[:, None] + 0.98 * radius
    center = np.concatenate([place, behind], axis=1)[:, None] @ turned
    radius = radius[:, 0]
    return Round(center[:, 0] - from_camera[..., 0], radius, 0 * radius, 0 * radius)


def _extended(
    circle: Round,
    caps: Float[np.ndarray, "k 1 2"],
    local: Float[np.ndarray, "k 3 n"],
    fewest: float,
) -> tuple[
    Float[np.ndarray, "k c"], Float[np.ndarray, "k c"], Float[np.ndarray, "k c"]
]:
    """Ends of the body over each circle, and its misfit; infinite where there is none.

    The ends are caps, or as far as its wall is seen.

    Args:
        circle: Circles (k, c) of the wall.
        caps: As of `_caps`.
        local: Points in the frames of the circles.
        fewest: Points that a wall is made of.
    """
    x, y, along = np.moveaxis(local[:, None], 2, 0)
    x, y = x - circle.center[..., :1], y - circle.center[..., 1:]
    beyond_wall = np.sqrt(x * x + y * y) - circle.radius[..., None]
    beyond_wall -= circle.slope[..., None] * (along - circle.place[..., None])
    near = np.abs(beyond_wall) < 0.15 * circle.radius[..., None]
    count = near.sum(axis=-1)
    rank = np.ceil(PERCENTILE * count).astype(int) - 1
    high, low = largest_of(along, near, rank), -largest_of(-along, near, rank)
    beyond = BEYOND * (high - low)
    low = np.where(np.isnan(caps[..., 0]), low - beyond, caps[..., 0])
    high = np.where(np.isnan(caps[..., 1]), high + beyond, caps[..., 1])
    radius = circle.radius + circle.slope * ((low + high) / 2 - circle.place)
    is_body = (count >= fewest) & (high > low) & (radius > 0)
    beyond_cap = np.maximum(low[..., None] - along, along - high[..., None])
    inside = np.minimum(np.maximum(beyond_wall, beyond_cap), 0)
    outside = np.maximum(beyond_wall, 0) ** 2 + np.maximum(beyond_cap, 0) ** 2
    miss = np.minimum(np.sqrt(outside) - inside, 0.3 * radius[..., None])
    return low, high, np.where(is_body, miss.mean(axis=-1), np.inf)
