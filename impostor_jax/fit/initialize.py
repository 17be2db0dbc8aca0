"""First guess of a cylinder from a depth image, with no user input.

Surface normals of the wall are perpendicular to the axis and those of a cap are
parallel to it, so one axis explains both. Axes are proposed by pairs of normals (the
wall), by single normals (a cap) and by the directions in which the region is longest
and shortest in the image, each in a fixed order, and scored by how many normals they
explain. The best few are carried on to a circle across the axis and an extent along it,
and the one whose surface lies closest to the points comes first.

Everything here runs outside JAX, on NumPy, OpenCV and scikit-image.
"""

__all__ = ["Guess", "first_guesses"]

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float
from skimage.measure import CircleModel

from impostor_jax.camera.pinhole import PinholeCamera

LARGEST_SIDE = 96
"""Larger regions are reduced by block medians: a first guess needs no more pixels."""

SMALLEST_SIDE = 16
"""Blocks that remain across a region that is reduced against noise."""

MAX_SLOPE_ERROR = 0.05
"""Standard deviation of a normal, in radians, up to which no blocks are needed."""

MAX_SAMPLES = 400
"""Normals that vote for an axis and points that vote for a circle, evenly spaced."""

MAX_POINTS = 1200
"""Points that a guess is compared with."""

NUM_PARTS = 8
"""Parts of a region whose median readings tell how its depth changes."""

MAX_AXES = 5
"""Axes that are carried on to a circle."""

SIN_TOLERANCE = np.sin(np.radians(15.0))
"""Normals farther than this from perpendicular or parallel do not vote."""


class Guess(NamedTuple):
    """A cylinder in the camera frame, in meters, and how far the points lie from it."""

    center: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float
    height: float
    misfit: float


class _Surface(NamedTuple):
    """Points and normals of the region, and its directions, in the camera frame."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "m 3"]
    normal_points: Float[np.ndarray, "m 3"]
    drawn: Float[np.ndarray, "2 3"]


def first_guesses(
    depth: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
    sigma: float,
) -> list[Guess]:
    """Guess cylinders from the readings of a region, for each likely axis.

    Args:
        depth: In meters; 0 where there is no reading.
        region: Pixels of the object, wall and caps together.
        camera: Concrete; its pose is not used.
        sigma: Typical deviation of a reading, in meters.

    Returns:
        Guesses in the camera frame: the best of each axis first, those that lie closer
        to the readings before others; none where the readings admit no cylinder.
    """
    straight = _without_lens(depth, region, camera)
    surface = _surface(*straight, camera.matrix(), sigma)
    if surface is None:
        return []
    ranked = [
        (place, guess)
        for axis in _axes(surface)
        for place, guess in enumerate(
            sorted(_guesses_along(axis, surface), key=lambda guess: guess.misfit)
        )
    ]
    # The second of an axis comes after the first of all.
    ranked.sort(key=lambda entry: (entry[0] > 0, entry[1].misfit))
    guesses = [guess for _, guess in ranked]
    around = [_around_camera(guess) for guess in guesses[:1]]
    return [*guesses[:1], *(guess for guess in around if guess), *guesses[1:]]


def _around_camera(guess: Guess) -> Guess | None:
    """The same wall, drawn out around a camera on its axis: a pipe seen from inside.

    What is seen of a pipe begins in front of the camera, as a can does that is seen end
    on; the fit tells which it is.
    """
    place = -float(guess.center @ guess.axis)
    aside = guess.center + place * guess.axis
    if np.linalg.norm(aside) > 0.95 * guess.radius or abs(place) < guess.height / 2:
        return None
    low = min(-guess.height / 2, place - guess.radius)
    high = max(guess.height / 2, place + guess.radius)
    center = guess.center + (low + high) / 2 * guess.axis
    return guess._replace(center=center, height=high - low)


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


def _surface(
    depth: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    matrix: Float[np.ndarray, "3 3"],
    sigma: float,
) -> _Surface | None:
    """Crop, reduce and differentiate the region's depth."""
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
    if np.count_nonzero(valid) < 10:
        return None
    cloud = cv2.depthTo3d(smooth, local)
    inner, window = _interior(valid)
    estimator = cv2.RgbdNormals.create(
        smooth.shape[0],
        smooth.shape[1],
        cv2.CV_32F,
        local,
        window,
        50.0,
        cv2.RgbdNormals_RGBD_NORMALS_METHOD_FALS,
    )
    estimator.cache()
    normals = estimator.apply(cloud)[..., :3].astype(np.float64)
    cloud = cloud[..., :3].astype(np.float64)
    inner &= np.isfinite(normals).all(axis=-1)
    index = _thinned(np.flatnonzero(inner))
    return _Surface(
        points=cloud[valid],
        normals=normals.reshape(-1, 3)[index],
        normal_points=cloud.reshape(-1, 3)[index],
        drawn=_drawn(seen, cropped),
    )


