"""Readings at the edges of an image that averages over its pixels.

An image that was made smaller by averaging, smoothed, or taken by a sensor whose pixel
sees an area, mixes what lies on both sides of an edge. A mixed reading is an outlier,
and tells no end. Beside it the object's own surface bends most, and the mean over a
bend lies behind its middle: of cans of 10 to 40 pixels across that were averaged by two
the radius came out 3 to 8 standard deviations too small.

Whether an image averages shows between an object and what lies far behind it: depth
goes from one to the other by way of readings that are of neither.
"""

__all__ = ["without_averaged"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.camera.ray_table import shows_image
from impostor_jax.effort import MIN_READINGS
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.per_pixel import law_of
from impostor_jax.fit.regions import SQUARE, STEEP, jump_parts
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.surface import cropped
from impostor_jax.fit.touching import OFF, sigmas_off
from impostor_jax.opencv import cv2

WIDEST = 3
"""Pixels between an object and its background that may be of neither."""

LEVEL = 0.1
"""Of the way from one to the other, by which a background is level over a pixel, and a
mixed reading before it."""

STEEPEST = 1.5
"""By how much depth falls over the last pixel of a wall that is seen from the side, at
most, in roots of twice its radius times a pixel's width; it is 1 of one across."""

FARTHER = 2.0
"""How many times that far a background begins."""

FEWEST, SHARE = 6, 0.2
"""Places that are mixed, at least, and over all where depth falls to a background: of
images that were averaged by two about a half, and none of what was not."""

USUAL = 0.4
"""Of these places, counted by how many readings are mixed there, the one that tells how
wide what is averaged is: along an edge, and not across, there are more."""


class _Places(NamedTuple):
    """Where depth falls from an object to its background, in an image.

    Attributes:
        last: Pixels where the object is seen last.
        between: Readings of neither that follow each of them, in each direction.
        mixed: Pixels of these.
    """

    last: Bool[np.ndarray, "h w"]
    between: Int[np.ndarray, " n"]
    mixed: Bool[np.ndarray, "h w"]

    @property
    def is_averaged(self) -> bool:
        """Whether so many are mixed that the image must be."""
        num_mixed = np.count_nonzero(self.between)
        return bool(num_mixed >= max(FEWEST, SHARE * len(self.between)))

    @property
    def width(self) -> int:
        """Readings that are mixed across an edge of an image that is averaged."""
        found = np.sort(self.between[self.between > 0])
        return int(found[int(USUAL * len(found))])


def without_averaged(
    seen: Seen, body: AbstractBody, wider: float, is_exact: bool = False
) -> Seen:
    """An object without what its image spoils by averaging, if it does.

    Mixed readings are left out. The object's own beside them tell where it ends, and
    not how deep it is: which do depends on where they lie, and not on what they read.

    Args:
        seen: The object.
        body: About what it is, in the world frame.
        wider: Factor on the deviations of the readings.
        is_exact: Whether the region's edge is the object's.
    """
    if seen.noise.bias.errs_at_edges or not shows_image(seen.camera):
        # What the sensor does at edges is told; points have none.
        return seen
    box = cropped(seen.region, margin=WIDEST + 2)
    image, region = seen.image[box], seen.region[box]
    # The mask may be a pixel too small.
    own = (cv2.dilate(region.astype(np.uint8), SQUARE) > 0) & (image > 0)
    noisy, width = jump_parts(image, seen.camera, law_of(seen.noise), np)
    # That of a cone which goes on past its tip may be negative.
    bend = STEEPEST * np.sqrt(2 * abs(float(body.radius)) * width)
    steepest = np.maximum(bend, STEEP * width) + noisy
    places = _places(image, own, np.zeros_like(own), steepest)
    if not places.is_averaged:
        return seen
    # The far side of a cap may lie between, too.
    asked = np.zeros_like(seen.region)
    asked[box] = places.mixed
    away = np.abs(sigmas_off(seen._replace(region=asked), body)[box])
    places = _places(image, own, places.mixed & (away < OFF * wider), steepest)
    if not places.is_averaged:
        return seen
    # Of what is small, as many as leave enough.
    unsure = np.zeros_like(seen.region) if seen.unsure is None else seen.unsure
    for reach in range(2 * places.width, 0, -1):
        near = cv2.dilate(places.last.astype(np.uint8), SQUARE, iterations=reach - 1)
        left_out = unsure.copy()
        left_out[box] |= region & (near > 0)
        if np.sum(seen.region & ~left_out & (seen.image > 0)) >= MIN_READINGS:
            break
    else:
        return seen
    if is_exact:
        return seen._replace(unsure=left_out)
    mixed = np.zeros_like(seen.region)
    mixed[box] = places.mixed
    image = np.where(mixed, 0, seen.image)
    return seen._replace(image=image, region=seen.region & ~mixed, unsure=left_out)


def _places(
    image: Float[np.ndarray, "h w"],
    own: Bool[np.ndarray, "h w"],
    on_body: Bool[np.ndarray, "h w"],
    steepest: Float[np.ndarray, "h w"],
) -> _Places:
    """Where depth falls from an object to its background, in all four directions.

    Args:
        image: In meters; 0 where there is no reading.
        own: Pixels of the object that hold one.
        on_body: Pixels that are known to be, and are not mixed.
        steepest: By how much the object itself may fall from there.
    """
    falls = own & (cv2.dilate(image, SQUARE) - image > steepest)
    most = steepest[falls][:, None]
    margin = WIDEST + 2
    depth, known = np.pad(image, margin), np.pad(on_body, margin).ravel()
    # Pixels on from each, by step, pixel and direction.
    ways = np.array([1, -1, depth.shape[1], -depth.shape[1]])
    at = np.arange(margin + 1)[:, None, None] * ways
    at = at + np.flatnonzero(np.pad(falls, margin))[:, None]
    read = depth.ravel()[at]
    off = read - read[0] > most
    last, mixed = np.zeros((2, depth.size), bool)
    counts = []
    for between in range(WIDEST + 1):
        first, *inner, background, beyond = read[: between + 3]
        fall = background - first
        level = LEVEL * fall
        found = (fall > FARTHER * most) & (np.abs(beyond - background) < level)
        for k, one in enumerate(inner, start=1):
            found &= off[k] & (background - one > level) & ~known[at[k]]
        last[at[0][found]] = True
        mixed[at[1 : between + 1, found]] = True
        counts.append(np.full(np.count_nonzero(found), between))
    inside = slice(margin, -margin), slice(margin, -margin)
    last, mixed = (marks.reshape(depth.shape)[inside] for marks in (last, mixed))
    return _Places(last, np.concatenate(counts), mixed)
