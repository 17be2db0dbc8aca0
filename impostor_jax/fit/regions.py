"""Which pixels of an image a fit uses."""

__all__ = [
    "BUCKETS",
    "CROSS",
    "GENTLE",
    "NOISY",
    "SQUARE",
    "STEEP",
    "DepthUnitsWarning",
    "chosen_pixels",
    "jump_parts",
    "most_readings",
    "pixel_indices",
    "places_for",
    "sigma_between",
    "sigma_face_on",
    "small_holes",
    "takes_all",
    "traced_indices",
    "typical_sigma",
    "warn_of_units",
]

import warnings
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.arguments import users_level
from impostor_jax.camera.ray_table import Sight
from impostor_jax.fit.per_pixel import law_of
from impostor_jax.fit.problem import BLOCK
from impostor_jax.fit.surface import at_most, cropped, thinned, upper_median
from impostor_jax.opencv import cv2
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.gaussian import ConstantNoise

FARTHEST_PLAIN = 100.0
"""Median depth in meters up to which nobody asks whether it is in meters."""

FINEST_SIGMA, COARSEST_SIGMA = 1e-5, 0.1
"""Standard deviations beyond that, over the depth, that a sensor may have."""

TRACED_READINGS = 15872
"""Most readings that a traced fit uses, evenly spaced over its region."""

MOST_READINGS = BLOCK << 7
"""Of an object that a fit takes, 65536: white errors leave a radius of a thousandth of
itself to a millionth."""

MOST_SHARED = BLOCK << 5
"""The same of a sensor whose readings share errors, of which more tell no more, 16384:
of tins of 17000 pixels the interval of a radius stays as it is, and of a tunnel of
148000 it is a twentieth wider."""

LARGEST_HOLE = 0.1
"""Pixels of a hole in a silhouette, over the region's, that may be a mistake: the far
end of a pipe that is seen from inside is larger."""

BUCKETS = tuple(BLOCK << k for k in range(5, 20, 2))
"""Numbers of readings to which tables are padded, so that few sizes are compiled: the
solver skips blocks of padding, and an assessment of 8192 takes a millisecond."""

FEW_READINGS = 2048
"""That are asked for at most, up to which they have a size of their own."""

NOISY, STEEP = 6.0, 10.0
"""Standard deviations, and widths of a pixel (at an incidence of 84 degrees), by which
neighboring readings of one surface may differ."""

GENTLE = 2.0
"""Widths by which they may per pixel, where no two show how steep the surface is: at an
incidence of 63 degrees."""

NODES = 256
"""Depths at which the host asks for a standard deviation; it interpolates between."""

Image = Float[Array, "*shape"] | Float[np.ndarray, "*shape"]

SQUARE = np.ones((3, 3), np.uint8)
CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
"""A pixel and its eight neighbors, or four."""


def typical_sigma(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    noise: AbstractDepthNoise,
) -> float:
    """Standard deviation of about the middle reading, seen face on, in meters."""
    noise = law_of(noise)
    if isinstance(noise, ConstantNoise):
        # No reading is looked for, and JAX is not asked: 0.2 ms less.
        return float(noise.deviation)
    readings = _some_readings(image, region)
    if not len(readings):
        return float("inf")
    return float(sigma_face_on(noise, upper_median(readings)))


def _some_readings(
    image: Float[np.ndarray, "h w"], region: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, " n"]:
    """Readings of a region, evenly spaced."""
    box = cropped(region)
    seen = (image[box] * region[box]).ravel()
    return seen[thinned(np.flatnonzero(seen))]


@jax.jit
def sigma_face_on(
    noise: AbstractDepthNoise, depth: Float[Array, "*batch"]
) -> Float[Array, "*batch"]:
    """Standard deviation of readings of a surface that rays meet at a right angle."""
    return noise.sigma(depth, jnp.ones_like(depth))


def jump_parts(
    depth: Image, camera: Sight, noise: AbstractDepthNoise, xp: ModuleType
) -> tuple[Image, Image]:
    """By how much noise alone lets neighbors of readings differ, and a pixel's width.

    Args:
        depth: Of the readings, in meters; 0 where there is none, as of the results.
        camera: That took them.
        noise: Of them.
        xp: NumPy, or `jax.numpy` of what is traced.
    """
    has = depth > 0
    away = xp.where(has, depth, 1)
    sigma = sigma_between(noise, away) if xp is np else sigma_face_on(noise, away)
    width = depth * xp.asarray(camera.spacing, depth.dtype)
    return xp.where(has, NOISY * sigma, 0), width


def sigma_between(
    noise: AbstractDepthNoise, depth: Float[np.ndarray, "*shape"]
) -> Float[np.ndarray, "*shape"]:
    """`sigma_face_on` of positive depths, in one program for any number of them."""
    if isinstance(noise, ConstantNoise):
        # JAX is not asked, as in `typical_sigma`.
        return np.full_like(depth, float(noise.deviation))
    if not depth.size:
        return depth
    nodes = np.geomspace(depth.min(), depth.max(), NODES).astype(depth.dtype)
    return np.interp(depth, nodes, np.asarray(sigma_face_on(noise, nodes)))


