"""Readings beside the limb of a wall that are mixed with what is behind it.

Where a beam meets a wall's limb with a part of its width, the rest goes on, and the
range is between the two. Such readings begin at the wall: the nearest of them lie
behind it by less than any robust loss knows, and one in thirty drew radii of stems in
by two deviations on the mean, one in ten by ten. What lies far behind shows that there
are some. Rays are left out by how closely they pass the limb, whatever they read.
"""

__all__ = ["rays_clear_of_limb"]

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.fit.seam import about_axis
from impostor_jax.fits.facing import WELL_OUTSIDE
from impostor_jax.primitives.cylinder import Cylinder

LIMB = 0.9
"""Distance of a ray from the axis, in radii, from which it passes the limb closely."""

FAR = 4.0
"""Robust standard deviations from the wall from which a reading is not of it."""

FEWEST = 5
"""Readings behind the limb that show it, at least; beams differ from rays to both
sides, so that they are also more than three times those in front of it."""


def rays_clear_of_limb(
    wall: Cylinder, ends: Float[np.ndarray, "n 3"], starts: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, " n"] | None:
    """Which rays do not pass a limb closely; None where nothing is mixed there.

    Args:
        wall: That was fitted.
        ends: The points, in the world.
        starts: Where each was seen from.
    """
    center, axis = (np.asarray(x, np.float64) for x in (wall.center, wall.axis))
    radius = float(wall.radius)
    along, distance, _ = about_axis(ends, center, axis)
    _, begins, out = about_axis(starts, center, axis)
    # Across the axis: the place on each ray that is nearest; the reading is at 1.
    start, ray = begins[:, None] * out, ends - starts
    ray = ray - (ray @ axis)[:, None] * axis
    square = np.maximum((ray**2).sum(axis=1), np.finfo(float).tiny)
    nearest = -(start * ray).sum(axis=1) / square
    passes = np.linalg.norm(start + nearest[:, None] * ray, axis=1) / radius
    off = distance - radius
    scatter = 1.4826 * float(np.median(np.abs(off)))
    beside = (np.abs(along) < float(wall.height) / 2) & (off > FAR * scatter)
    beside &= (passes > LIMB) & (passes < 1)
    beside &= begins > WELL_OUTSIDE * radius
    behind = np.count_nonzero(beside & (nearest < 1))
    if behind < max(FEWEST, 3 * np.count_nonzero(beside & (nearest > 1))):
        return None
    return passes < LIMB
