"""What planes in an image tell of its noise: whether neighbors share it, and how far.

Planes are looked at in patches. High differences of one tell the noise of single
readings and its grain. What varies slowly they take out; the means of a patch's blocks
scatter by it about the patch's plane, more than single readings let them. But such a
plane takes up what is long beside it: of an error whose correlation length is a patch's
width hardly anything is left. So patches of three sizes are looked at, and what is left
in each tells how much of the error is short, bands, and how much long, a warp.
"""

__all__ = [
    "LEAST",
    "LONG",
    "NEAR",
    "NEXT",
    "SAMPLE",
    "SHORT",
    "Around",
    "Grain",
    "Window",
    "around_of",
    "is_fine",
    "pixel_of",
    "windows_of",
]

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import optimize

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.ray_table import directions_of
from impostor_jax.fit.high_differences import variance_of_mean, variances
from impostor_jax.fit.surface import at_most
from impostor_jax.opencv import cv2
from impostor_jax.sensor.matching import BAND_LENGTH, BANDS

CELL, SIDE = 8, 6
"""Pixels across a block of the smallest patches, and blocks across any patch."""

SIZES = (1, 2, 4)
"""Of patches, over the smallest: 48, 96 and 192 pixels across."""

MOST_PATCHES = 9
"""Of a size that are looked at, evenly spread over the image."""

COVERED = 0.9
"""Share of a patch's pixels that hold a reading, at least."""

FILLED = 0.5
"""The same of each of its blocks."""

LEAST = 1e-5
"""Noise over depth below which an image has none: rounding, or a scene without."""

NEXT, NEAR = 2, 3
"""Pixels between readings that tell a filter of a pixel from a window, and that tell
white noise from filtered."""

FINE = 1.25
"""Variance of differences between pixels so near over that between those `NEXT` to each
other up to which the grain is fine."""

LAGS, LENGTHS = (1, 2, 3, 5, 8), (1.5, 2.0, 3.0, 4.0, 6.0)
"""Pixels between readings that tell the length of grain, and lengths that it may have:
few, so that few programs are compiled."""

OF_THIRD = np.array([-1.5, 0.6, -0.1])
"""What correlations at one, two and three lags do to a third difference's variance."""

SHARED = 1.5
"""Variance of differences over that of neighbors from which errors are shared: of six
images of five cameras it is 1.6 to 6, of drawn white noise 0.9 to 1.1."""

SHORT, LONG = BAND_LENGTH, 3 * BAND_LENGTH
"""Correlation lengths of bands and of warps, in pixels: their mixture stands for any.
Bands are as much longer as pixels are finer than the sensor's, but are told as if they
were not: of those that long a small patch leaves a fiftieth, and shows shorter ones."""

SCATTER = 1.6
"""Variance of the means of blocks on planes, over that of white noise, less 1, times
the root of the number of patches, from which there is a smooth error: 5 standard
deviations of the median of white noise."""

ALIKE = 3.0
"""Patches that tell as much as one, where they overlap by half."""

DOUBTFUL = 0.8
"""Part of a variance that one patch leaves open: a patch is a few bands wide."""

TWO_SURFACES = 5.0
"""Scatter of the means over that of the lowest quarter of patches beyond which there is
more than one surface in one: of four cameras' planes it is up to 4 times."""

MOST_SMOOTH = 10 * BANDS
"""Deviation of the means of blocks, in inverse depth, beyond which a patch is no plane:
depth cameras' smooth errors are of some `BANDS`."""

EDGE = 4.5
"""Second difference of the means of neighboring cells, over their robust deviation in a
patch, from which there is an edge in it: of normal noise no small patch has that, and
of the largest one in 50."""

OF_MEDIAN = 1.4826
"""Standard deviation of normal numbers over the median of their sizes."""

NARROW = 1.25
"""Focal length over the image's width from which it was warped to a color camera's: of
depth cameras it is 0.5 to 0.9, of such an image twice that, and its sensor's own pixels
are about two of its."""

ROUNDED = 0.65
"""Distance from planes, in steps of rounding, up to which readings err by that alone:
noise of a twentieth of a step takes some of them beyond."""

FINEST = 1e-5
"""Meters of which steps of rounding are multiples."""

