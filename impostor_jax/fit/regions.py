"""Which pixels of an image a fit uses."""

__all__ = [
    "bucket",
    "object_region",
    "pixel_indices",
    "some_pixels",
    "surroundings",
    "typical_sigma",
]

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.request import MIN_READINGS, check_readings
from impostor_jax.fit.segment import nearest_object
from impostor_jax.fit.solve import START_READINGS
from impostor_jax.sensor.base import AbstractDepthNoise

BUCKETS = tuple(size << k for k in range(14) for size in (2048, 3072))
"""Readings are filled up to one of these numbers, so that few sizes are compiled."""


def object_region(
    image: Float[np.ndarray, "h w"],
    mask: Bool[np.ndarray, "h w"] | None,
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
) -> Bool[np.ndarray, "h w"]:
    """Pixels of the object, those that miss a reading included."""
    check_readings(image, mask)
    if mask is None:
        sigma = typical_sigma(image, image > 0, noise)
        footprint = 1 / min(float(camera.fx), float(camera.fy))
        mask = nearest_object(image, sigma, footprint, MIN_READINGS)
    if camera.ray_field is not None:
        mask = mask & np.isfinite(np.asarray(camera.ray_field.x))
    return mask


def typical_sigma(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    noise: AbstractDepthNoise,
) -> float:
    """Deviation of the region's middle reading, seen face on, in meters."""
    readings = image[region & (image > 0)]
    if not len(readings):
        return float("inf")
    middle = jnp.asarray(np.median(readings))
    return float(noise.sigma(middle, jnp.ones((), middle.dtype)))


def bucket(count: int) -> int:
    """Number of entries that this many pixels are filled up to."""
    return next(size for size in BUCKETS if size >= count)


def pixel_indices(
    region: Bool[np.ndarray, "h w"], size: int
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Rows and columns of a region's pixels; a row beyond the image only fills up."""
    # On a whole image a tenth of the time of `np.nonzero`.
    index = np.flatnonzero(region)
    row, col = np.full(size, region.shape[0]), np.zeros(size, int)
    row[: len(index)], col[: len(index)] = np.divmod(index, region.shape[1])
    return row, col


def some_pixels(
    region: Bool[np.ndarray, "h w"],
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Rows and columns of pixels that are evenly spread over a region."""
    count = max(int(np.count_nonzero(region)), START_READINGS)
    row, col = pixel_indices(region, count)
    some = np.arange(START_READINGS) * count // START_READINGS
    return row[some], col[some]


def surroundings(
    region: Bool[np.ndarray, "h w"],
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Pixels around a region, evenly spread over half its size more on each side."""
    rows, cols = np.nonzero(region.any(axis=1))[0], np.nonzero(region.any(axis=0))[0]
    reach = (max(rows[-1] - rows[0], cols[-1] - cols[0]) + 2) // 2
    top, left = max(rows[0] - reach, 0), max(cols[0] - reach, 0)
    near = ~region[top : rows[-1] + reach + 1, left : cols[-1] + reach + 1]
    index = np.flatnonzero(near)
    some = np.linspace(0, len(index) - 1, START_READINGS).astype(int)
    if not len(index):
        return np.full(START_READINGS, region.shape[0]), np.zeros(START_READINGS, int)
    row, col = np.divmod(index[some], near.shape[1])
    return row + top, col + left
