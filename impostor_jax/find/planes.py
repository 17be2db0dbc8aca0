"""The planes of a depth image: table, walls, floors, faces of boxes.

Where `View.linear` is looked at, a plane is linear in the rays: a cell's moments fit
it, and those of many cells add up. Planes grow over the cells that lie on them, and are
kept where they are not significantly curved.
"""

__all__ = ["PlaneRegions", "planes_of", "primitives_of"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.find.view import View
from impostor_jax.geometry.so3 import directions_across
from impostor_jax.opencv import cv2

CELL = 8
"""Pixels across a cell: its 64 readings tell a plane from a wall of a few cells."""

FEWEST_CELLS = 40
"""Cells of a plane: of the caps of cans and the faces of small boxes are fewer."""

FLAT = 3.0
"""Mean square of the deviations of a cell from its own plane, at most."""

REACH = 2
"""Cells around the one that a plane grows from that it is first fitted to."""

LEAST_FLAT = 20
"""Cells among those 25 that are flat."""

CELL_LIMIT = 2.0
"""Root mean square of the deviations of a cell on a plane, at most."""

AGREEING = 0.8
"""Cosine between the slopes of a cell and its plane, at least."""

LEAST_SIGMA = 1e-6
"""Of a reading, over the median of all: single precision."""

PIXEL_LIMIT = 4.0
"""Deviations within which a reading lies on a plane."""

MOST_PLANES, MOST_SEEDS, MOST_STEPS = 24, 200, 12
"""Bounds of the time: planes, cells to grow from, and steps of each growth."""

MOST_SAMPLED = 4000
"""Readings by which a plane is told from something curved."""

SIGNIFICANT = 8.0
"""Standard deviations of the curvature of something curved, at least."""

LEAST_SAG = 0.03
"""Its sagitta over its size, at least: errors that pixels share make it significant."""

ROUND = 0.04
"""Root mean square of the distances of a disc's border from a circle, over its radius:
of a square's it is 0.11, of an ellipse's 0.35 times how much its half axes differ."""

MOST_OF_DISC = 0.1
"""Part of an image that a disc takes, at most: what is larger other things stand on."""

FEWEST_AROUND = 50
"""Pixels of a border that tells a circle."""


class PlaneRegions(NamedTuple):
    """Planes, and what lies on them.

    Attributes:
        labels: Number of the plane from 1; 0 where there is none.
        planes: Slopes along x and y and the value at 0 of `View.linear`.
        noise: How many times larger than said the sensor's noise is on them; 1 or more.
        shared: Pixels that share an error, by the deviations of cells of `CELL` x
            `CELL`: 1 where readings err independently, at most `CELL` squared.
    """

    labels: Int[np.ndarray, "h w"]
    planes: Float[np.ndarray, "n 3"]
    noise: float
    shared: float


def primitives_of(
    view: View, regions: PlaneRegions
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """A point of each plane and its normal, for `Plane`, in the camera's frame.

    Returns:
        Points in the middle of what is seen, in meters, and unit normals that face the
        camera.
    """
    count = len(regions.planes)
    flat = regions.labels.ravel()
    pixels = np.maximum(np.bincount(flat, minlength=count + 1), 1)[1:]
    x, y = (
        np.bincount(flat, part.ravel(), minlength=count + 1)[1:] / pixels
        for part in (view.x, view.y)
    )
    one, (slope_x, slope_y, value) = np.ones(count), regions.planes.T
    linear = slope_x * x + slope_y * y + value
    if view.is_central:
        point = np.stack([x, y, one]) / linear
    else:
        point = np.stack([x, y, linear])
    return point.T, _normals(view, regions.planes)


def planes_of(view: View, valid: Bool[np.ndarray, "h w"]) -> PlaneRegions:
    """Find the planes among the readings that are valid."""
    readings = _Readings.of(view, valid)
    cells = _Cells.of(readings, valid)
    noise = cells.noise
    numbers, planes = _grown(view, readings, cells, noise)
    labels = _labeled(view, valid, numbers, planes, noise)
    shared = _shared(cells, numbers.ravel(), planes, noise)
    stacked = np.array(planes).reshape(-1, 3)
    labels[np.isin(labels, _discs(view, labels, stacked))] = 0
    return PlaneRegions(labels, stacked, noise, shared)


def _discs(
    view: View, labels: Int[np.ndarray, "h w"], planes: Float[np.ndarray, "n 3"]
) -> list[int]:
    """Numbers of the planes whose border is a circle: caps of what is seen end on."""
    found, normals = [], _normals(view, planes)
    flat = labels.ravel()
    pixels = np.bincount(flat, minlength=len(planes) + 1)
    for k in range(1, len(planes) + 1):
        if not 0 < pixels[k] <= MOST_OF_DISC * flat.size:
            continue
        one = (labels == k).view(np.uint8)
        contours, _ = cv2.findContours(one, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        col, row = max(contours, key=len)[:, 0].T
        if len(row) < FEWEST_AROUND:
            continue
        places = view.points[row, col] @ directions_across(normals[k - 1]).T
        middle = places.mean(axis=0)
        off = places - middle
        # The circle |p|^2 = 2 c.p + r^2 - |c|^2 through all of them.
        terms = np.column_stack([2 * off, np.ones(len(off))])
        solution = np.linalg.lstsq(terms, np.sum(off**2, axis=1), rcond=None)[0]
        radius = np.sqrt(solution[2] + solution[:2] @ solution[:2])
        distance = np.linalg.norm(off - solution[:2], axis=1)
        if np.sqrt(np.mean((distance - radius) ** 2)) < ROUND * radius:
            found.append(k)
    return found


def _normals(view: View, planes: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit normals of planes of `PlaneRegions`, towards the camera."""
    if view.is_central:
        # It is slope_x X + slope_y Y + value Z = 1, and the camera on the side of 0.
        normals = -planes
    else:
        normals = np.column_stack([planes[:, :2], -np.ones(len(planes))])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


class _Readings(NamedTuple):
    """Readings, in double precision: squares of many deviations are subtracted.

    Attributes:
        rows: x and y of the ray, 1, and what is linear.
        weight: Reciprocal of its variance; 0 where there is none.
    """

    rows: Float[np.ndarray, "4 h w"]
    weight: Float[np.ndarray, "h w"]

    @staticmethod
    def of(view: View, valid: Bool[np.ndarray, "h w"]) -> "_Readings":
        sigma, known = view.linear_sigma, valid & (view.linear_sigma > 0)
        # What lies beyond the horizon of a floor is as good as at infinity.
        least = LEAST_SIGMA * float(np.median(sigma[known])) if known.any() else 1.0
        weight = np.where(known, 1 / np.maximum(sigma, least) ** 2, 0)
        linear = np.where(valid, view.linear, 0)
        rows = np.empty((4, *linear.shape))
        for k, row in enumerate((view.x, view.y, 1, linear)):
            rows[k] = row
        return _Readings(rows, weight)


class _Cells(NamedTuple):
    """Cells of the image, row by row.

    Attributes:
        shape: Rows and columns of cells.
        number: Readings of each.
        moments: Weighted sums of the products of rows of readings.
        normal: Directions of the cells' own planes in the space of the rays.
        misfit: Mean squares of the deviations from them; infinite where half of the
            readings or more are missing.
    """

    shape: tuple[int, int]
    number: Float[np.ndarray, " c"]
    moments: Float[np.ndarray, "c 4 4"]
    normal: Float[np.ndarray, "c 3"]
    misfit: Float[np.ndarray, " c"]

    @staticmethod
    def of(readings: _Readings, valid: Bool[np.ndarray, "h w"]) -> "_Cells":
        number = _summed(valid.astype(float))
        moments = np.empty((4, 4, *number.shape))
        for i in range(4):
            weighted = readings.weight * readings.rows[i]
            for j in range(i, 4):
                # The third row is of ones.
                product = weighted if j == 2 else weighted * readings.rows[j]
                moments[i, j] = moments[j, i] = _summed(product)
        moments = np.ascontiguousarray(moments.reshape(4, 4, -1).transpose(2, 0, 1))
        own = _fitted(moments)
        shape, number = (number.shape[0], number.shape[1]), number.ravel()
        misfit = _squares(moments, own) / np.maximum(number - 3, 1)
        misfit = np.where(number >= CELL * CELL / 2, misfit, np.inf)
        return _Cells(shape, number, moments, _directions(own), misfit)

    @property
    def noise(self) -> float:
        """Factor of the sensor's noise, from the flattest third of the cells."""
        known = self.misfit[np.isfinite(self.misfit)]
        if len(known) < FEWEST_CELLS:
            return 1.0
        return max(float(np.sqrt(np.quantile(known, 0.3))), 1.0)


def _summed(image: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "r c"]:
    """Sums over cells; those at the lower and right border may be cut."""
    height, width = image.shape
    rows, cols = -(-height // CELL), -(-width // CELL)
    if (height, width) != (rows * CELL, cols * CELL):
        image = np.pad(image, ((0, rows * CELL - height), (0, cols * CELL - width)))
    # Along columns first, where neighbors are added at once.
    return (
        image.reshape(rows, CELL, -1).sum(axis=1).reshape(rows, cols, CELL).sum(axis=2)
    )


def _fitted(moments: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b 3"]:
    """Planes by least squares."""
    left, right = moments[..., :3, :3], moments[..., :3, 3:]
    # So little that it decides only what the readings leave open.
    trace = np.trace(left, axis1=-2, axis2=-1)[..., None, None]
    return np.linalg.solve(left + (1e-12 * trace + 1e-30) * np.eye(3), right)[..., 0]


def _squares(
    moments: Float[np.ndarray, "c 4 4"], plane: Float[np.ndarray, "*#c 3"]
) -> Float[np.ndarray, " c"]:
    """Sums of the squares of the deviations of cells from planes."""
    full = np.concatenate([plane, -np.ones((*plane.shape[:-1], 1))], axis=-1)
    full = np.broadcast_to(full, (len(moments), 4))
    # Without noise it is the difference of equal numbers, and rounded to one below 0.
    return np.maximum(np.einsum("ki,kij,kj->k", full, moments, full), 0)


def _directions(planes: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
    length = np.linalg.norm(planes, axis=-1, keepdims=True)
    return planes / np.maximum(length, 1e-12)


def _grown(
    view: View, readings: _Readings, cells: _Cells, noise: float
) -> tuple[Int[np.ndarray, "r c"], list[np.ndarray]]:
    """Number of each cell's plane from 1, 0 where there is none; and the planes."""
    free = cells.misfit < FLAT * noise**2
    labels = np.zeros(len(free), int)
    tried = np.zeros(len(free), bool)
    planes: list[np.ndarray] = []
    for _ in range(MOST_SEEDS):
        seed = _seed(cells, free, tried)
        if seed is None or len(planes) == MOST_PLANES:
            break
        row, col = divmod(seed, cells.shape[1])
        block = np.zeros(cells.shape, bool)
        around = (slice(max(k - REACH, 0), k + REACH + 1) for k in (row, col))
        block[tuple(around)] = True
        tried |= block.ravel()
        part, plane = _region(cells, free, seed, block.ravel() & free, noise)
        if np.count_nonzero(part) < FEWEST_CELLS:
            continue
        if _is_curved(view, readings, part.reshape(cells.shape)):
            tried |= part
            continue
        free &= ~part
        planes.append(plane)
        labels[part] = len(planes)
    return labels.reshape(cells.shape), planes


def _seed(
    cells: _Cells, free: Bool[np.ndarray, " c"], tried: Bool[np.ndarray, " c"]
) -> int | None:
    """The flattest cell to grow from, among others that are flat; None if none is."""
    image, across = free.reshape(cells.shape).astype(np.float32), 2 * REACH + 1
    support = cv2.boxFilter(
        image, -1, (across, across), normalize=False, borderType=cv2.BORDER_CONSTANT
    )
    seeds = free & ~tried & (support.ravel() >= LEAST_FLAT)
    return (
        int(np.argmin(np.where(seeds, cells.misfit, np.inf))) if seeds.any() else None
    )


def _region(
    cells: _Cells,
    free: Bool[np.ndarray, " c"],
    seed: int,
    part: Bool[np.ndarray, " c"],
    noise: float,
) -> tuple[Bool[np.ndarray, " c"], Float[np.ndarray, "3"]]:
    """Cells on a plane that hang together with the seed, and the plane."""
    most = (CELL_LIMIT * noise) ** 2 * np.maximum(cells.number, 1)
    plane = _fitted(cells.moments[part].sum(axis=0))
    for _ in range(MOST_STEPS):
        fits = free & (_squares(cells.moments, plane) < most)
        fits &= cells.normal @ _directions(plane) > AGREEING
        image = fits.reshape(cells.shape).view(np.uint8)
        _, pieces = cv2.connectedComponents(image, connectivity=4)
        pieces = pieces.ravel()
        grown = pieces == pieces[seed]
        if pieces[seed] == 0 or np.array_equal(grown, part):
            break
        part = grown
        plane = _fitted(cells.moments[part].sum(axis=0))
    return part, plane


def _is_curved(view: View, readings: _Readings, part: Bool[np.ndarray, "r c"]) -> bool:
    """Whether a region is of something curved, as a wide trunk is."""
    weight = readings.weight.ravel()
    index = np.flatnonzero(_pixels_of(part, view.depth.shape).ravel() & (weight > 0))
    index = index[:: max(1, len(index) // MOST_SAMPLED)]
    x, y, one, linear = (row.ravel()[index] for row in readings.rows)
    x, y = x - x.mean(), y - y.mean()
    size = max(np.sqrt(np.mean(x * x + y * y)), 1e-9)
    x, y = x / size, y / size
    root = np.sqrt(weight[index])
    terms = np.stack([x, y, one, x * x, x * y, y * y], axis=1) * root[:, None]
    inverse = np.linalg.inv(terms.T @ terms + 1e-9 * np.eye(6))
    solution = inverse @ (terms.T @ (linear * root))
    # Noise is taken as it is.
    spread = np.median(np.abs(linear * root - terms @ solution)) * 1.4826
    deviation = max(spread, 1e-9) * np.sqrt(np.diag(inverse))
    curvature = solution[3:]
    if np.max(np.abs(curvature) / deviation[3:]) <= SIGNIFICANT:
        return False
    xx, xy, yy = curvature
    largest = np.abs(np.linalg.eigvalsh([[2 * xx, xy], [xy, 2 * yy]])).max()
    # Sagitta at one standard deviation of the region, over that.
    sag = largest / 2 / size
    if view.is_central:
        # Of the depth, which is as far as the inverse depth is from what it is.
        sag /= max(abs(solution[2]), 1e-12)
    return bool(sag > LEAST_SAG)


def _shared(
    cells: _Cells,
    numbers: Int[np.ndarray, " c"],
    planes: list[np.ndarray],
    noise: float,
) -> float:
    """Pixels that share an error: the variance of a cell's mean, over its own."""
    squares = []
    for number, plane in enumerate(planes, start=1):
        sums = cells.moments[numbers == number, 2]
        miss = sums[:, :3] @ plane - sums[:, 3]
        squares.append(miss**2 / (sums[:, 2] * noise**2))
    if not squares:
        return 1.0
    # Of normal errors the median square is 0.455 variances.
    variance = float(np.median(np.concatenate(squares))) / 0.455
    return min(max(variance, 1.0), float(CELL**2))


def _labeled(
    view: View,
    valid: Bool[np.ndarray, "h w"],
    numbers: Int[np.ndarray, "r c"],
    planes: list[np.ndarray],
    noise: float,
) -> Int[np.ndarray, "h w"]:
    """Number of each pixel's plane: of those near its cells the one that fits best."""
    labels = np.zeros(view.depth.shape, int)
    best = np.full(view.depth.shape, PIXEL_LIMIT, np.float32)
    variance = (noise * view.linear_sigma) ** 2
    for number, plane in enumerate(planes, start=1):
        there = numbers == number
        first, last = (f(np.argwhere(there), axis=0) for f in (np.min, np.max))
        ends = list(zip(np.maximum(first - REACH, 0), last + REACH + 1, strict=True))
        of_cells = there[tuple(slice(*pair) for pair in ends)]
        box = tuple(slice(CELL * start, CELL * stop) for start, stop in ends)
        slope_x, slope_y, value = plane.tolist()
        linear = slope_x * view.x[box] + slope_y * view.y[box] + value
        # A reading is also off by a third of a pixel, aside.
        aside = (np.hypot(slope_x, slope_y) * view.footprint / 3) ** 2
        # Where there is no reading it is not looked at.
        total = np.where(valid[box], variance[box], 1) + np.float32(aside)
        miss = np.abs(linear - view.linear[box]) / np.sqrt(total)
        reach = np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)
        near = cv2.dilate(of_cells.view(np.uint8), reach) > 0
        on = valid[box] & _pixels_of(near, miss.shape) & (miss < best[box])
        # What hangs together with the cells.
        count, pieces = cv2.connectedComponents(on.view(np.uint8), connectivity=4)
        keep = np.zeros(count, bool)
        keep[pieces[_pixels_of(of_cells, miss.shape)]] = True
        keep[0] = False
        on &= keep[pieces]
        labels[box][on] = number
        best[box][on] = miss[on]
    return labels


def _pixels_of(
    cells: Bool[np.ndarray, "r c"], shape: tuple[int, int]
) -> Bool[np.ndarray, "h w"]:
    """The pixels of cells, of an image of some height and width."""
    height, width = shape
    return cells.repeat(CELL, axis=0).repeat(CELL, axis=1)[:height, :width]
