"""Which pixels show the object, when the caller gives no mask."""

__all__ = ["nearest_object"]

import cv2
import numpy as np
from jaxtyping import Bool, Float

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
    # a surface 76 degrees from facing the camera.
    jump = 8.5 * sigma + 4 * footprint * depth
    behind = np.zeros_like(valid)
    for axis in (0, 1):
        near, far = _neighbors(axis)
        step = depth[far] - depth[near]
        both = valid[far] & valid[near]
        # The farther side of a jump is cut away, so the nearer object keeps its edge.
        behind[far] |= both & (step > jump[near])
        behind[near] |= both & (step < -jump[far])
    kernel = np.ones((3, 3), np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        (valid & ~behind).astype(np.uint8), connectivity=4
    )
    smallest = max(min_pixels, int(MIN_FRACTION * depth.size))
    best, nearest = valid, np.inf
    for label in range(1, count):
        if stats[label, cv2.CC_STAT_AREA] < smallest:
            continue
        left, top, width, height = stats[label, :4]
        box = np.s_[
            max(top - 2, 0) : top + height + 2, max(left - 2, 0) : left + width + 2
        ]
        part = labels[box] == label
        distance = np.median(depth[box][part])
        if distance >= nearest:
            continue
        grown = cv2.dilate(part.astype(np.uint8), kernel) > 0
        around = cv2.dilate(grown.astype(np.uint8), kernel) > 0
        border = around & ~part & valid[box] & (labels[box] != label)
        # Each border reading against the nearest depth of the component beside it.
        inner = np.where(part, depth[box], np.inf)
        beside = -cv2.dilate(-inner.astype(np.float32), np.ones((5, 5), np.uint8))
        in_front = depth[box][border] > beside[border]
        if border.any() and np.mean(in_front) < 0.5:
            continue
        best, nearest = labels == label, distance
    return best


def _neighbors(axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Index of every pixel but the last, and of its next one, along an axis."""
    if axis == 0:
        return np.s_[:-1, :], np.s_[1:, :]
    return np.s_[:, :-1], np.s_[:, 1:]
