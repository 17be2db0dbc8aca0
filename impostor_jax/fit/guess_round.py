"""First guess of a cylinder or a frustum from a depth image, with no user input.

Surface normals of the wall are perpendicular to the axis and those of a cap are
parallel to it, so one axis explains both. Axes are proposed by pairs of normals (the
wall), by single normals (a cap) and by the directions in which the region is longest
and shortest in the image, each in a fixed order, and scored by how many normals they
explain. The best few are carried on to a circle across the axis and an extent along it,
and the one whose surface lies closest to the points comes first.

The normals of a frustum's wall make one angle with the axis, not a right one, and its
radius grows along it: where a taper is looked for, both are found as well.

An image is reduced to some of its points outside JAX; what follows is one compiled
program, so that it lets go of Python's lock: threads that fit side by side do not wait.
"""

__all__ = ["guess_cylinders", "guess_frusta"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.rounds import (
    FEWEST_POINTS,
    Round,
    blank_where,
    largest_of,
    median_of,
    round_through,
)
from impostor_jax.fit.surface import MAX_POINTS, Samples
from impostor_jax.geometry.so3 import tangent_basis

MAX_AXES = 5
"""Axes that are carried on to a circle, but for that of the longest direction."""

MOST_GUESSES = 8
"""That are returned."""

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

MOST_STRAYS = int(np.ceil(PERCENTILE * MAX_POINTS)) + 1
"""Points that are picked at each end, of which the last is no stray."""

SIN_TOLERANCE = float(np.sin(np.radians(15.0)))
"""Normals farther than this from perpendicular or parallel do not vote."""


def guess_cylinders(samples: Samples) -> tuple[RoundBody, Bool[Array, " g"]]:
    """Cylinders in the camera frame, and which of them are any.

    The best of each axis come first, those that lie closer to the readings before
    others.
    """
    return _guessed(samples, tapered=False)


def guess_frusta(samples: Samples) -> tuple[RoundBody, Bool[Array, " g"]]:
    """The same of frusta."""
    return _guessed(samples, tapered=True)


def _guessed(samples: Samples, tapered: bool) -> tuple[RoundBody, Bool[Array, " g"]]:
    dtype = jnp.result_type(float)
    with jax.default_matmul_precision("highest"):
        axes, are_axes = _axes(samples, tapered)
        bodies, misfit = _bodies_along(axes, are_axes, samples, tapered)
    bodies = jax.tree.map(lambda field: field.astype(dtype), bodies)
    best = jax.tree.map(lambda field: field[0], bodies)
    around, is_around = _around_camera(best, samples.deepest.astype(dtype))
    bodies = jax.tree.map(_with_second, bodies, around)
    are_bodies = jnp.isfinite(misfit)
    are_bodies = _with_second(are_bodies, is_around & are_bodies[0])
    return blank_where(~are_bodies, bodies), are_bodies


def _with_second(
    values: Shaped[Array, "g ..."], second: Shaped[Array, "..."]
) -> Shaped[Array, "g+1 ..."]:
    return jnp.concatenate([values[:1], second[None], values[1:]])


def _around_camera(
    body: RoundBody, deepest: Float[Array, ""]
) -> tuple[RoundBody, Bool[Array, ""]]:
    """The same wall, drawn out around a camera on its axis: a pipe seen from inside.

    What is seen of a pipe begins in front of the camera, as a can does that is seen end
    on; the fit tells which it is. Its far end shows in so few pixels that only the
    deepest of all readings tells it.
    """
    place = -jnp.sum(body.center * body.axis)
    aside = body.center + place * body.axis
    half = body.height / 2
    is_inside = jnp.sum(aside**2) <= (0.95 * body.radius) ** 2
    behind = jnp.sign(place)
    # The axis of what is seen from inside leads away from the camera.
    reach = (deepest - body.center[2]) / jnp.maximum(jnp.abs(body.axis[2]), 0.5)
    far, near = -behind * jnp.maximum(half, reach), place + behind * body.radius
    low, high = jnp.minimum(far, near), jnp.maximum(far, near)
    center = body.center + (low + high) / 2 * body.axis
    growth = None if body.growth is None else body.slope * (high - low) / 2
    around = RoundBody(center, body.axis, body.radius, high - low, growth)
    return around, is_inside & (jnp.abs(place) >= half)


def _axes(
    samples: Samples, tapered: bool
) -> tuple[Float[Array, "k 3"], Bool[Array, " k"]]:
    """Likely axes, at least 10 degrees apart but for the longest direction.

    The second array tells which of the first are any.
    """
    n, drawn = samples.normals, samples.drawn
    # Pairs of normals that are far apart in the image, in a fixed pattern.
    first = np.arange(40) * len(n) // 40
    apart = (np.array([[0.21], [0.38], [0.5]]) * len(n)).astype(int)
    others = n[(first + apart) % len(n)]
    pairs = jnp.cross(n[first][None], others).reshape(-1, 3)
    candidates = [drawn, n[first], pairs]
    least = [np.zeros(2), np.zeros(40), np.full(len(pairs), 0.3)]
    if tapered:
        # Normals of one angle with the axis end on a circle across it.
        candidates.append(jnp.cross(others[0] - n[first], others[2] - n[first]))
        least.append(np.full(40, 0.1))
    axes = jnp.concatenate(candidates)
    length = jnp.sqrt(jnp.sum(axes**2, axis=1))
    axes = axes / jnp.maximum(length, 1e-6)[:, None]
    unexplained = _unexplained(axes, n[::2], tapered)
    is_any = length >= np.concatenate(least, dtype=length.dtype)
    unexplained = jnp.where(is_any, unexplained, jnp.inf)
    _, order = jax.lax.top_k(-unexplained, 3 * MAX_AXES)
    # The cap of a cylinder seen end on: noise in two directions, and axes across the
    # view that explain it as a wall, keep its normal from the front of the list.
    _, vectors = jnp.linalg.eigh(n.T @ n)
    refined = _refined(jnp.concatenate([vectors[:, 2][None], axes[order]]), n, tapered)
    likeliest = refined[jnp.argmin(_unexplained(refined, n, tapered))]
    longest, shortest = drawn
    axes = jnp.stack([likeliest, longest, *refined[:2], shortest, *refined[2:]])
    places = np.arange(len(axes))
    are_any = (samples.num_normals >= FEWEST_POINTS) | (places == 1) | (places == 4)
    kept = _apart(axes, are_any)
    # A rod's image tells its axis better than its normals do, also where they are near.
    kept = (kept & (jnp.cumsum(kept) <= MAX_AXES)) | (places == 1)
    rank, chosen = jax.lax.top_k(jnp.where(kept, -places, -len(axes)), MAX_AXES + 1)
    return axes[chosen], rank > -len(axes)


def _apart(axes: Float[Array, "k 3"], are_any: Bool[Array, " k"]) -> Bool[Array, " k"]:
    """Which axes are at least 10 degrees from all such before them."""
    is_near = jnp.abs(axes @ axes.T) > NEAR_COSINE

    def with_next(place: Int[Array, ""], kept: Bool[Array, " k"]) -> Bool[Array, " k"]:
        return kept.at[place].set(are_any[place] & ~jnp.any(is_near[place] & kept))

    return jax.lax.fori_loop(0, len(axes), with_next, jnp.zeros(len(axes), bool))


def _off_wall(cosine: Float[Array, "k m"], tapered: bool) -> Float[Array, "k m"]:
    """Cosines of normals with each axis, less that of the wall's normals."""
    if not tapered:
        return cosine
    # Of all but the caps' normals.
    middle = median_of(cosine, jnp.abs(cosine) < MOST_LEANING)[:, None]
    return cosine - jnp.where(jnp.isfinite(middle), middle, 0)


def _unexplained(
    axes: Float[Array, "k 3"], normals: Float[Array, "m 3"], tapered: bool
) -> Float[Array, " k"]:
    """Mean squared sine between each normal and the nearer of wall and cap."""
    cosine = axes @ normals.T
    miss = jnp.minimum(_off_wall(cosine, tapered) ** 2, 1 - cosine**2)
    return jnp.minimum(miss, SIN_TOLERANCE**2).mean(axis=1)


def _refined(
    axes: Float[Array, "k 3"], normals: Float[Array, "m 3"], tapered: bool
) -> Float[Array, "k 3"]:
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
        is_wall = wall.astype(normals.dtype)
        votes = is_wall - cap.astype(normals.dtype)
        scatter = (votes @ products).reshape(-1, 3, 3)
        if tapered:
            total, count = is_wall @ normals, jnp.sum(is_wall, axis=1)
            mean = total / jnp.maximum(count, 1)[:, None]
            scatter -= total[:, :, None] * mean[:, None, :]
        _, vectors = jnp.linalg.eigh(scatter)
        axes = vectors[:, :, 0]
    return axes


def _bodies_along(
    axes: Float[Array, "k 3"],
    are_axes: Bool[Array, " k"],
    samples: Samples,
    tapered: bool,
) -> tuple[RoundBody, Float[Array, " g"]]:
    """Bodies from the circle that the wall makes, and from the disc of each cap.

    The best of each axis first; their misfit is infinite where there are no more.
    """
    middle = samples.points.mean(axis=0)
    # Frames whose third direction is the axis.
    frames = jnp.concatenate([jax.vmap(tangent_basis)(axes), axes[:, None]], axis=1)
    from_camera = frames @ middle[None, :, None]
    local = frames @ (samples.points - middle[None]).T[None]
    across, along = local[:, :2], local[:, 2]
    caps = _caps(axes, samples, middle)
    length = along.max(axis=1) - along.min(axis=1)
    on_cap = jnp.abs(along[:, None] - caps[..., None]) <= 0.05 * length[:, None, None]
    on_wall = ~jnp.any(on_cap, axis=1)
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
            jnp.concatenate([disc, jnp.stack(others, axis=1)], axis=1)
            for disc, *others in zip(discs, *circles, strict=True)
        )
    )
    low, high, misfit = _extended(circle, caps[:, None], local, fewest)
    misfit = jnp.where(are_axes[:, None], misfit, jnp.inf)
    height, place = high - low, (high + low) / 2
    radius = circle.radius + circle.slope * (place - circle.place)
    # What tapers to less than nothing is cut off before.
    steepest = 1.9 * radius / height
    slope = jnp.clip(circle.slope, -steepest, steepest)
    center = jnp.concatenate([circle.center, place[..., None]], -1) @ frames
    center = middle[None, None] + center
    # Of axes that are near each other the best counts.
    best = misfit.min(axis=1)
    by_misfit = jnp.argsort(best)
    is_near = ~_apart(axes[by_misfit], jnp.ones(len(axes), bool))
    is_second = misfit > best[:, None]
    is_second |= jnp.zeros(len(axes), bool).at[by_misfit].set(is_near)[:, None]
    order = jnp.lexsort((misfit.ravel(), is_second.ravel()))[:MOST_GUESSES]
    axes = jnp.broadcast_to(axes[:, None], center.shape)
    growth = (slope * height / 2,) if tapered else ()
    fields = (center, axes, radius, height, *growth)
    fields = [field.reshape(-1, *field.shape[2:])[order] for field in fields]
    return RoundBody(*fields), misfit.ravel()[order]


