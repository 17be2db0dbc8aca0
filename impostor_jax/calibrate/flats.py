"""What an image shows of planes, and how far its readings lie off them.

Errors over depth to the power with which they grow are alike all over a plane. Readings
near a jump, a hole or a crease are left out: there a sensor leans, which is no noise.
"""

__all__ = ["Flat", "flat_of", "without_bends"]

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.find.planes import PlaneRegions, planes_of
from impostor_jax.find.view import View, view_of
from impostor_jax.fit.regions import SQUARE
from impostor_jax.opencv import cv2
from impostor_jax.sensor.base import AbstractDepthNoise

FEWEST_PIXELS = 300
"""Of a plane: fewer tell its own three numbers and little else."""

CLEAR = 5.0
"""Standard deviations between two planes, at least, as the search has them."""

SAME = 0.5
"""Share of a plane from which another that is near there is the same."""

BLOCK = 8
"""Pixels across a block whose mean tells whether it is on the plane."""

BENT = 5.0
"""Standard deviations of the means of blocks from which one is not on the plane."""

MEDIAN_SQUARE = 0.455
"""Of normal errors, in variances."""

NUM_HALVES = 20
"""Of an interval, to find a variance in."""

MOST_BENT = 0.1
"""Of the blocks of a plane that may be off it; one with more is of two surfaces."""

NUM_TRIMS = 10
"""Times that planes are fitted without those, at most."""

NUM_FITS = 3
"""Times a plane is fitted, each with the depths that the last one has."""


class Flat(NamedTuple):
    """The planes of an image. All is 0 where there is none.

    Attributes:
        labels: Number of the plane from 1.
        depth: Of the plane, in meters.
        cosine: Of the incidence.
        error: Readings less the plane, over its depth to the power.
        terms: What the error changes by with each of a plane's three numbers.
    """

    labels: Int[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]
    cosine: Float[np.ndarray, "h w"]
    error: Float[np.ndarray, "h w"]
    terms: Float[np.ndarray, "3 h w"]

    @property
    def num_planes(self) -> int:
        """Number of planes."""
        return int(self.labels.max(initial=0))


def flat_of(
    depth: Float[np.ndarray, "h w"],
    camera: AbstractCamera,
    usable: Bool[np.ndarray, "h w"],
    noise: AbstractDepthNoise,
    power: float,
    margin: int,
) -> Flat:
    """The planes of an image.

    Args:
        depth: Readings in meters; 0 where there is none.
        camera: That took them.
        usable: Pixels that may be used.
        noise: Of the readings, in which all deviations from planes are counted.
        power: Of the depth, with which errors grow.
        margin: Pixels beside the edge of what lies on a plane that are left out.
    """
    view = view_of(depth, camera, noise, depth.size)
    regions = planes_of(view, view.valid & usable)
    labels = np.where(_is_apart(view, regions), regions.labels, 0)
    none, terms = np.zeros(labels.shape), np.zeros((3, *labels.shape))
    found = Flat(np.zeros_like(labels), none, none.copy(), none.copy(), terms)
    number = 0
    for label in range(1, labels.max(initial=0) + 1):
        on = _without_border(labels == label, margin)
        if np.count_nonzero(on) >= FEWEST_PIXELS:
            number += 1
            found.labels[on] = number
            _fit(view, on, power, found)
    return found


def _is_apart(view: View, regions: PlaneRegions) -> Bool[np.ndarray, "h w"]:
    """Pixels where no other plane is so near that a reading may be taken for its own.

    Near a crease those of two planes were told apart by how far they err.
    """
    alone = np.ones(view.depth.shape, bool)
    depths = [a * view.x + b * view.y + c for a, b, c in regions.planes.tolist()]
    own = np.choose(regions.labels, [np.zeros_like(view.x), *depths])
    for number, other in enumerate(depths, start=1):
        is_near = np.abs(own - other) < CLEAR * view.linear_sigma
        for plane in range(1, len(depths) + 1):
            on = regions.labels == plane
            # What is near all over is a part of the same one, beyond an object.
            if plane != number and np.mean(is_near[on]) < SAME:
                alone[on] &= ~is_near[on]
    return alone


def _without_border(
    region: Bool[np.ndarray, "h w"], margin: int
) -> Bool[np.ndarray, "h w"]:
    """A region's pixels that are farther than a margin from its edge.

    A hole of a pixel or two is a reading that is missing, and no edge.
    """
    # Beyond the image nothing is on the plane: there a window is cut as at an edge.
    whole = np.pad(region.view(np.uint8), margin + 1)
    whole = cv2.morphologyEx(whole, cv2.MORPH_CLOSE, SQUARE)
    inner = cv2.erode(whole, SQUARE, iterations=margin) > 0
    return region & inner[margin + 1 : -margin - 1, margin + 1 : -margin - 1]