FEWEST_LEVELS = 8
"""Depths that tell a step."""

SAMPLE = 4096
"""Readings that tell to which step depths are rounded."""

Window = tuple[slice, slice]


class Grain(NamedTuple):
    """An error that neighbors share, beside the own of each reading.

    Attributes:
        part: Of the variance of readings.
        length: Of its correlation, in pixels: one of `LENGTHS`.
    """

    part: float
    length: float

    @staticmethod
    def of(surfaces: Sequence[tuple[np.ndarray, np.ndarray]]) -> "Grain":
        """That of inverse depths of surfaces, and which of these there are.

        Differences of readings that are far from each other hold all of it, and those
        of neighbors what these do not share.
        """
        lags, levels = [], []
        for lag in LAGS:
            some = [level for own in surfaces for level in variances(*own, lag, 3)]
            if some:
                lags.append(lag)
                levels.append(float(np.mean(some)))
        level, best = np.array(levels), (math.inf, Grain(0.0, LENGTHS[0]))
        for length in LENGTHS:
            squares = np.outer(np.array(lags) / length, np.arange(1, 4)) ** 2
            told = 1 + np.exp(-squares / 2) @ OF_THIRD
            terms = np.stack([np.ones_like(told), told], axis=1) / level[:, None]
            (own, shared), rest = optimize.nnls(terms, np.ones_like(level))
            if rest < best[0]:
                best = float(rest), Grain(shared / (own + shared), length)
        return best[1]


class Around(NamedTuple):
    """What planes tell of noise.

    Attributes:
        is_filtered: Whether neighbors share errors.
        is_fine: Whether only neighbors do, and those but one share little.
        grain: What neighbors share; None where they do not, or nothing tells.
        white: Deviation of the noise that neighbors do not share, of inverse depth.
        depth: Of the planes, in meters.
        bands: Deviation of a smooth error of inverse depth whose correlation length is
            `SHORT` of the sensor's pixels; 0 if there is none.
        warp: The same of `LONG`, of the image's.
        pixel: Pixels of the image for one of the sensor's.
        step: To which depths are rounded, in meters, if that is all that they err by;
            0 otherwise. Neighbors share it, but it leads a fit nowhere.
        is_equal: Whether each plane has one depth, so that the step is all it tells.
    """

    is_filtered: bool = False
    is_fine: bool = False
    grain: Grain | None = None
    white: float = 0.0
    depth: float = 0.0
    bands: float = 0.0
    warp: float = 0.0
    pixel: int = 1
    step: float = 0.0
    is_equal: bool = False

    @property
    def is_smooth(self) -> bool:
        """Whether there is a smooth error."""
        return self.smooth > 0

    @property
    def smooth(self) -> float:
        """Deviation of all of it, of inverse depth."""
        return math.hypot(self.bands, self.warp)

    def at(self, depth: float, white: float) -> "Around":
        """With the smooth error that there is where something else stands.

        It grows with depth as the noise does: of inverse depth neither does, or of
        depth, or what is between. Where there is no noise, it is the larger one.

        Args:
            depth: Of that, in meters.
            white: Deviation of its noise that neighbors do not share.
        """
        if not self.is_smooth:
            return self
        least, most = sorted((1.0, (self.depth / depth) ** 2))
        is_exact = self.white * self.depth < 2 * LEAST
        growth = most if is_exact else min(max(white / self.white, least), most)
        return self._replace(bands=growth * self.bands, warp=growth * self.warp)


def windows_of(usable: Bool[np.ndarray, "h w"]) -> list[Window]:
    """The patches of all sizes that are looked at, where most readings are usable."""
    cells = _summed(usable.astype(np.float32))
    return [window for size in SIZES for window in _windows(cells, size)]


