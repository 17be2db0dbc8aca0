"""Floors of bores: what closes a mug, and what a tube stands on.

A through bore has no floor, and its readings lie in front of the wall that a tube has
there: by little beside the corner, where no robust loss knows them. A floor is a place
along the axis where many of the readings lie that are off the wall, and above which the
wall is seen. Readings at it, below it, and of the wall just above it are left out.
"""

__all__ = ["floor_pixels", "fullest_stretch"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.gather import passed_by
from impostor_jax.fit.per_pixel import law_of
from impostor_jax.fit.problem import RayList
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.tube_body import TubeBody
from impostor_jax.primitives.base import in_camera_frame
from impostor_jax.sensor.base import AbstractDepthNoise

OFF = 4.0
"""Standard deviations in front of the wall from which a reading is not of it."""

FEWEST = 20
"""Readings that make a floor, and of the wall above it."""

MOST_STRAY = 0.5
"""Share of the readings off the wall that may lie elsewhere than on a floor."""

THICKNESS = 6.0
"""Standard deviations within which a floor's readings lie along the axis."""

CORNER = 0.2
"""Part of the inner radius above a floor in which its corner may be round: a mug's is,
by 5 mm and more."""


def floor_pixels(seen: Seen, body: TubeBody) -> Bool[np.ndarray, "h w"]:
    """Pixels of a region that show a floor, or the wall beside it; none without one.

    Args:
        seen: The region, and what is read there.
        body: A tube's estimate, in the world frame.
    """
    row, col, rays = seen.rays()
    placed = in_camera_frame(body, seen.camera)
    found = _readings_within(rays, placed, law_of(seen.noise))
    within, front, deep, wall, sigma = map(np.asarray, found)
    none = np.zeros(seen.image.shape, bool)
    off = within & (front > OFF) & (deep > 0)
    if np.count_nonzero(off) < FEWEST:
        return none
    thick = THICKNESS * float(np.median(sigma[off]))
    stretch = fullest_stretch(deep[off], thick)
    if len(stretch) < max(FEWEST, (1 - MOST_STRAY) * np.count_nonzero(off)):
        return none
    floor = float(np.median(stretch))
    margin = max(thick, CORNER * float(body.inner_radius))
    is_wall = within & (np.abs(front) < OFF) & (wall < floor - margin)
    if np.count_nonzero(is_wall) < FEWEST:
        return none
    beside = within & ((wall > floor - margin) | (off & (deep > floor - thick)))
    found = none.copy()
    found[row[beside], col[beside]] = True
    return found


def fullest_stretch(
    places: Float[np.ndarray, " n"], thick: float
) -> Float[np.ndarray, " m"]:
    """Those of some places on a line that lie where most do within so much of it."""
    places = np.sort(places)
    counts = np.searchsorted(places, places + thick, side="right")
    counts -= np.arange(len(places))
    first = int(np.argmax(counts))
    return places[first : first + counts[first]]


@jax.jit
def _readings_within(
    rays: RayList, body: TubeBody, noise: AbstractDepthNoise
) -> tuple[Array, ...]:
    """Which readings lie through the mouth of a bore, and where.

    How far in front of the wall, in standard deviations; how far beyond the mouth along
    the axis, as the wall's point does; and the standard deviation of that place.
    """
    pixels, seen, read, sigma = passed_by(rays, body, noise)
    ahead = seen.local.direction.z
    # From the plane of the end that faces the camera.
    along = seen.local.origin.z + (pixels.depth - seen.foot) * ahead
    sign, half = jnp.sign(ahead), body.height / 2
    front = (seen.depth - pixels.depth) / sigma
    deep, wall = sign * along + half, sign * seen.along + half
    return seen.within & read, front, deep, wall, sigma * jnp.abs(ahead)
