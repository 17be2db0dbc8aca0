"""Depth images whose readings were copied to several pixels each.

A driver that aligns depth to a color camera does so, and so does a program that repeats
pixels to enlarge an image. Neighbors hold equal values then, in runs of a few pixels,
and from one run to the next the depth changes as between native pixels. Rounding makes
equal neighbors as well, but not beside large changes: where a surface is so steep, or
so noisy, that values change by several steps of the rounding to both sides, hardly any
two are equal.
"""

__all__ = ["copies_along", "with_copies"]

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.camera.ray_table import shows_image
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.surface import cropped
from impostor_jax.sensor.aligned import AlignedDepth

LEAST_EQUAL = 0.08
"""Share of equal neighbors, along rows and along columns, from which an image is looked
at. Of noise in single precision none are."""

LEAST_CHANGE = 2
"""Values that occur in the image by which a run's neighbors differ from it at least."""

LONGEST = 12
"""Pixels of the longest run that is of one native pixel."""

LEAST_RUNS = 60
"""Fewest runs that tell."""

LEAST_SHARE = 0.09
"""Pixels of these runs, along rows and along columns, for each reading. Real cameras
hold values beside edges on their own: of cans in images of the first Kinect's kind the
runs are 0.04 to 0.08, and a quarter to a half of them longer than a pixel."""

LEAST_REPEATED = 0.25
"""Share of the runs that are longer than a pixel, of readings that were copied: 0.3 and
more from a scale of 1.44 on. Of ones that were only rounded it is 0 to 0.19."""

MOST_PIXELS = 1 << 13
"""Pixels that are looked at, in the middle rows of a region, which takes 0.7 ms."""


def with_copies(seen: Seen) -> Seen:
    """An object in an image, with what copies err by in its noise if it holds any."""
    if seen.noise.bias.lean is not None:
        # The caller says so.
        return seen
    if not shows_image(seen.camera):
        return seen
    scale = copies_along(seen.image, seen.region)
    if scale is None:
        return seen
    # An array, so that another value does not compile the fit again.
    aligned = AlignedDepth(seen.noise, jnp.asarray(scale, seen.image.dtype))
    return seen._replace(noise=aligned)


def copies_along(
    image: Float[np.ndarray, "h w"], region: Bool[np.ndarray, "h w"]
) -> float | None:
    """Pixels along one native pixel; None where readings were not copied.

    Args:
        image: Depths in meters; 0 where there is no reading.
        region: Pixels of the object.
    """
    box = cropped(region)
    depth = np.where(region[box], image[box], 0)
    height, width = depth.shape
    spare = max(height - MOST_PIXELS // max(width, 1), 0) // 2
    depth = depth[spare : height - spare]
    for one in (depth, depth.T):
        # An image without copies ends here: 0.1 ms.
        pairs = (one[:, 1:] > 0) & (one[:, :-1] > 0)
        equal = np.count_nonzero((one[:, 1:] == one[:, :-1]) & pairs)
        if equal <= LEAST_EQUAL * np.count_nonzero(pairs):
            return None
    # Number of each value among those that occur: one more is a step of the rounding.
    values, number = np.unique(depth, return_inverse=True)
    number = number.reshape(depth.shape) + (0 if values[0] == 0 else 1)
    runs = np.concatenate([_steep_runs(one) for one in (number, number.T)])
    if len(runs) < LEAST_RUNS or runs.sum() < LEAST_SHARE * np.count_nonzero(depth):
        return None
    return float(np.mean(runs)) if np.mean(runs > 1) > LEAST_REPEATED else None


def _steep_runs(number: np.ndarray) -> np.ndarray:
    """Lengths of the runs of equal values in rows whose neighbors differ by far.

    Args:
        number: Of the value of each pixel; 0 where there is no reading.
    """
    # A row ends with no reading, which no run of readings goes across.
    line = np.pad(number, ((0, 0), (0, 1))).ravel()
    starts = np.flatnonzero(np.diff(line, prepend=-1))
    value, length = line[starts], np.diff(starts, append=len(line))
    before, after = value[:-2], value[2:]
    value, length = value[1:-1], length[1:-1]
    counts = (value > 0) & (before > 0) & (after > 0) & (length <= LONGEST)
    counts &= np.abs(value - before) >= LEAST_CHANGE
    counts &= np.abs(value - after) >= LEAST_CHANGE
    return length[counts]