def _caps(
    axes: Float[Array, "k 3"], samples: Samples, middle: Float[Array, "3"]
) -> Float[Array, "k 2"]:
    """Places along each axis, from a middle, of the caps that are seen; else NaN.

    A camera sees at most one cap from outside and both from between their planes.
    """
    cosine, along = axes @ samples.normals.T, axes @ samples.normal_points.T
    sign = jnp.array([-1, 1], cosine.dtype)[None, :, None]
    # A cap that is seen edge on may give normals of either sign; one is true.
    facing = (sign * cosine[:, None] > CAP_COSINE) & (sign * along[:, None] < 0)
    # A few stray normals at the edge of the region do not make a cap.
    part = jnp.mean(facing, axis=-1, dtype=along.dtype)
    is_seen = part >= jnp.maximum(8 / samples.num_normals, 0.03)
    place = median_of(along[:, None], facing) - (axes @ middle[:, None])
    return jnp.where(is_seen, place, jnp.nan)


def _discs(
    across: Float[Array, "k 2 n"],
    on_cap: Bool[Array, "k 2 n"],
    fewest: Float[Array, ""],
) -> Round:
    """Circles of even discs: the mean square distance is half the radius squared."""
    counts = on_cap.astype(across.dtype)
    count = counts.sum(axis=-1, keepdims=True)
    moments = jnp.concatenate([across, across**2], axis=1)
    sums = counts @ jnp.swapaxes(moments, 1, 2)
    mean = sums / jnp.where(count < fewest, jnp.nan, count)
    center = mean[..., :2]
    radius = jnp.sqrt(2 * (mean[..., 2:] - center**2).sum(axis=-1))
    return Round(center, radius, 0 * radius, 0 * radius)


