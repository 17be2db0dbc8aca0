"""Points and normals of a region of a depth image, for first guesses.

Everything here runs outside JAX, on NumPy and OpenCV.
"""

__all__ = ["MAX_POINTS", "Surface", "surface_of", "thinned", "within_deviations"]

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.sparse import MAX_SLOPE_ERROR, spacing_of, sparse_normals

LARGEST_SIDE = 96
"""Larger regions are reduced by block medians: a first guess needs no more pixels."""

SMALLEST_SIDE = 16
"""Blocks that remain across a region that is reduced against noise."""

WIDEST_WINDOW = 7
"""Readings across the windows of normals where an object is seen densely."""

MAX_SAMPLES = 400
"""Normals that vote for an axis and points that vote for a circle, evenly spaced."""

MAX_POINTS = 1200
"""Points that a guess is compared with."""

NUM_PARTS = 8
"""Parts of a region whose median readings tell how its depth changes."""


class Surface(NamedTuple):
    """Points and normals of the region, and its directions, in the camera frame."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "m 3"]
    normal_points: Float[np.ndarray, "m 3"]
    drawn: Float[np.ndarray, "2 3"]


def _without_lens(
    depth: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Resample an image as the same camera would see it without its lens."""
    if camera.distortion is None:
        return depth, region
    matrix, size = camera.matrix(), (camera.width, camera.height)
    coefficients = np.asarray(camera.distortion, dtype=np.float64)
    module = cv2.fisheye if camera.fisheye else cv2
    maps = module.initUndistortRectifyMap(
        matrix, coefficients, np.eye(3), matrix, size, cv2.CV_32FC1
    )
    seen = np.where(region, depth, 0).astype(np.float32)
    straight = cv2.remap(seen, *maps, cv2.INTER_NEAREST)
    return straight, straight > 0


def surface_of(
    depth: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
    sigma: float,
) -> Surface | None:
    """Points, normals and directions of a region; None where there are too few.

    The depth is resampled without the lens, cropped, reduced and differentiated.

    Args:
        depth: In meters; 0 where there is no reading.
        region: Pixels of the object.
        camera: Concrete; its pose is not used.
        sigma: Typical deviation of a reading, in meters.
    """
    matrix = camera.matrix()
    depth, region = _without_lens(depth, region, camera)
    rows, cols = np.any(region, axis=1), np.any(region, axis=0)
    if not rows.any():
        return None
    top, left = int(np.argmax(rows)), int(np.argmax(cols))
    bottom = len(rows) - int(np.argmax(rows[::-1]))
    right = len(cols) - int(np.argmax(cols[::-1]))
    crop = np.s_[top:bottom, left:right]
    seen = np.where(region[crop], depth[crop], 0)
    if not seen.any():
        return None
    step = _reduction(seen.shape, seen[seen > 0], matrix, sigma)
    reduced = _block_median(seen, step)
    # A block's center is the mean of its pixels' centers.
    cropped = matrix - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
    local = cropped.copy()
    local[:2, 2] -= (step - 1) / 2
    local[:2] /= step
    padded = cv2.copyMakeBorder(reduced, 4, 4, 4, 4, cv2.BORDER_CONSTANT, value=0)
    local[:2, 2] += 4
    smooth = cv2.medianBlur(padded, 5)
    smooth = np.where((padded > 0) & (smooth > 0), smooth, np.nan).astype(np.float32)
    valid = np.isfinite(smooth)
    inner, window = _interior(valid)
    spacing = spacing_of(padded > 0) if window < WIDEST_WINDOW else 0.0
    if spacing > 0:
        # The median of a window with more holes than readings is a hole.
        smooth = np.where(padded > 0, padded, np.nan).astype(np.float32)
        valid = np.isfinite(smooth)
    if np.count_nonzero(valid) < 10:
        return None
    cloud = cv2.depthTo3d(smooth, local)
    cloud = cloud[..., :3].astype(np.float64)
    inverse = 1 / smooth.astype(np.float64)
    if spacing > 0:
        error = sigma / float(np.median(smooth[valid])) * local[0, 0]
        normals, inner = sparse_normals(inverse, local, spacing, error)
    else:
        normals = _normals(inverse, local, window)
        inner = inner & np.isfinite(normals).all(axis=-1)
    index = thinned(np.flatnonzero(inner))
    return Surface(
        points=cloud[valid],
        normals=normals.reshape(-1, 3)[index],
        normal_points=cloud.reshape(-1, 3)[index],
        drawn=_drawn(seen, cropped),
    )


