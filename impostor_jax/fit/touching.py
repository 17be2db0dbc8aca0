"""Readings of an object that may be of what it touches.

Where an object touches another, depth goes on from one to the other, and a mask that
errs by a pixel is not told from a right one by a reading that is no outlier. All along
the foot of a can such readings pull to the same side: 35 of 3000, of the tray that a
can stands in, turned its axis by 5 to 8 standard deviations, for a wall that is seen
from above grazes nearly all rays. Where depth jumps, or the object itself goes on, such
a pixel does no harm.
"""

__all__ = ["going_on", "sigmas_off", "with_unsure"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.camera.ray_table import shows_image
from impostor_jax.effort import MIN_READINGS
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.gather import passed_by
from impostor_jax.fit.per_pixel import law_of
from impostor_jax.fit.problem import RayList
from impostor_jax.fit.regions import (
    CROSS,
    GENTLE,
    SQUARE,
    STEEP,
    jump_parts,
)
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.surface import cropped
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.opencv import cv2
from impostor_jax.sensor.base import AbstractDepthNoise

OFF = 5.0
"""Standard deviations from which a reading is not the body's."""

NEARBY = 5
"""Pixels along rows and columns over which readings beside the object tell together."""

DOUBTED = 1.5
"""Standard deviations by which they may lie off the object in the mean, and by chance
more of `FEW` or less: of four of its own one mean in 400 is farther off."""

FEW = 4

MOST = 6
"""Pixels by which a region may be too large."""

FARTHER = 4.0
"""Sizes of a body up to which it may go on where its end is not seen: no side of a box
is longer than three."""

AROUND = np.array([(k, j) for k in (-1, 0, 1) for j in (-1, 0, 1) if k or j]).T
"""Rows down and columns right to a pixel's neighbors."""


@jax.jit
def going_on(body: AbstractBody, ends_seen: Bool[Array, " e"]) -> AbstractBody:
    """A body that goes on beyond what was seen of it, where no end was."""
    reach = jnp.full(ends_seen.shape, FARTHER * body.size)
    return body.drawn_in(ends_seen, reach)[0]


def with_unsure(seen: Seen, body: AbstractBody, wider: float) -> Seen:
    """An object without what its region has of what it touches.

    From the ring around the region inward, what lies off the body is of another surface
    as far as depth goes on from there. Two more pixels than that may be, too: whether
    they are left out does not depend on what they read.

    Args:
        seen: The object.
        body: About what it is, in the world frame.
        wider: Factor on the deviations of the readings.
    """
    if not shows_image(seen.camera):
        return seen
    box = cropped(seen.region, margin=1)
    # A margin that holds nothing, as wide as is looked inward.
    image, region = np.pad(seen.image[box], 2), np.pad(seen.region[box], 2)
    marks = region.astype(np.uint8)
    # The hole of a pixel or two is the object's.
    closed = cv2.morphologyEx(marks, cv2.MORPH_CLOSE, SQUARE)

    def off(places: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
        # Those of some pixels that lie off the body, all around.
        asked = np.zeros_like(seen.region)
        asked[box] = places[2:-2, 2:-2]
        away = np.pad(sigmas_off(seen._replace(region=asked), body)[box], 2)
        is_far = places & (np.abs(away) > OFF * wider)
        near = places & ~is_far
        total = _sum_nearby(np.where(near, away / wider, 0))
        count = _sum_nearby(near.astype(float))
        most = DOUBTED * np.sqrt(count * np.maximum(count, FEW))
        return is_far | near & (np.abs(total) > most)

    last = (cv2.dilate(marks, CROSS) > closed) & (image > 0)
    if not _beside(last, image, region, seen).any():
        # Before a background that is far away no program is run, or compiled.
        return seen
    left, own, unsure = region, region, np.zeros_like(region)
    for _ in range(MOST):
        other = off(last)
        own = own & ~other
        last = _beside(other, image, left, seen)
        if not last.any():
            break
        left = left & ~last
        unsure |= last | _beside(last, image, left, seen)
    if not unsure.any() or np.sum(own & ~unsure & (image > 0)) < MIN_READINGS:
        return seen
    found = np.zeros((2, *seen.region.shape), bool)
    found[:, *box] = np.stack([own, unsure])[:, 2:-2, 2:-2]
    return seen._replace(region=found[0], unsure=found[1])


def _beside(
    other: Bool[np.ndarray, "h w"],
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    seen: Seen,
) -> Bool[np.ndarray, "h w"]:
    """Pixels of a region that depth goes on to from others beside it.

    All are of an image with a margin of 2 pixels that holds nothing.
    """
    row, col = (place[:, None] for place in np.nonzero(other))
    inward = [(row + k * AROUND[0], col + k * AROUND[1]) for k in range(3)]
    beside, own, behind = (image[place] for place in inward)
    _, is_own, goes_on = (region[place] & (image[place] > 0) for place in inward)
    noisy, width = jump_parts(own, seen.camera, law_of(seen.noise), np)
    step = np.abs(own - behind)
    # What is steep goes on as steeply.
    goes_on &= step <= noisy + STEEP * width
    most = noisy + GENTLE * width + np.where(goes_on, 2 * step, 0)
    touches = is_own & (np.abs(own - beside) <= most)
    found = np.zeros_like(region)
    found[tuple(place[touches] for place in inward[1])] = True
    return found


def _sum_nearby(values: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    border = cv2.BORDER_CONSTANT
    size = NEARBY, NEARBY
    return cv2.boxFilter(values, -1, size, normalize=False, borderType=border)


def sigmas_off(seen: Seen, body: AbstractBody) -> Float[np.ndarray, "h w"]:
    """How far readings lie behind a body, in standard deviations.

    0 where there is none.

    Args:
        seen: The readings.
        body: In the world frame.
    """
    row, col, rays = seen.rays()
    pose = seen.camera.camera_from_world
    off = _sigmas_off(rays, body, pose, law_of(seen.noise))
    away = np.zeros(seen.image.shape)
    away[row[rays.exists], col[rays.exists]] = np.asarray(off)[rays.exists]
    return away


@jax.jit
def _sigmas_off(
    rays: RayList,
    body: AbstractBody,
    pose: RigidTransform | None,
    noise: AbstractDepthNoise,
) -> Float[Array, " n"]:
    """A reading near a body that its ray misses is not the body's.

    The core tells radius and place to a small part of a pixel.
    """
    if pose is not None:
        # Compiled with the rest: alone it takes longer than that.
        body = body.transformed(pose)
    pixels, seen, read, sigma = passed_by(rays, body, noise)
    behind = (pixels.depth - seen.depth) / sigma
    far = jnp.sign(behind) * jnp.maximum(jnp.abs(behind), 2 * OFF)
    away = jnp.where(seen.is_missed, far, behind)
    return jnp.where(read, away, 0)