def _fit(view: View, on: Bool[np.ndarray, "h w"], power: float, found: Flat) -> None:
    """Fit a plane to pixels, all of one weight, and write down what it says of them."""
    x, y, z = (part[on].astype(float) for part in (view.x, view.y, view.depth))
    rows = np.stack([x, y, np.ones_like(x)])
    linear = 1 / z if view.is_central else z
    grows = 2 - power if view.is_central else -power
    plane, middle = np.zeros(3), z
    for _ in range(NUM_FITS):
        scale = middle**grows
        plane = np.linalg.lstsq((rows * scale).T, linear * scale)[0]
        middle = 1 / (plane @ rows) if view.is_central else plane @ rows
    # Of a n . p = 1, and of z = a x + b y + c.
    normal = plane if view.is_central else plane * [1, 1, 0] - [0, 0, 1]
    cosine = np.abs(view.views[on] @ normal) / np.linalg.norm(normal)
    found.depth[on] = middle
    found.cosine[on] = np.clip(cosine, 0, 1)
    found.error[on] = (z - middle) / middle**power
    found.terms[:, on] = rows * middle**grows


def without_bends(
    flats: Sequence[Flat], variances: Sequence[Float[np.ndarray, "h w"]]
) -> list[Flat]:
    """Planes without what lies off them by more than any smooth error does.

    Where a wall meets a table that is hardly inclined to it, noise hides the crease,
    and what is beyond is taken for the plane's. A warp is seen on all planes, so the
    scatter of the means of blocks tells how far one may lie off.

    Args:
        flats: Planes of all images.
        variances: Of white noise, over depth to twice the power.
    """
    for _ in range(NUM_TRIMS):
        means, noises, counts = zip(
            *(_block_means(*pair) for pair in zip(flats, variances, strict=True)),
            strict=True,
        )
        known = [count >= BLOCK * BLOCK / 2 for count in counts]
        mean, noise = (
            np.concatenate([x[there] for x, there in zip(parts, known, strict=True)])
            for parts in (means, noises)
        )
        if not len(mean):
            break
        shared = _shared(mean, noise)
        bent = [
            _whole(
                there, there & (means[k] ** 2 > BENT**2 * (shared + noises[k])), flat
            )
            for k, (there, flat) in enumerate(zip(known, flats, strict=True))
        ]
        if not any(there.any() for there in bent):
            break
        flats = [_refitted(*pair) for pair in zip(flats, bent, strict=True)]
    return list(flats)


def _whole(
    known: Bool[np.ndarray, " b"], bent: Bool[np.ndarray, " b"], flat: Flat
) -> Bool[np.ndarray, " b"]:
    """Blocks that are left out: all of a plane where too many are."""
    height, width = (-(-size // BLOCK) for size in flat.labels.shape)
    plane = np.arange(len(known)) // (height * width)
    number, off = np.bincount(plane, known), np.bincount(plane, bent)
    return bent | (off > MOST_BENT * number)[plane]


def _shared(mean: Float[np.ndarray, " n"], noise: Float[np.ndarray, " n"]) -> float:
    """Variance of means beyond that of their noise, from the middle ones."""
    low, high = 0.0, float(np.median(mean**2)) / MEDIAN_SQUARE
    for _ in range(NUM_HALVES):
        middle = (low + high) / 2
        is_more = np.median(mean**2 / (middle + noise)) > MEDIAN_SQUARE
        low, high = (middle, high) if is_more else (low, middle)
    return high


def _block_means(
    flat: Flat, variance: Float[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, " b"], Float[np.ndarray, " b"]]:
    """Means of the errors of blocks of each plane, their noise, and their pixels."""
    on, block = flat.labels > 0, _blocks(flat)
    count = np.bincount(block[on], minlength=block.max() + 1)
    safe = np.maximum(count, 1)
    mean, noise = (
        np.bincount(block[on], part[on], len(count)) / safe
        for part in (flat.error, variance)
    )
    return mean, noise / safe, count.astype(float)


def _blocks(flat: Flat) -> Int[np.ndarray, "h w"]:
    """Number of the block of each pixel, of each plane apart."""
    rows, cols = np.indices(flat.labels.shape) // BLOCK
    across = cols.max() + 1
    return (flat.labels * (rows.max() + 1) + rows) * across + cols


def _refitted(flat: Flat, bent: Bool[np.ndarray, " b"]) -> Flat:
    """Planes without some of the blocks."""
    if not bent.any():
        return flat
    labels = np.where(bent[_blocks(flat)], 0, flat.labels)
    error = np.zeros_like(flat.error)
    for plane in range(1, flat.num_planes + 1):
        on = labels == plane
        if np.count_nonzero(on) < FEWEST_PIXELS:
            labels[on] = 0
            continue
        terms = flat.terms[:, on].T
        error[on] = flat.error[on] - terms @ np.linalg.lstsq(terms, flat.error[on])[0]
    return flat._replace(labels=labels, error=error)
