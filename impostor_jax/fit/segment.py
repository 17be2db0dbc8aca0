"""Which pixels show the object, when the caller gives no mask."""

__all__ = ["nearest_object"]

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.fit.surface import MAX_POINTS, thinned

MIN_FRACTION = 5e-4
"""Components smaller than this part of the image are specks, not the object."""


def nearest_object(
    depth: Float[np.ndarray, "h w"], sigma: float, footprint: float, min_pixels: int
) -> Bool[np.ndarray, "h w"]:
    """Nearest large connected component that stands in front of its surroundings.

    Neighbors belong together unless their depths jump by more than noise and a steep
    surface explain. A component stands in front where, across its border, most of the
    readings are farther away; missing readings and the frame say nothing.

    Args:
        depth: In meters; 0 where there is no reading.
        sigma: Standard deviation of a reading, in meters.
        footprint: Width of a pixel at a depth of one meter, in meters.
        min_pixels: Fewest pixels that an object may have.

    Returns:
        The object's pixels; all readings where no component qualifies.
    """
    valid = depth > 0
    # Six sigmas of a difference are 8.5 of a reading; four footprints are the step of
    # a surface 76 degrees from facing the camera. A missing reading is neither behind
    # nor in front of any: so NaN compares.
    known = np.where(valid, depth, np.nan)
    jump = 8.5 * sigma + 4 * footprint * known
    behind = np.zeros_like(valid)
    for axis in (0, 1):
        near, far = _neighbors(axis)
        step = known[far] - known[near]
        # The farther side of a jump is cut away, so the nearer object keeps its edge.
        behind[far] |= step > jump[near]
        behind[near] |= -step > jump[far]
    _, labels, stats, _ = cv2.connectedComponentsWithStats(
        (valid & ~behind).astype(np.uint8), connectivity=4
    )
    smallest = max(min_pixels, int(MIN_FRACTION * depth.size))
    # Label 0 is what belongs to none.
    large = np.flatnonzero(stats[1:, cv2.CC_STAT_AREA] >= smallest) + 1
    found = ((_distance(depth, labels, stats, one), one) for one in large.tolist())
    for _, label in sorted(found):
        if _stands_in_front(depth, labels, stats, label):
            return labels == label
    return valid


def _distance(
    depth: Float[np.ndarray, "h w"],
    labels: Int[np.ndarray, "h w"],
    stats: Int[np.ndarray, "n 5"],
    label: int,
) -> float:
    """Middle depth of a component."""
    box = _box(stats[label])
    readings = depth[box][labels[box] == label]
    return float(np.median(thinned(readings, MAX_POINTS)))


def _stands_in_front(
    depth: Float[np.ndarray, "h w"],
    labels: Int[np.ndarray, "h w"],
    stats: Int[np.ndarray, "n 5"],
    label: int,
) -> bool:
    """Whether most readings across a component's border are farther away, or none are.

    Each border reading is compared with the nearest depth of the component beside it.
    """
    kernel, box = np.ones((3, 3), np.uint8), _box(stats[label], margin=2)
    readings, part = depth[box], labels[box] == label
    grown = cv2.dilate(part.astype(np.uint8), kernel) > 0
    around = cv2.dilate(grown.astype(np.uint8), kernel) > 0
    border = around & ~part & (readings > 0)
    inner = np.where(part, readings, np.inf)
    beside = -cv2.dilate(-inner.astype(np.float32), np.ones((5, 5), np.uint8))
    in_front = readings[border] > beside[border]
    return not border.any() or bool(np.mean(in_front) >= 0.5)


def _box(row: Int[np.ndarray, "5"], margin: int = 0) -> tuple[slice, slice]:
    """Index of the block of pixels that holds a component, and some around it."""
    left, top, width, height = row[:4]
    return np.s_[
        max(top - margin, 0) : top + height + margin,
        max(left - margin, 0) : left + width + margin,
    ]


def _neighbors(axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Index of every pixel but the last, and of its next one, along an axis."""
    if axis == 0:
        return np.s_[:-1, :], np.s_[1:, :]
    return np.s_[:, :-1], np.s_[:, 1:]