def around_of(
    image: Float[np.ndarray, "h w"],
    usable: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
) -> Around | None:
    """What planes among the usable readings tell; None where there is none.

    Args:
        image: Depths in meters; 0 where there is no reading.
        usable: Pixels whose readings count.
        camera: That took it.
    """
    cells = _cells(image, usable, camera)
    windows = _windows(cells[0], 1)
    patches = [found for at in windows if (found := _patch(image, usable, cells, at))]
    step = _grid_of(image[image > 0])
    if not patches:
        # What is coarsely rounded, faces the camera or is as far as it reads.
        is_equal = any(_is_equal(image[at], usable[at]) for at in windows)
        return Around(step=step, is_equal=True) if step and is_equal else None
    if step:
        farthest = [_farthest(one, camera) for one in patches]
        step = step if np.median(farthest) <= ROUNDED * step else 0.0
    most = _most([one.means for one in patches])
    planes = [one for one in patches if one.means.ratio <= most]
    by_size = [[one.means for one in planes]]
    by_size += [_larger(cells, size) for size in SIZES[1:]]
    bands, warp = _smooth(by_size)
    white = math.sqrt(np.median([one.white for one in planes]))
    depth = 1 / np.median(np.concatenate([one.inverse[one.use] for one in planes]))
    around = Around(
        white=white,
        depth=float(depth),
        bands=bands,
        warp=warp,
        pixel=pixel_of(camera),
        step=step,
    )
    if not np.median([one.shared for one in patches]) > SHARED:
        return around
    fine = [
        is_fine(variances(one.inverse, one.use, NEXT, 3), one.apart)
        for one in patches
        if one.shared > SHARED
    ]
    return around._replace(
        is_filtered=True,
        is_fine=bool(np.median(fine) > 0.5),
        grain=Grain.of([(one.inverse, one.use) for one in planes]),
    )


def pixel_of(camera: PinholeCamera) -> int:
    """Pixels of an image for one of its sensor's."""
    return 2 if float(camera.fx) > NARROW * camera.width else 1


def is_fine(next_but_one: Sequence[float], apart: Sequence[float]) -> bool:
    """Whether neighbors but one share little, along rows and along columns."""
    pairs = zip(next_but_one, apart, strict=False)
    return all(far < FINE * near for near, far in pairs)


_Sums = Float[np.ndarray, "4 _ _"]
"""Over blocks of pixels: of readings, their inverse depths, and two coordinates."""


class _Means(NamedTuple):
    """How means of blocks scatter about a plane.

    Attributes:
        variance: Of it, in inverse depth.
        noise: That which the noise of single readings makes.
    """

    variance: float
    noise: float

    @property
    def ratio(self) -> float:
        """Of the two."""
        return self.variance / self.noise


class _Patch(NamedTuple):
    """One of the smallest parts of an image, and what it shows of a plane.

    Attributes:
        window: Its pixels.
        inverse: Their depth in 1/meters; 0 where they do not count.
        use: Which of these count.
        white: Variance that differences of neighbors tell.
        apart: Variance of differences of readings `NEAR` each other, along each axis.
        means: Of its blocks.
    """

    window: Window
    inverse: Float[np.ndarray, "n n"]
    use: Bool[np.ndarray, "n n"]
    white: float
    apart: Sequence[float]
    means: _Means

    @property
    def shared(self) -> float:
        """Variance of the differences that are apart over that of neighbors'."""
        return float(np.mean(self.apart)) / self.white


