"""Errors that points of a wall share: neighbors, as of bark, and those of a scan.

Points have no rows and columns, but places on the wall: the means of patches scatter by
more than single points let them where neighbors err alike. Of patches that are larger
than what errs alike, that is how many times fewer points there are in effect.

Scans that are moved aside err in patterns as wide as each scan sees. A fit follows the
widest of these. What is left tells how large they are: strips that lie beside each
other err alike, and all of them tell no more of a radius than one.

Points that were seen from one place share the error of its pose. What each place moves
the wall across its axis tells by how many times more than noise these err; a wall that
is not round looks the same.
"""

__all__ = ["DISAGREE", "with_errors_of_places", "with_shared_errors"]

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from impostor_jax.camera.ray_table import turned_to
from impostor_jax.fit.result import Fit

PATCHES = (np.pi / 12, 1.0), (np.pi / 6, 1.0), (np.pi / 6, np.inf)
"""Width of patches in radians, and height over that: what scans share that are aligned
to millimeters is the same from end to end."""

FEWEST_POINTS = 3
"""Of a patch whose mean tells."""

FEWEST_PATCHES = 8
"""That tell by how much their means scatter."""

FOLLOWED = 3
"""Means that radius and center follow."""

MOST_OFF, OF_WALL = 4.0, 0.9
"""Standard deviations from the wall, and half heights from its middle, up to which a
point is of it."""

MOST_PLACES = 16
"""Places that are told apart; of more, parts of the path that they lie on."""

FEWEST_OF_PLACE = 10
"""Points from a place whose motion tells."""

LEAST_APART = 2.0
"""Standard deviations of that from which poses err: to be wrong is to be less sure."""

OF_TWO_PLACES = 9.0
"""Factor on what two places disagree by, of which one direction tells."""

TOLD = 4.0
"""Times that they move a wall by more than noise, squared, from which a reader is told:
deviations are twice as wide."""

DISAGREE = "points that were seen from different places disagree"
"""What he is told of."""

BY_CHANCE = 4.0
"""Standard deviations by which independent errors scatter the means at most."""


def with_shared_errors(fit: Fit, points: Float[np.ndarray, "n 3"], level: float) -> Fit:
    """The fit with deviations as wide as what neighbors share makes them.

    Args:
        fit: Of the points, which takes their errors for independent.
        points: In the world.
        level: Standard deviation of a point.
    """
    return _widened(fit, _times(fit, points, level)) if fit.is_shape else fit


def with_errors_of_places(
    fit: Fit, points: Float[np.ndarray, "n 3"], starts: Float[np.ndarray, "n 3"]
) -> Fit:
    """The fit with deviations as wide as poses make them that disagree.

    Args:
        fit: Of the points, which takes poses for exact.
        points: In the world.
        starts: Where each was seen from.
    """
    if not fit.is_shape or np.all(starts == starts[:1]):
        return fit
    times = _times_of_places(fit, points, _places(starts))
    fit = _widened(fit, times)
    if times < TOLD or fit.asked.doubt:
        return fit
    return fit.noting(
        doubt=f"{DISAGREE} by {np.sqrt(times):.1f} times their noise: poses err, or "
        "the wall is not round; std allows for it"
    )


def _widened(fit: Fit, times: float) -> Fit:
    """A fit of which so many points tell as much as one whose error is its own."""
    if times <= 1:
        return fit
    budget, std = fit.std_budget, fit.std
    noise = budget["noise"]

    def wider(part: Any, whole: Any) -> Float[np.ndarray, " k"]:
        # Of what else a deviation is made of there is no more.
        part, whole = (np.atleast_1d(np.asarray(x, float)) for x in (part, whole))
        is_known = np.isfinite(whole) & (whole > 0)
        share = np.where(is_known, part, 0) / np.where(is_known, whole, 1)
        return np.sqrt(1 + (times - 1) * share**2)

    def widened(value: Any, by: np.ndarray) -> jax.Array:
        return jnp.asarray(value) * jnp.asarray(by, value.dtype)

    names = "axis", "across_axis", "along_axis", "radius", "height"
    parts = [wider(getattr(noise, name), getattr(std, name)) for name in names]
    by = np.concatenate(parts)
    shared = jnp.hypot(budget["correlation"].vector, noise.vector * np.sqrt(times - 1))
    deviation = widened(fit.observed.deviation, by.max(keepdims=True))
    return fit.having(
        covariance=widened(fit.covariance, by[:, None] * by),
        std=replace(std, vector=widened(std.vector, wider(noise.vector, std.vector))),
        std_budget=budget.having("correlation", shared),
        observed=replace(fit.observed, deviation=deviation),
    )


