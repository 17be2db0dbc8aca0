"""Which pixels show the object, when the caller gives no mask."""

__all__ = ["nearest_object"]

import cv2
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.fit.surface import cropped, thinned, upper_median

MIN_FRACTION = 5e-4
"""Components smaller than this part of the image are specks, not the object."""

NEIGHBORS = (np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])
"""Index of every pixel but the last, and of its next one, along each axis."""


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
    # nor in front of any.
    farthest = depth * depth.dtype.type(1 + 4 * footprint)
    farthest += 8.5 * sigma
    farthest[~valid] = np.inf
    behind = np.zeros_like(valid)
    for near, far in NEIGHBORS:
        # The farther side of a jump is cut away, so the nearer object keeps its edge.
        behind[far] |= depth[far] > farthest[near]
        behind[near] |= depth[near] > farthest[far]
    # OpenCV's statistics take three times as long as the components.
    count, labels = cv2.connectedComponents(
        (valid & ~behind).view(np.uint8), connectivity=4
    )
    sizes = np.bincount(labels.ravel(), minlength=count)
    smallest = max(min_pixels, int(MIN_FRACTION * depth.size))
    # Label 0 is what belongs to none.
    parts = [labels == one + 1 for one in np.flatnonzero(sizes[1:] >= smallest)]
    distance = [float(upper_median(thinned(depth[part]))) for part in parts]
    for place in np.argsort(distance, kind="stable"):
        if _stands_in_front(depth, parts[place]):
            return parts[place]
    return valid


def _stands_in_front(
    depth: Float[np.ndarray, "h w"], part: Bool[np.ndarray, "h w"]
) -> bool:
    """Whether most readings across a component's border are farther away, or none are.

    Each border reading is compared with the nearest depth of the component beside it.
    """
    kernel = np.ones((5, 5), np.uint8)
    # With what lies beside it.
    rows, cols = ((max(side.start - 2, 0), side.stop + 2) for side in cropped(part))
    box = slice(*rows), slice(*cols)
    readings, part = depth[box], part[box]
    around = cv2.dilate(part.view(np.uint8), kernel) > 0
    border = around & ~part & (readings > 0)
    beside = cv2.erode(np.where(part, readings, np.inf).astype(np.float32), kernel)
    in_front = readings[border] > beside[border]
    return not border.any() or bool(np.mean(in_front) >= 0.5)