def _silhouette(
    across: Float[Array, "k 2 n"],
    on_wall: Bool[Array, "k n"],
    from_camera: Float[Array, "k 2 1"],
    copies: Float[Array, ""],
) -> Round:
    """Circle as wide as the points appear, behind those in its middle.

    Noise of the readings, which ruins a circle through an arc of few standard
    deviations, hardly moves the sides.
    """
    across = across + from_camera
    x, y = jnp.moveaxis(across @ on_wall[..., None].astype(across.dtype), 1, 0)
    length = jnp.sqrt(x * x + y * y)
    x, y = x / length, y / length
    turned = jnp.stack([-y, x, x, y], axis=-1).reshape(-1, 2, 2)
    aside, ahead = jnp.moveaxis(turned @ across, 1, 0)
    num_points = jnp.sum(on_wall, axis=1, dtype=across.dtype)
    rank = jnp.round(PERCENTILE * (num_points - 1)).astype(jnp.int32)
    high = largest_of(aside, on_wall, rank, MOST_STRAYS)[:, None]
    low = -largest_of(-aside, on_wall, rank, MOST_STRAYS)[:, None]
    radius, place = (high - low) / 2, (high + low) / 2
    near = on_wall & (jnp.abs(aside - place) < radius / 3)
    is_seen = jnp.sum(near, axis=1, dtype=copies.dtype)[:, None] >= 5 * copies
    radius = jnp.where(is_seen & (radius > 0), radius, jnp.nan)
    behind = median_of(ahead, near)[:, None] + 0.98 * radius
    center = jnp.concatenate([place, behind], axis=1)[:, None] @ turned
    radius = radius[:, 0]
    return Round(center[:, 0] - from_camera[..., 0], radius, 0 * radius, 0 * radius)