def _places(starts: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """Number of the place that each point was seen from; parts of a path if many."""
    unique, group = np.unique(starts, axis=0, return_inverse=True)
    if len(unique) <= MOST_PLACES:
        return group.ravel()
    middle = starts - starts.mean(axis=0)
    _, _, principal = np.linalg.svd(middle, full_matrices=False)
    order = np.argsort(np.argsort(middle @ principal[0], kind="stable"))
    return order * MOST_PLACES // len(order)


def _times_of_places(
    fit: Fit, points: Float[np.ndarray, "n 3"], group: Int[np.ndarray, " n"]
) -> float:
    """By how many times more than noise places move a wall, squared; 1 if by chance."""
    wall = fit.cylinder
    frame = turned_to(np.asarray(wall.axis, np.float64))
    across = ((points - np.asarray(wall.center, np.float64)) @ frame.T)[:, :2]
    distance = np.linalg.norm(across, axis=1)
    off = distance - float(wall.radius)
    usual = 1.4826 * float(np.median(np.abs(off)))
    near = np.abs(off) < MOST_OFF * max(usual, np.finfo(float).tiny)
    out, off, group = across[near] / distance[near, None], off[near], group[near]
    rest, moved, count = 0.0, [], 0
    for place in np.unique(group):
        own = group == place
        if np.count_nonzero(own) < FEWEST_OF_PLACE:
            continue
        shift, left, rank, _ = np.linalg.lstsq(out[own], off[own], rcond=None)
        if rank < 2:
            continue
        moved.append(float(np.sum((out[own] @ shift) ** 2)))
        rest += float(left[0])
        count += np.count_nonzero(own) - 2
    # Radius and center have followed what all places share.
    freedom = 2 * len(moved) - 3
    if freedom < 1 or not rest > 0:
        return 1.0
    times = float(np.sum(moved)) / freedom / (rest / count)
    if times <= 1 + LEAST_APART * np.sqrt(2 / freedom):
        return 1.0
    # Of few places their scatter is known badly: the variance of Student's t.
    return times * (freedom / (freedom - 2) if freedom > 2 else OF_TWO_PLACES)


def _times(fit: Fit, points: Float[np.ndarray, "n 3"], level: float) -> float:
    """Points that tell as much as one whose error is its own, or 1."""
    wall = fit.cylinder
    frame = turned_to(np.asarray(wall.axis, np.float64))
    radius = float(wall.radius)
    x, y, z = ((points - np.asarray(wall.center, np.float64)) @ frame.T).T
    off = (np.hypot(x, y) - radius) / level
    # A cap's points near its rim are near the wall, too.
    near = (np.abs(off) < MOST_OFF) & (np.abs(z) < OF_WALL * float(wall.height) / 2)
    off, angle, height = off[near], np.arctan2(y, x)[near], z[near] / radius
    found = 1.0
    for width, tall in PATCHES:
        rows = np.floor(height / (tall * width))
        place = np.stack([np.floor(angle / width), rows], axis=1)
        place, patch = np.unique(place, axis=0, return_inverse=True)
        count = np.bincount(patch.ravel())
        tells = count >= FEWEST_POINTS
        total = np.bincount(patch.ravel(), off)[tells]
        place, count = place[tells], count[tells]
        if len(count) < FEWEST_PATCHES:
            continue
        scatter = float(np.sum(total**2 / count)) / (len(count) - FOLLOWED)
        if scatter > 1 + BY_CHANCE * np.sqrt(2 / len(count)):
            if np.isinf(tall) and _are_alike(place[:, 0], total / count, width):
                scatter *= len(count)
            found = max(found, scatter)
    return found


def _are_alike(
    place: Float[np.ndarray, " p"], mean: Float[np.ndarray, " p"], width: float
) -> bool:
    """Whether strips of a wall err as those beside them do: in one pattern.

    The correlation of independent ones, beside a fit that follows three of them, is
    -0.3 on average, and positive in one case of ten; of three scans that are moved
    aside it is 0.4.

    Args:
        place: Numbers of the strips around the axis.
        mean: What they err by.
        width: Of each, in radians.
    """
    around = np.zeros(round(2 * np.pi / width))
    around[place.astype(int)] = mean
    return bool(around @ np.roll(around, 1) > 0)