class DepthUnitsWarning(UserWarning):
    """Depth, or points, look as if they were not in meters, or depth not planar."""


def warn_of_units(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    noise: AbstractDepthNoise,
) -> str:
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

    Returns:
        What it warned of; empty if of nothing.
    """
    # A third of the time of looking for the region's.
    if not image.max() > FARTHEST_PLAIN:
        return ""
    readings = _some_readings(image, region)
    if not len(readings):
        readings = image[image > 0]
    middle = upper_median(readings)
    if not middle > FARTHEST_PLAIN:
        return ""
    sigma = float(sigma_face_on(noise, middle))
    if FINEST_SIGMA * middle < sigma < COARSEST_SIGMA * middle:
        return ""
    doubt = (
        f"depth must be in meters, its median is {middle:.4g} and its sigma "
        f"{sigma:.2g}: is it in millimeters?"
    )
    warnings.warn(doubt, DepthUnitsWarning, stacklevel=users_level())
    return doubt


def most_readings(asked: int | None, noise: AbstractDepthNoise) -> int:
    """How many readings of an object a fit takes at most.

    Args:
        asked: Of an `Effort`.
        noise: Of the readings.
    """
    bias = noise.bias
    return asked or (MOST_SHARED if bias.scales or bias.fields else MOST_READINGS)


def takes_all(region: Bool[np.ndarray, "h w"], most: int) -> bool:
    """Whether a fit takes all pixels of a region; the arguments are of the next."""
    return int(np.count_nonzero(region)) <= most


def chosen_pixels(
    image: Float[np.ndarray, "h w"], region: Bool[np.ndarray, "h w"], most: int
) -> Bool[np.ndarray, "h w"]:
    """Pixels of a region that a fit takes: all, or those that tell most.

    Half of them are readings beside the border of all readings, within 1.5 pixels of
    it, as far as there are so many, and the others are evenly spread. What grazes knows
    most of a radius: of 1024 evenly spread readings the bound of its standard deviation
    is 2.33 times that of all, of these 1.15 times (12 cans of about 5000).

    Args:
        image: In meters; 0 where there is no reading.
        region: Pixels of the object.
        most: How many are taken.
    """
    if takes_all(region, most):
        return region
    box = cropped(region)
    own = region[box]
    reads = own & (image[box] > 0)
    filled = cv2.morphologyEx(
        np.pad(reads, 2).astype(np.uint8), cv2.MORPH_CLOSE, SQUARE
    )
    within = cv2.erode(filled, SQUARE)[2:-2, 2:-2] > 0
    # Where the object ends pixels without a reading tell, too.
    inner = cv2.erode(np.pad(own, 1).astype(np.uint8), SQUARE)[1:-1, 1:-1] > 0
    ends = own & ~reads & ~inner
    parts = [np.flatnonzero(part) for part in (ends, reads & ~within, reads & within)]
    num_ends = min(len(parts[0]), BLOCK, most // 4)
    # Of points in any order, an image of one row, all are beside its border.
    left = most - num_ends
    num_within = min(len(parts[2]), max(left // 2, left - len(parts[1])))
    counts = num_ends, left - num_within, num_within
    chosen = np.zeros(own.size, bool)
    for places, count in zip(parts, counts, strict=True):
        chosen[places[at_most(len(places), count)]] = True
    found = np.zeros_like(region)
    found[box] = chosen.reshape(own.shape)
    return found


def places_for(count: int) -> int:
    """Size of a list that holds so many readings: one of `BUCKETS`."""
    return next(size for size in BUCKETS if size >= count)


def small_holes(region: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels of small holes that a region encloses."""
    holes = ~region
    _, labels, stats, _ = cv2.connectedComponentsWithStats(holes.astype(np.uint8))
    left, top, width, height, area = stats.T
    rows, cols = holes.shape
    inside = (left > 0) & (top > 0) & (left + width < cols) & (top + height < rows)
    inside &= area <= LARGEST_HOLE * np.count_nonzero(region)
    inside[0] = False
    return inside[labels]


def pixel_indices(
    region: Bool[np.ndarray, "h w"], most: int | None = None, least: int = 0
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Rows and columns of a region's pixels, filled up to one of a few sizes.

    The last `BLOCK` are evenly spread over the region; a row beyond the image,
    of which there may be some before the others, only fills up.

    Args:
        region: Pixels of the object.
        most: How many there are at most, as of `chosen_pixels`; any number if None.
        least: How many places there are at least, as for those of another view.
    """
    box = cropped(region)
    # On a whole image a tenth of the time of `np.nonzero`.
    index = np.flatnonzero(region[box])
    count = len(index)
    size = places_for(max(count, least))
    if most is not None and most <= FEW_READINGS:
        size = min(size, -(-most // BLOCK) * BLOCK)
    is_some = np.zeros(count, bool)
    is_some[(np.arange(BLOCK) * count // BLOCK)[: BLOCK * count]] = True
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