def _summed(field: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "r c"]:
    """Sums over cells; what is left over at the right and below does not count."""
    tall, wide = (size // CELL for size in field.shape)
    if not (tall and wide):
        return np.zeros((tall, wide), np.float32)
    whole = field[: tall * CELL, : wide * CELL]
    return CELL**2 * cv2.resize(whole, (wide, tall), interpolation=cv2.INTER_AREA)


def _cells(
    image: Float[np.ndarray, "h w"],
    usable: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
) -> _Sums:
    """Sums over cells."""
    use = usable.astype(np.float32)
    inverse = use / np.where(usable, image, 1).astype(np.float32)
    # A plane's inverse depth is linear in the directions of rays, and without a lens in
    # columns and rows as well.
    x, y = np.arange(use.shape[1]), np.arange(use.shape[0])[:, None]
    if camera.ray_field is not None:
        x, y = (np.asarray(part) for part in (camera.ray_field.x, camera.ray_field.y))
        use = use * np.isfinite(x)
        x, y = np.where(use > 0, x, 0), np.where(use > 0, y, 0)
    fields = (use, use * inverse, use * x, use * y)
    sums = [_summed(field.astype(np.float32)) for field in fields]
    return np.stack(sums).astype(float)


def _pooled(cells: Float[np.ndarray, "*k r c"], size: int) -> np.ndarray:
    """Sums over blocks of so many cells across."""
    *rest, rows, cols = cells.shape
    tall, wide = rows // size, cols // size
    whole = cells[..., : tall * size, : wide * size]
    return whole.reshape(*rest, tall, size, wide, size).sum(axis=(-3, -1))


def _windows(count: Float[np.ndarray, "r c"], size: int) -> list[Window]:
    """Some patches of a size, most of whose readings are usable, from those of cells.

    The larger ones overlap by half.
    """
    blocks = _pooled(count, size)
    if min(blocks.shape) < SIDE:
        return []
    stride = SIDE if size == 1 else SIDE // 2
    whole = np.lib.stride_tricks.sliding_window_view(blocks, (SIDE, SIDE))
    covered = whole[::stride, ::stride].sum(axis=(2, 3))
    width = CELL * SIDE * size
    rows, cols = np.nonzero(covered > COVERED * width**2)
    pick = at_most(len(rows), MOST_PATCHES)
    first = CELL * size * stride * np.stack([rows[pick], cols[pick]], axis=1)
    return [np.s_[y : y + width, x : x + width] for y, x in first.tolist()]


def _is_equal(image: Float[np.ndarray, "n n"], use: Bool[np.ndarray, "n n"]) -> bool:
    return bool(np.ptp(image[use]) == 0)


def _patch(
    image: Float[np.ndarray, "h w"],
    usable: Bool[np.ndarray, "h w"],
    cells: _Sums,
    window: Window,
) -> _Patch | None:
    """What a part of an image shows; None where that is no plane, or tells nothing."""
    use, depth = usable[window], image[window].astype(float)
    if _is_equal(depth, use):
        return None
    inverse = np.where(use, 1 / np.where(use, depth, 1), 0)
    near, apart = (variances(inverse, use, lag, 3) for lag in (1, NEAR))
    if not near or not apart:
        return None
    white = max(float(np.mean(near)), (LEAST / float(np.median(depth[use]))) ** 2)
    own = _part(cells, window)
    if math.isinf(_usual_bend(own)):
        return None
    means = _means(own, variance_of_mean(white, float(np.mean(apart))))
    if means is None:
        return None
    return _Patch(window, inverse, use, white, apart, means)


def _larger(cells: _Sums, size: int) -> list[_Means]:
    """Means of blocks of planes in larger patches, of a size."""
    found = []
    for window in _windows(cells[0], size):
        own = _part(cells, window)
        usual = _usual_bend(own)
        # What is rounded coarsely has none in most places.
        if 0 < usual < math.inf:
            least = LEAST * float(np.sum(own[1]) / np.sum(own[0]))
            means = _means(_pooled(own, size), max(usual**2 / 6 * CELL**2, least**2))
            found += [] if means is None else [means]
    most = _most(found) if found else 0.0
    return [one for one in found if one.ratio <= most]


def _part(cells: _Sums, window: Window) -> _Sums:
    rows, cols = (slice(one.start // CELL, one.stop // CELL) for one in window)
    return cells[:, rows, cols]


def _usual_bend(cells: _Sums) -> float:
    """Robust deviation of second differences of cells' means; inf if there is an edge.

    From cell to cell a smooth error hardly bends, and an edge does by far more.
    """
    count = np.where(cells[0] > FILLED * CELL**2, cells[0], np.nan)
    bends = [np.abs(np.diff(cells[1] / count, 2, axis=axis)) for axis in (0, 1)]
    bend = np.concatenate([one.ravel() for one in bends])
    usual = OF_MEDIAN * float(np.nanmedian(bend))
    return math.inf if np.nanmax(bend) > EDGE * usual > 0 else usual


def _means(blocks: _Sums, one: float) -> _Means | None:
    """How means of blocks scatter; None where they are of no plane.

    Args:
        blocks: Their sums.
        one: Variance of a mean of n readings, times n.
    """
    count, *sums = blocks[:, blocks[0] > FILLED * blocks[0].max()]
    if len(count) < COVERED * SIDE**2:
        return None
    inverse, x, y = sums / count
    off = _off_plane(x, y, inverse)
    variance = float(off @ off) / (len(off) - 3)
    noise = one * float(np.mean(1 / count))
    return _Means(variance, noise) if variance < MOST_SMOOTH**2 else None


def _most(means: Sequence[_Means]) -> float:
    """Ratio up to which means scatter as most do; those of two surfaces do by more."""
    return TWO_SURFACES * float(np.quantile([one.ratio for one in means], 0.25))


def _farthest(patch: _Patch, camera: PinholeCamera) -> float:
    """How far a reading is off the plane at most, in meters."""
    inverse, (row, col) = patch.inverse[patch.use], np.nonzero(patch.use)
    row, col = row + patch.window[0].start, col + patch.window[1].start
    off = _off_plane(*directions_of(camera, row, col, float), inverse)
    return float(np.max(np.abs(off) / inverse**2))


def _off_plane(
    x: Float[np.ndarray, " n"],
    y: Float[np.ndarray, " n"],
    inverse: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Inverse depths less those of the plane that is nearest to them."""
    terms = np.stack([x, y, np.ones_like(x)])
    return inverse - np.linalg.lstsq(terms.T, inverse, rcond=None)[0] @ terms


def _smooth(by_size: Sequence[Sequence[_Means]]) -> tuple[float, float]:
    """Deviations of bands and of a warp, in inverse depth; 0 where there is none.

    Args:
        by_size: Of planes, for each of `SIZES`.
    """
    left, excess, weight, doubt, is_smooth = [], [], [], [], False
    for size, means in zip(SIZES, by_size, strict=True):
        if not means:
            continue
        num_apart = len(means) if size == 1 else max(1.0, len(means) / ALIKE)
        ratio = float(np.median([one.ratio for one in means]))
        is_smooth |= ratio > 1 + SCATTER / math.sqrt(num_apart)
        variance, noise = np.mean(means, axis=0).tolist()
        left.append([_left(length / size) for length in (SHORT, LONG)])
        excess.append(max(0.0, variance - noise))
        weight.append(1 / variance)
        doubt.append(1 / math.sqrt(num_apart))
    if not is_smooth:
        return 0.0, 0.0
    scaled = np.array(weight)[:, None] * np.array(left)
    target = np.multiply(weight, excess)
    # Bands alone, if they explain all: of a single size they do.
    bands = float(optimize.nnls(scaled[:, :1], target)[0][0])
    most = (1 + DOUBTFUL * (doubt[0] + np.array(doubt))) * bands
    if np.all(excess <= most * np.array(left)[:, 0]):
        return math.sqrt(bands), 0.0
    bands, warp = np.sqrt(optimize.nnls(scaled, target)[0]).tolist()
    return bands, warp


@functools.lru_cache
def _left(length: float) -> float:
    """Share of a smooth error's variance that the means of blocks have about a plane.

    Args:
        length: Of its correlation, in pixels, where blocks are of `CELL` pixels.
    """
    place = np.arange(SIDE * CELL) + 0.5
    pixels = np.exp(-0.5 * ((place[:, None] - place) / length) ** 2)
    along = pixels.reshape(SIDE, CELL, SIDE, CELL).mean(axis=(1, 3))
    row, col = np.indices((SIDE, SIDE)).reshape(2, -1)
    basis = np.linalg.qr(np.stack([np.ones_like(row), row, col], axis=1))[0]
    rest = np.eye(SIDE**2) - basis @ basis.T
    return float(np.trace(rest @ np.kron(along, along))) / (SIDE**2 - 3)


def _grid_of(depth: Float[np.ndarray, " n"]) -> float:
    """The step that depths are multiples of, in meters; 0 where none is told."""
    some = depth[at_most(len(depth), SAMPLE)].astype(float)
    places = np.round(some / FINEST)
    # Numbers in single precision are off by 6e-8 of themselves.
    if np.any(np.abs(some - FINEST * places) > 1e-7 * some):
        return 0.0
    levels = np.unique(places.astype(np.int64))
    # The depths of a few walls that face the camera have some divisor, too.
    if len(levels) < FEWEST_LEVELS:
        return 0.0
    return FINEST * float(np.gcd.reduce(levels))