def _drawn(
    seen: Float[np.ndarray, "h w"], matrix: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "2 3"]:
    """Directions in space along which the region is longest and shortest in the image.

    Noise as deep as the object is thick leaves nothing of the normals, but the image of
    a rod is still long, and medians of many readings tell how its depth changes. A disc
    is short along its axis where it is seen edge on, its axis across the view.
    """
    index = _thinned(np.flatnonzero(seen), MAX_POINTS)
    row, col = np.divmod(index, seen.shape[1])
    z = seen.ravel()[index].astype(float)
    pixels = np.stack([col, row], axis=1).astype(float)
    middle = pixels.mean(axis=0)
    _, vectors = np.linalg.eigh(np.cov((pixels - middle).T))
    shortest, longest = vectors.T
    place = (pixels - middle) @ longest
    parts = np.array_split(np.argsort(place), NUM_PARTS)
    places = np.array([np.median(place[part]) for part in parts])
    depths = np.array([np.median(z[part]) for part in parts])
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


def _thinned(values: np.ndarray, most: int = MAX_SAMPLES) -> np.ndarray:
    """Keep at most so many entries, evenly spaced."""
    return values[:: -(-len(values) // most)] if len(values) else values


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
    for window in (7, 5, 3):
        inner = cv2.erode(image, np.ones((window, window), np.uint8)) > 0
        if np.count_nonzero(inner) >= 50:
            return inner, window
    return valid, 3


def _axes(surface: _Surface) -> list[Float[np.ndarray, "3"]]:
    """Candidate axes, at least 10 degrees apart."""
    n = surface.normals
    if len(n) < 10:
        return [*surface.drawn]
    # Pairs of normals that are far apart in the image, in a fixed pattern.
    first = np.linspace(0, len(n) - 1, 64).astype(int)
    candidates = [surface.drawn, n[first]]
    for part in (0.21, 0.38, 0.5):
        pair = np.cross(n[first], n[(first + int(part * len(n))) % len(n)])
        candidates.append(pair[np.linalg.norm(pair, axis=1) > 0.3])
    axes = np.concatenate(candidates)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    order = np.argsort(_unexplained(axes, n), kind="stable")
    # The cap of a cylinder seen end on: noise in two directions, and axes across the
    # view that explain it as a wall, keep its normal from the front of the list.
    _, vectors = np.linalg.eigh(n.T @ n)
    likely = np.concatenate([vectors[:, 2][None], axes[order[: 4 * MAX_AXES]]])
    first, *others = _refined(likely, n)
    longest, shortest = surface.drawn
    kept = []
    for axis in (first, longest, *others[:1], shortest, *others[1:]):
        if all(abs(axis @ other) < np.cos(np.radians(10.0)) for other in kept):
            kept.append(axis)
        if len(kept) == MAX_AXES:
            break
    return kept


def _unexplained(
    axes: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, " k"]:
    """Mean squared sine between each normal and the nearer of wall and cap."""
    cosine = np.abs(axes @ normals.T)
    sine = np.sqrt(np.maximum(1 - cosine**2, 0))
    miss = np.minimum(np.minimum(cosine, sine), SIN_TOLERANCE)
    return np.mean(miss**2, axis=1)


def _refined(
    axes: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, "k 3"]:
    """Least-squares axes of the normals that each explains.

    They minimize the sum of (n.a)^2 over the wall's normals and of 1 - (n.a)^2 over the
    caps': the eigenvector to the smallest eigenvalue of a difference of scatters.
    """
    products = (normals[:, :, None] * normals[:, None, :]).reshape(-1, 9)
    for _ in range(3):
        cosine = np.abs(axes @ normals.T)
        wall = cosine < 2 * SIN_TOLERANCE
        cap = cosine > np.sqrt(1 - (2 * SIN_TOLERANCE) ** 2)
        scatter = (wall.astype(float) - cap) @ products
        _, vectors = np.linalg.eigh(scatter.reshape(-1, 3, 3))
        axes = vectors[:, :, 0]
    return axes


def _guesses_along(axis: Float[np.ndarray, "3"], surface: _Surface) -> list[Guess]:
    """Guesses from the circle that the wall makes, and from the disc of each cap."""
    points = _thinned(surface.points, MAX_POINTS)
    basis = np.linalg.svd(axis[None])[2][1:]
    across, along = points @ basis.T, points @ axis
    caps = _caps(axis, surface)
    thickness = 0.05 * float(np.ptp(along))
    on_wall = np.ones(len(points), dtype=bool)
    circles = []
    for end in caps.values():
        on_cap = np.abs(along - end) <= thickness
        on_wall &= ~on_cap
        if np.count_nonzero(on_cap) >= 10:
            middle = across[on_cap].mean(axis=0)
            # In an even disc the mean square distance is half the radius squared.
            squared = np.mean(np.sum((across[on_cap] - middle) ** 2, axis=1))
            circles.append((middle, float(np.sqrt(2 * squared))))
    if np.count_nonzero(on_wall) >= 10:
        circles.append(_circle(_thinned(across[on_wall])))
        circles.append(_silhouette(across[on_wall]))
    found = (circle for circle in circles if circle is not None)
    guesses = [_extended(axis, basis, circle, caps, across, along) for circle in found]
    return [guess for guess in guesses if guess is not None]


def _silhouette(
    points: Float[np.ndarray, "n 2"],
) -> tuple[Float[np.ndarray, "2"], float] | None:
    """Circle as wide as the points appear, behind those in its middle.

    Noise of the readings, which ruins a circle through an arc of few deviations, hardly
    moves the sides.
    """
    view = points.mean(axis=0)
    distance = np.linalg.norm(view)
    if not distance > 0:
        return None
    view = view / distance
    aside, ahead = points @ np.array([-view[1], view[0]]), points @ view
    low, high = np.percentile(aside, (1, 99))
    radius = float(high - low) / 2
    near = np.abs(aside - (low + high) / 2) < radius / 3
    if np.count_nonzero(near) < 5 or not radius > 0:
        return None
    middle = np.array([-view[1], view[0]]) * (low + high) / 2
    return middle + view * (np.median(ahead[near]) + 0.98 * radius), radius


def _extended(
    axis: Float[np.ndarray, "3"],
    basis: Float[np.ndarray, "2 3"],
    circle: tuple[Float[np.ndarray, "2"], float],
    caps: dict[int, float],
    across: Float[np.ndarray, "n 2"],
    along: Float[np.ndarray, " n"],
) -> Guess | None:
    """Cylinder over a circle, from cap to cap or as far as its wall is seen."""
    middle, radius = circle
    distance = np.linalg.norm(across - middle, axis=1)
    near_wall = np.abs(distance - radius) < 0.15 * radius
    if np.count_nonzero(near_wall) < 10:
        return None
    low, high = np.percentile(along[near_wall], (1, 99))
    low, high = caps.get(-1, float(low)), caps.get(1, float(high))
    if not high > low:
        return None
    beyond_wall = distance - radius
    beyond_cap = np.maximum(low - along, along - high)
    outside = np.hypot(np.maximum(beyond_wall, 0), np.maximum(beyond_cap, 0))
    inside = np.minimum(np.abs(beyond_wall), np.abs(beyond_cap))
    is_inside = (beyond_wall < 0) & (beyond_cap < 0)
    miss = np.where(is_inside, inside, outside)
    return Guess(
        center=middle @ basis + (low + high) / 2 * axis,
        axis=axis,
        radius=radius,
        height=high - low,
        misfit=float(np.mean(np.minimum(miss, 0.3 * radius))),
    )


def _caps(axis: Float[np.ndarray, "3"], surface: _Surface) -> dict[int, float]:
    """Positions along the axis of the caps that are seen, by the sign of their normal.

    A camera sees at most one cap from outside and both from between their planes.
    """
    cosine, along = surface.normals @ axis, surface.normal_points @ axis
    caps = {}
    for sign in (-1, 1):
        # A cap that is seen edge on may give normals of either sign; one is true.
        facing = (sign * cosine > np.cos(np.radians(30.0))) & (sign * along < 0)
        # A few stray normals at the edge of the region do not make a cap.
        if np.count_nonzero(facing) >= max(8, 0.03 * len(cosine)):
            caps[sign] = float(np.median(along[facing]))
    return caps


def _circle(
    points: Float[np.ndarray, "n 2"],
) -> tuple[Float[np.ndarray, "2"], float] | None:
    """Circle through most of the points: fitted, trimmed at 3 deviations, repeated."""
    scale = float(np.ptp(points, axis=0).max())
    if not scale > 0:
        return None
    kept, middle, radius = points, np.zeros(2), np.inf
    for _ in range(3):
        model = CircleModel.from_estimate(kept)
        if not model:
            return None
        middle, radius = np.asarray(model.center), float(model.radius)
        miss = np.abs(np.linalg.norm(points - middle, axis=1) - radius)
        kept = points[miss <= 3 * 1.4826 * np.median(miss) + 1e-9 * scale]
        if len(kept) < 10:
            return None
    # A circle far larger than what is seen of it is a plane.
    return (middle, radius) if radius < 50 * scale else None
