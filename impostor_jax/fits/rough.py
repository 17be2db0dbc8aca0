"""Errors that neighboring points of a wall share, as of bark, bends and merged scans.

Points have no rows and columns, but places on the wall: the means of patches scatter by
more than single points let them where neighbors err alike. Of patches that are larger
than what errs alike, that is how many times fewer points there are in effect.
"""

__all__ = ["with_shared_errors"]

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from impostor_jax.camera.ray_table import turned_to
from impostor_jax.fit.result import Fit

PATCHES = (np.pi / 12, np.pi / 6)
"""Width of patches in radians; they are as high as wide."""

FEWEST_POINTS = 3
"""Of a patch whose mean tells."""

FEWEST_PATCHES = 20
"""That tell by how much their means scatter."""

MOST_OFF = 4.0
"""Standard deviations from the wall up to which a point is of it."""

BY_CHANCE = 4.0
"""Standard deviations by which independent errors scatter the means at most."""


def with_shared_errors(fit: Fit, points: Float[np.ndarray, "n 3"], level: float) -> Fit:
    """The fit with deviations as wide as what neighbors share makes them.

    Args:
        fit: Of the points, which takes their errors for independent.
        points: In the world.
        level: Standard deviation of a point.
    """
    if not fit.is_shape:
        return fit
    times = _times(fit, points, level)
    if times <= 1:
        return fit
    root = float(np.sqrt(times))

    def widened(value: jax.Array) -> jax.Array:
        return value * jnp.asarray(root, value.dtype)

    budget = fit.std_budget
    shared = budget["noise"].vector * np.sqrt(times - 1)
    observed = replace(fit.observed, deviation=widened(fit.observed.deviation))
    return fit.having(
        covariance=fit.covariance * jnp.asarray(times, fit.covariance.dtype),
        std=jax.tree.map(widened, fit.std),
        std_budget=budget.having("correlation", shared),
        observed=observed,
    )


def _times(fit: Fit, points: Float[np.ndarray, "n 3"], level: float) -> float:
    """Points that tell as much as one whose error is its own, or 1."""
    wall = fit.cylinder
    frame = turned_to(np.asarray(wall.axis, np.float64))
    radius = float(wall.radius)
    x, y, z = ((points - np.asarray(wall.center, np.float64)) @ frame.T).T
    off = (np.hypot(x, y) - radius) / level
    near = np.abs(off) < MOST_OFF
    off, angle, height = off[near], np.arctan2(y, x)[near], z[near] / radius
    found = 1.0
    for width in PATCHES:
        place = np.stack([np.floor(angle / width), np.floor(height / width)], axis=1)
        _, patch = np.unique(place, axis=0, return_inverse=True)
        count = np.bincount(patch.ravel())
        total = np.bincount(patch.ravel(), off)[count >= FEWEST_POINTS]
        count = count[count >= FEWEST_POINTS]
        if len(count) < FEWEST_PATCHES:
            continue
        scatter = float(np.mean(total**2 / count))
        if scatter > 1 + BY_CHANCE * np.sqrt(2 / len(count)):
            found = max(found, scatter)
    return found
