"""First guess of a cylinder or a frustum from a depth image, with no user input.

Surface normals of the wall are perpendicular to the axis and those of a cap are
parallel to it, so one axis explains both. Axes are proposed by pairs of normals (the
wall), by single normals (a cap) and by the directions in which the region is longest
and shortest in the image, each in a fixed order, and scored by how many normals they
explain. The best few are carried on to a circle across the axis and an extent along it,
and the one whose surface lies closest to the points comes first.

The normals of a frustum's wall make one angle with the axis, not a right one, and its
radius grows along it: where a taper is looked for, both are found as well.

Everything here runs outside JAX, in few calls of NumPy.
"""

__all__ = ["Guess", "first_guesses"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.surface import (
    FEWEST_POINTS,
    Round,
    Surface,
    median_of,
    round_through,
    squared_length,
    surface_of,
)

MAX_AXES = 5
"""Axes that are carried on to a circle."""

MOST_LEANING = 0.9
"""Cosine with the axis from which a normal is no wall's, however tapered."""

BEYOND = 0.03
"""Part of its visible length by which a wall goes on past each end that shows no cap:
of a guess that is too short the readings past its end lie on nothing, and a fit does
not reach out for them; one that is too long is drawn in by what shows its end."""

CAP_COSINE = np.cos(np.radians(30.0))
"""Cosine with the axis from which a normal may be a cap's."""

NEAR_COSINE = np.cos(np.radians(10.0))
"""Of the angle below which two axes are taken for one."""

PERCENTILE = 0.01
"""Share of the points beyond each end, or side, of what is seen: strays."""

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


def first_guesses(
    depth: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
    sigma: float,
    tapered: bool = False,
) -> list[Guess]:
    """Guess cylinders from the readings of a region, for each likely axis.

    Args:
        depth: In meters; 0 where there is no reading.
        region: Pixels of the object, wall and caps together.
        camera: Concrete; its pose is not used.
        sigma: Typical deviation of a reading, in meters.
        tapered: Whether to look for frusta, too.

    Returns:
        Guesses in the camera frame: the best of each axis first, those that lie closer
        to the readings before others; none where the readings admit no cylinder.
    """
    surface = surface_of(depth, region, camera, sigma)
    if surface is None:
        return []
    axes = _axes(surface, tapered)
    # Numbers of what is not there are NaN.
    with np.errstate(invalid="ignore", divide="ignore"):
        guesses = _guesses_along(axes, surface, tapered)
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


def _axes(surface: Surface, tapered: bool) -> Float[np.ndarray, "k 3"]:
    """Likely axes, at least 10 degrees apart but for the longest direction."""
    # In single precision, which takes half the time.
    n = surface.normals.astype(np.float32)
    if len(n) < FEWEST_POINTS:
        return surface.drawn
    # Pairs of normals that are far apart in the image, in a fixed pattern.
    first = np.arange(40) * len(n) // 40
    apart = (np.array([[0.21], [0.38], [0.5]]) * len(n)).astype(int)
    others = n[(first + apart) % len(n)]
    pairs = _cross(n[first], others).reshape(-1, 3)
    candidates = [surface.drawn, n[first], pairs[squared_length(pairs) > 0.3**2]]
    if tapered:
        # Normals of one angle with the axis end on a circle across it.
        across = _cross(others[0] - n[first], others[2] - n[first])
        candidates.append(across[squared_length(across) > 0.1**2])
    axes = np.concatenate(candidates, dtype=n.dtype)
    axes /= np.sqrt(squared_length(axes))[:, None]
    order = np.argsort(_unexplained(axes, n[::2], tapered), kind="stable")
    # The cap of a cylinder seen end on: noise in two directions, and axes across the
    # view that explain it as a wall, keep its normal from the front of the list.
    _, vectors = np.linalg.eigh(n.T @ n)
    likely = np.concatenate([vectors[:, 2][None], axes[order[: 3 * MAX_AXES]]])
    refined = _refined(likely, n, tapered)
    likeliest = refined[[np.argmin(_unexplained(refined, n, tapered))]]
    longest, shortest = surface.drawn[:1], surface.drawn[1:]
    likely = [likeliest, longest, refined[:2], shortest, refined[2:]]
    axes = np.concatenate(likely, dtype=float)
    # A rod's image tells its axis better than its normals do, also where they are near.
    return axes[list(dict.fromkeys([*_apart(axes)[:MAX_AXES], 1]))]


def _apart(axes: Float[np.ndarray, "k 3"]) -> list[int]:
    """Places of those axes that are at least 10 degrees from all such before them."""
    is_near = (np.abs(axes @ axes.T) > NEAR_COSINE).tolist()
    kept: list[int] = []
    for place, near in enumerate(is_near):
        if not any(near[other] for other in kept):
            kept.append(place)
    return kept


def _cross(
    a: Float[np.ndarray, "*#k 3"], b: Float[np.ndarray, "*#k 3"]
) -> Float[np.ndarray, "*k 3"]:
    """As `np.cross`, in half its time."""
    after, before = [1, 2, 0], [2, 0, 1]
    return a[..., after] * b[..., before] - a[..., before] * b[..., after]


def _levels(cosine: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k 1"]:
    """Cosine of a tapered wall's normals with each axis."""
    # Of all but the caps' normals.
    middle = median_of(cosine, np.abs(cosine) < MOST_LEANING)[:, None]
    return np.where(np.isfinite(middle), middle, 0)


def _unexplained(
    axes: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "m 3"], tapered: bool
) -> Float[np.ndarray, " k"]:
    """Mean squared sine between each normal and the nearer of wall and cap."""
    cosine = axes @ normals.T
    off_cap = 1 - cosine**2
    if tapered:
        cosine -= _levels(cosine)
    # Of squares, and in place: new arrays would take most of the time.
    miss = np.square(cosine, out=cosine)
    np.minimum(miss, off_cap, out=miss)
    return np.minimum(miss, SIN_TOLERANCE**2, out=miss).mean(axis=1)


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
        cap = np.square(cosine) > 1 - (2 * SIN_TOLERANCE) ** 2
        off_wall = cosine - _levels(cosine) if tapered else cosine
        wall = (np.square(off_wall) < (2 * SIN_TOLERANCE) ** 2) & ~cap
        weight = np.subtract(wall, cap, dtype=normals.dtype)
        scatter = (weight @ products).reshape(-1, 3, 3)
        if tapered:
            total, count = wall @ normals, np.count_nonzero(wall, axis=1)
            mean = total / np.maximum(count, 1)[:, None]
            scatter -= total[:, :, None] * mean[:, None, :]
        _, vectors = np.linalg.eigh(scatter)
        axes = vectors[:, :, 0]
    return axes


def _guesses_along(
    axes: Float[np.ndarray, "k 3"], surface: Surface, tapered: bool
) -> list[Guess]:
    """Guesses from the circle that the wall makes, and from the disc of each cap.

    Of all axes at once, since calls take longer than what they do; the best of each
    axis first.
    """
    middle = surface.points.mean(axis=0)
    # Frames whose third direction is the axis.
    frames = np.concatenate([np.linalg.svd(axes[:, None])[2][:, 1:], axes[:, None]], 1)
    from_camera = (frames @ middle)[..., None]
    local = frames @ (surface.points - middle).T
    # Points in their order along the axis, so that percentiles are found by counting.
    order = np.argsort(local[:, 2], axis=1)[:, None]
    local = np.take_along_axis(local, order, axis=2)
    across, along = local[:, :2], local[:, 2]
    caps = _caps(axes, surface, middle)
    thickness = 0.05 * (along[:, -1:] - along[:, :1])[..., None]
    on_cap = np.abs(along[:, None] - caps[..., None]) <= thickness
    on_wall = ~np.any(on_cap, axis=1)
    circles = [
        _silhouette(across, on_wall, from_camera[:, :2]),
        round_through(across, on_wall),
    ]
    if tapered:
        circles.append(round_through(across, on_wall, along))
    discs = _discs(across, on_cap)
    circle = Round(
        *(
            np.concatenate([disc, np.stack(others, axis=1)], axis=1)
            for disc, *others in zip(discs, *circles, strict=True)
        )
    )
    low, high, misfit = _extended(circle, caps[:, None], local)
    height, place = high - low, (high + low) / 2
    radius = circle.radius + circle.slope * (place - circle.place)
    # What tapers to less than nothing is cut off before.
    steepest = 1.9 * radius / height
    slope = np.clip(circle.slope, -steepest, steepest)
    center = middle + np.concatenate([circle.center, place[..., None]], -1) @ frames
    # Of axes that are near each other the best counts.
    best = misfit.min(axis=1, keepdims=True)
    by_misfit = np.argsort(best[:, 0])
    is_second = misfit > best
    is_second[np.delete(by_misfit, _apart(axes[by_misfit]))] = True
    order = np.lexsort([misfit.ravel(), is_second.ravel()])
    return [
        Guess(
            center=center[k],
            axis=axes[k[0]],
            radius=float(radius[k]),
            height=float(height[k]),
            misfit=float(misfit[k]),
            slope=float(slope[k]),
        )
        for k in zip(*np.divmod(order, misfit.shape[1]), strict=True)
        if np.isfinite(misfit[k])
    ]


def _caps(
    axes: Float[np.ndarray, "k 3"], surface: Surface, middle: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "k 2"]:
    """Places along each axis, from a middle, of the caps that are seen; else NaN.

    A camera sees at most one cap from outside and both from between their planes.
    """
    cosine, along = axes @ surface.normals.T, axes @ surface.normal_points.T
    sign = np.array([[[-1]], [[1]]])
    # A cap that is seen edge on may give normals of either sign; one is true.
    facing = (sign * cosine > CAP_COSINE) & (sign * along < 0)
    # A few stray normals at the edge of the region do not make a cap.
    is_seen = np.count_nonzero(facing, axis=-1) >= max(8, 0.03 * cosine.shape[1])
    if not is_seen.any():
        return np.full((len(axes), 2), np.nan)
    return np.where(is_seen, median_of(along, facing) - axes @ middle, np.nan).T


def _discs(
    across: Float[np.ndarray, "k 2 n"], on_cap: Bool[np.ndarray, "k 2 n"]
) -> Round:
    """Circles of even discs: the mean square distance is half the radius squared."""
    count = np.count_nonzero(on_cap, axis=-1)[..., None]
    sums = on_cap @ np.swapaxes(np.concatenate([across, across**2], axis=1), 1, 2)
    mean = sums / np.where(count < FEWEST_POINTS, np.nan, count)
    center = mean[..., :2]
    radius = np.sqrt(2 * (mean[..., 2:] - center**2).sum(axis=-1))
    return Round(center, radius, 0 * radius, 0 * radius)


def _silhouette(
    across: Float[np.ndarray, "k 2 n"],
    on_wall: Bool[np.ndarray, "k n"],
    from_camera: Float[np.ndarray, "k 2 1"],
) -> Round:
    """Circle as wide as the points appear, behind those in its middle.

    Noise of the readings, which ruins a circle through an arc of few deviations, hardly
    moves the sides.
    """
    last = np.maximum(np.count_nonzero(on_wall, axis=1)[:, None] - 1, 0)
    across = across + from_camera
    ahead_of = across @ on_wall[..., None]
    x, y = np.moveaxis(
        ahead_of / np.sqrt(np.sum(ahead_of**2, axis=1, keepdims=True)), 1, 0
    )
    turned = np.moveaxis(np.array([[-y, x], [x, y]])[..., 0], 2, 0)
    aside, ahead = np.moveaxis(turned @ across, 1, 0)
    ordered = np.sort(np.where(on_wall, aside, np.inf), axis=1)
    rank = np.round(PERCENTILE * last).astype(int)
    low = np.take_along_axis(ordered, rank, axis=1)
    high = np.take_along_axis(ordered, last - rank, axis=1)
    radius, place = (high - low) / 2, (high + low) / 2
    near = on_wall & (np.abs(aside - place) < radius / 3)
    is_seen = np.count_nonzero(near, axis=1, keepdims=True) >= 5
    radius = np.where(is_seen & (radius > 0), radius, np.nan)
    behind = median_of(ahead, near)[:, None] + 0.98 * radius
    center = np.concatenate([place, behind], axis=1)[:, None] @ turned
    radius = radius[:, 0]
    return Round(center[:, 0] - from_camera[..., 0], radius, 0 * radius, 0 * radius)


def _extended(
    circle: Round,
    caps: Float[np.ndarray, "k 1 2"],
    local: Float[np.ndarray, "k 3 n"],
) -> tuple[Float[np.ndarray, "k c"], ...]:
    """Ends of the body over each circle, and its misfit; infinite where there is none.

    The ends are caps, or as far as its wall is seen.

    Args:
        circle: Circles (k, c) of the wall.
        caps: As of `_caps`.
        local: Points in the frames of the circles, ascending along the third direction.
    """
    x, y, along = np.moveaxis(local[:, None], 2, 0)
    x, y = x - circle.center[..., :1], y - circle.center[..., 1:]
    beyond_wall = np.sqrt(x * x + y * y) - circle.radius[..., None]
    if circle.slope.any():
        beyond_wall -= circle.slope[..., None] * (along - circle.place[..., None])
    near = np.abs(beyond_wall) < 0.15 * circle.radius[..., None]
    rank = near.cumsum(axis=-1, dtype=np.int32)
    count = rank[..., -1:]
    tail = np.ceil(PERCENTILE * count)
    seen = [np.argmax(rank >= wanted, axis=-1) for wanted in (tail, count - tail + 1)]
    low, high = (np.take_along_axis(along[:, 0], at, axis=1) for at in seen)
    beyond = BEYOND * (high - low)
    low = np.where(np.isnan(caps[..., 0]), low - beyond, caps[..., 0])
    high = np.where(np.isnan(caps[..., 1]), high + beyond, caps[..., 1])
    radius = circle.radius + circle.slope * ((low + high) / 2 - circle.place)
    is_body = (count[..., 0] >= FEWEST_POINTS) & (high > low) & (radius > 0)
    beyond_cap = np.maximum(low[..., None] - along, along - high[..., None])
    inside = np.minimum(np.maximum(beyond_wall, beyond_cap), 0)
    outside = np.maximum(beyond_wall, 0) ** 2 + np.maximum(beyond_cap, 0) ** 2
    miss = np.minimum(np.sqrt(outside) - inside, 0.3 * radius[..., None])
    return low, high, np.where(is_body, miss.mean(axis=-1), np.inf)