def _extended(
    circle: Round,
    caps: Float[Array, "k 1 2"],
    local: Float[Array, "k 3 n"],
    fewest: Float[Array, ""],
) -> tuple[Float[Array, "k c"], Float[Array, "k c"], Float[Array, "k c"]]:
    """Ends of the body over each circle, and its misfit; infinite where there is none.

    The ends are caps, or as far as its wall is seen.

    Args:
        circle: Circles (k, c) of the wall.
        caps: As of `_caps`.
        local: Points in the frames of the circles.
        fewest: Points that a wall is made of.
    """
    x, y, along = jnp.moveaxis(local[:, None], 2, 0)
    x, y = x - circle.center[..., :1], y - circle.center[..., 1:]
    beyond_wall = jnp.sqrt(x * x + y * y) - circle.radius[..., None]
    beyond_wall -= circle.slope[..., None] * (along - circle.place[..., None])
    near = jnp.abs(beyond_wall) < 0.15 * circle.radius[..., None]
    count = jnp.sum(near, axis=-1, dtype=along.dtype)
    rank = jnp.ceil(PERCENTILE * count).astype(jnp.int32) - 1
    high = largest_of(along, near, rank, MOST_STRAYS)
    low = -largest_of(-along, near, rank, MOST_STRAYS)
    beyond = BEYOND * (high - low)
    low = jnp.where(jnp.isnan(caps[..., 0]), low - beyond, caps[..., 0])
    high = jnp.where(jnp.isnan(caps[..., 1]), high + beyond, caps[..., 1])
    radius = circle.radius + circle.slope * ((low + high) / 2 - circle.place)
    is_body = (count >= fewest) & (high > low) & (radius > 0)
    beyond_cap = jnp.maximum(low[..., None] - along, along - high[..., None])
    inside = jnp.minimum(jnp.maximum(beyond_wall, beyond_cap), 0)
    outside = jnp.maximum(beyond_wall, 0) ** 2 + jnp.maximum(beyond_cap, 0) ** 2
    miss = jnp.minimum(jnp.sqrt(outside) - inside, 0.3 * radius[..., None])
    return low, high, jnp.where(is_body, miss.mean(axis=-1), jnp.inf)