def _normals(
    inverse: Float[np.ndarray, "h w"], matrix: Float[np.ndarray, "3 3"], window: int
) -> Float[np.ndarray, "h w 3"]:
    """Normals, towards the camera, of the planes that fit each window of readings best.

    The inverse depth of a plane is linear in the pixels, so its slopes are the same
    sums over each window; NaN where that holds no reading somewhere.

    References:
        Badino et al., Fast and accurate computation of surface normals from range
        images, ICRA 2011: least squares in the inverse range, as here in the depth.
    """
    offset = np.arange(window) - (window - 1) / 2
    slope, mean = offset / (offset @ offset), np.full(window, 1 / window)

    def filtered(along_row: np.ndarray, along_col: np.ndarray) -> np.ndarray:
        return cv2.sepFilter2D(inverse, cv2.CV_64F, along_row, along_col)

    (fx, _, cx), (_, fy, cy), _ = matrix
    x, y = filtered(slope, mean) * fx, filtered(mean, slope) * fy
    row, col = np.ogrid[: inverse.shape[0], : inverse.shape[1]]
    z = filtered(mean, mean) - x * ((col - cx) / fx) - y * ((row - cy) / fy)
    normals = -np.stack([x, y, z], axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _drawn(
    seen: Float[np.ndarray, "h w"], matrix: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "2 3"]:
    """Directions in space along which the region is longest and shortest in the image.

    Noise as deep as the object is thick leaves nothing of the normals, but the image of
    a rod is still long, and medians of many readings tell how its depth changes. A disc
    is short along its axis where it is seen edge on, its axis across the view.
    """
    index = thinned(np.flatnonzero(seen), MAX_POINTS)
    row, col = np.divmod(index, seen.shape[1])
    z = seen.ravel()[index].astype(float)
    pixels = np.stack([col, row], axis=1).astype(float)
    middle = pixels.mean(axis=0)
    _, vectors = np.linalg.eigh(np.cov((pixels - middle).T))
    shortest, longest = vectors.T
    place = (pixels - middle) @ longest
    # Parts of one size; what is left over is the end.
    order = np.argsort(place)[: len(place) // NUM_PARTS * NUM_PARTS]
    parts = order.reshape(NUM_PARTS, -1)
    places, depths = np.median([place[parts], z[parts]], axis=-1)
    offsets = places - places.mean()
    slope = offsets @ depths / max(offsets @ offsets, 1e-6)
    center = np.linalg.solve(matrix, [*middle, 1])
    # A step along the image from the middle, at the depth there, moves the point so.
    focal = np.diag(matrix)[:2]
    lengthwise = np.array([*(longest / focal), 0]) * depths.mean() + center * slope
    across = np.array([*(shortest / focal), 0])
    across = across - center * (center @ across) / (center @ center)
    found = np.stack([lengthwise, across])
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def _reduction(
    size: tuple[int, int],
    readings: Float[np.ndarray, " n"],
    matrix: Float[np.ndarray, "3 3"],
    sigma: float,
) -> int:
    """Side of the blocks that the image is reduced by.

    A plane through 7x7 medians of blocks of b x b readings, a footprint f apart, has a
    slope that errs by 0.09 sigma / (b^2 f): blocks make that small, but the object must
    keep some of them across its width.
    """
    footprint = float(np.median(readings)) / matrix[0, 0]
    for_noise = np.sqrt(0.09 * sigma / (MAX_SLOPE_ERROR * footprint))
    for_size = -(-max(size) // LARGEST_SIDE)
    return max(1, for_size, min(round(for_noise), min(size) // SMALLEST_SIDE))


def thinned(values: np.ndarray, most: int = MAX_SAMPLES) -> np.ndarray:
    """Keep at most so many entries, evenly spaced."""
    return values[:: -(-len(values) // most)] if len(values) else values


def within_deviations(
    miss: Float[np.ndarray, " n"], scale: float
) -> Bool[np.ndarray, " n"]:
    """Which points lie within 3 deviations, by the median of how far all miss.

    Args:
        miss: Distances, not negative.
        scale: Size of what is seen, to whose rounding all are within.
    """
    return miss <= 3 * 1.4826 * np.median(miss) + 1e-9 * scale


def _block_median(
    depth: Float[np.ndarray, "h w"], step: int
) -> Float[np.ndarray, "h2 w2"]:
    """Median of the readings of each `step` x `step` block; 0 where there are none."""
    if step == 1:
        return depth.astype(np.float32)
    height, width = -(-depth.shape[0] // step), -(-depth.shape[1] // step)
    full = np.zeros((height * step, width * step), np.float32)
    full[: depth.shape[0], : depth.shape[1]] = depth
    blocks = full.reshape(height, step, width, step).swapaxes(1, 2)
    ordered = np.sort(
        np.where(blocks > 0, blocks, np.inf).reshape(height, width, -1), axis=-1
    )
    count = np.isfinite(ordered).sum(axis=-1)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[..., None] // 2, -1)
    return np.where(count > 0, middle[..., 0], 0).astype(np.float32)


def _interior(valid: Bool[np.ndarray, "h w"]) -> tuple[Bool[np.ndarray, "h w"], int]:
    """Pixels whose window lies in the region, for the widest window that leaves some.

    Half a window of missing readings tilts a normal by tens of degrees; a wide window
    has the smaller noise: 1.9 against 2.9 degrees at 1 mm and 0.8 m for 7 and 5 pixels.
    """
    image = valid.astype(np.uint8)
    for window in (WIDEST_WINDOW, 5, 3):
        inner = cv2.erode(image, np.ones((window, window), np.uint8)) > 0
        if np.count_nonzero(inner) >= 50:
            return inner, window
    return valid, 3
