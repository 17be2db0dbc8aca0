"""Which pixels of an image a fit uses."""

__all__ = [
    "DepthUnitsWarning",
    "object_region",
    "pixel_indices",
    "traced_indices",
    "typical_sigma",
    "warn_of_units",
    "without_edges",
]

import warnings

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.effort import MIN_READINGS
from impostor_jax.fit.problem import BLOCK
from impostor_jax.fit.request import DepthImage, Mask, check_readings
from impostor_jax.fit.surface import cropped, thinned, upper_median
from impostor_jax.sensor.base import AbstractDepthNoise, Reach
from impostor_jax.sensor.gaussian import ConstantNoise

FARTHEST_PLAIN = 100.0
"""Median depth in meters up to which nobody asks whether it is in meters."""

FINEST_SIGMA, COARSEST_SIGMA = 1e-5, 0.1
"""Standard deviations beyond that, over the depth, that a sensor may have."""

TRACED_READINGS = 15872
"""Most readings that a traced fit uses, evenly spaced over its region."""

BUCKETS = tuple(BLOCK << k for k in range(3, 20))
"""Readings are filled up to one of these numbers, so that few sizes are compiled."""


def object_region(
    image: Float[np.ndarray, "h w"],
    mask: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
) -> Bool[np.ndarray, "h w"]:
    """Pixels of the object, those that miss a reading included."""
    check_readings(image, mask)
    if camera.ray_field is not None:
        mask = mask & np.isfinite(np.asarray(camera.ray_field.x))
    return mask


def without_edges(
    depth: DepthImage, region: Mask, noise: AbstractDepthNoise
) -> DepthImage:
    """Leave out a region's readings that may be of what lies beside it.

    As many of the sensor's `edge_reach` pixels are left out as leave enough readings.

    Args:
        depth: In meters; 0 where there is no reading.
        region: Pixels of the object.
        noise: Of the readings.
    """
    reach = noise.edge_reach
    if isinstance(reach, int) and reach == 0:
        return depth
    return _without_edges(depth, region, reach)


def _closed(region: Bool[Array, "h w"]) -> Bool[Array, "h w"]:
    """A region and the holes in it that are less than three pixels wide."""

    def largest(image: Bool[Array, "h w"]) -> Bool[Array, "h w"]:
        padded = jnp.pad(image, 1)
        rows = padded[:-2] | padded[1:-1] | padded[2:]
        return rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]

    # Beyond the border it is as it is at the border.
    grown = jnp.pad(largest(region), 1, mode="edge")
    return region | ~largest(~grown)[1:-1, 1:-1]


@jax.jit
def _without_edges(
    depth: Float[Array, "h w"], region: Bool[Array, "h w"], reach: Reach
) -> Float[Array, "h w"]:
    def narrowed(_, inner: Bool[Array, "h w"]) -> Bool[Array, "h w"]:
        # Beyond the image's border nothing is known to lie.
        padded = jnp.pad(inner, 1, constant_values=True)
        rows = padded[:-2, 1:-1] & padded[2:, 1:-1]
        less = inner & rows & padded[1:-1, :-2] & padded[1:-1, 2:]
        return jnp.where(jnp.sum(less & (depth > 0)) >= MIN_READINGS, less, inner)

    # A hole of a pixel or two is no edge: there the mask just says less.
    inner = jax.lax.fori_loop(0, reach, narrowed, _closed(region))
    return jnp.where(region & ~inner, 0, depth)


def typical_sigma(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    noise: AbstractDepthNoise,
) -> float:
    """Standard deviation of about the middle reading, seen face on, in meters."""
    if isinstance(noise, ConstantNoise):
        # No reading is looked for, and JAX is not asked: 0.2 ms less.
        return float(noise.deviation)
    readings = _some_readings(image, region)
    if not len(readings):
        return float("inf")
    return float(_sigma_face_on(noise, upper_median(readings)))


def _some_readings(
    image: Float[np.ndarray, "h w"], region: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, " n"]:
    """Readings of a region, evenly spaced."""
    box = cropped(region)
    seen = (image[box] * region[box]).ravel()
    return seen[thinned(np.flatnonzero(seen))]


@jax.jit
def _sigma_face_on(
    noise: AbstractDepthNoise, depth: Float[Array, ""]
) -> Float[Array, ""]:
    return noise.sigma(depth, jnp.ones_like(depth))


class DepthUnitsWarning(UserWarning):
    """The depth looks as if it were not in meters."""


def warn_of_units(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    noise: AbstractDepthNoise,
) -> None:
    """Warn where depth is so far, for its noise, that it must be in millimeters.

    No sensor's standard deviation is less than 1e-5 of a distance beyond 100 m (a
    surveyor's scanner has 2e-5, a depth camera 1e-3), and one that is more than a tenth
    of it is a depth camera's, far out of its range. It is a warning, not an error: a
    scene may be rendered without noise and that far, and a scene 1e4 times as large as
    a can, with a noise to match, is fitted as the can is.

    Args:
        image: In meters, or not; 0 where there is no reading.
        region: Pixels of the object.
        noise: Of the readings.
    """
    # A third of the time of looking for the region's.
    if not image.max() > FARTHEST_PLAIN:
        return
    readings = _some_readings(image, region)
    if not len(readings):
        readings = image[image > 0]
    middle = upper_median(readings)
    if not middle > FARTHEST_PLAIN:
        return
    sigma = float(_sigma_face_on(noise, middle))
    if not FINEST_SIGMA * middle < sigma < COARSEST_SIGMA * middle:
        warnings.warn(
            f"depth must be in meters, its median is {middle:.4g} and its sigma "
            f"{sigma:.2g}: is it in millimeters?",
            DepthUnitsWarning,
            # The line that called `fit_cylinder`.
            stacklevel=5,
        )


def pixel_indices(
    region: Bool[np.ndarray, "h w"], most: int | None = None
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Rows and columns of a region's pixels, filled up to one of a few sizes.

    The last `BLOCK` are evenly spread over the region; a row beyond the image,
    of which there may be some before the others, only fills up.

    Args:
        region: Pixels of the object.
        most: How many are taken, evenly spread; all if None.
    """
    box = cropped(region)
    # On a whole image a tenth of the time of `np.nonzero`.
    index = np.flatnonzero(region[box])
    if most is not None and most < len(index):
        index = index[np.arange(most) * len(index) // most]
    count = len(index)
    size = next(size for size in BUCKETS if size >= count)
    if most is not None:
        size = min(size, -(-most // BLOCK) * BLOCK)
    is_some = np.zeros(count, bool)
    is_some[np.arange(BLOCK) * count // BLOCK] = True
    order = np.concatenate([index[~is_some], index[is_some]])
    filled = np.full(size, region.shape[0]), np.zeros(size, int)
    found = np.divmod(order, max(box[1].stop - box[1].start, 1))
    for full, place, side in zip(filled, found, box, strict=True):
        full[size - count :] = place + side.start
    return filled


def traced_indices(
    region: Bool[Array, "h w"], most: int | None = None
) -> tuple[Int[Array, " n"], Int[Array, " n"]]:
    """The same of a region that only the run knows, in one size.

    The last `BLOCK` are evenly spread over it here, too.

    Args:
        region: Pixels of the object.
        most: As in `pixel_indices`, but no more than `TRACED_READINGS`.
    """
    most = min(region.size, TRACED_READINGS, most or TRACED_READINGS)

    def counted(count: Int[Array, " w"], row: Bool[Array, " w"]):
        count = count + row.astype(count.dtype)
        return count, count

    # Row by row, in a tenth of the time of a sum along all pixels; so their order goes
    # along columns.
    counts, rank = jax.lax.scan(counted, jnp.zeros(region.shape[1], int), region)
    rank = (rank + (jnp.cumsum(counts) - counts)[None]).T.reshape(-1)
    count = jnp.minimum(rank[-1], most)
    # Backwards, so that what only fills up comes first.
    place = jnp.arange(-(-most // BLOCK) * BLOCK - 1, -1, -1)
    step = jnp.arange(BLOCK)
    some = step * count // BLOCK
    is_new = (step == 0) | (some != (step - 1) * count // BLOCK)
    # Some step leads to a place where a multiple of the count is next to it.
    scaled = place * BLOCK
    is_some = -(-scaled // jnp.maximum(count, 1)) * count < scaled + BLOCK
    place = jnp.concatenate([place, some])
    used = (place < count) & jnp.concatenate([~is_some, is_new])
    # The first pixel of each rank; ranks are spread out where there are too many.
    wanted = place * jnp.maximum(rank[-1], most) // most + 1
    index = jnp.searchsorted(rank, wanted, side="left").astype(wanted.dtype)
    col, row = jnp.divmod(index, region.shape[0])
    return jnp.where(used, row, region.shape[0]), jnp.where(used, col, 0)
