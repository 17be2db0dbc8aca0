"""What an image tells of its own noise, where a caller tells nothing of the sensor.

High differences of inverse depth along rows and columns vanish on planes and nearly so
on what bends gently: what is left is noise. Of white noise they are as large between
neighbors as between pixels that are farther apart. Sensors that match windows, or
filter, err alike within a window: theirs grow with the distance. Planes around the
object, which are looked at in tiles, show that best; and smooth errors that noise hides
from pixel to pixel: the means of blocks scatter by more than single readings let them.

No image shows an error of its scale. Cameras whose errors are shared by neighbors have
one, so it is counted with them as with `StructuredLight.sensor`; white noise is that of
a scene that was drawn.
"""

__all__ = [
    "NOT_MEASURED",
    "MeasuredNoise",
    "law_of_noise",
    "law_of_pixels",
    "measured_noise",
    "with_measured",
]

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import optimize

from impostor_jax.camera.base import AbstractRays
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.ray_table import directions_of
from impostor_jax.fit.per_pixel import PerPixelNoise
from impostor_jax.fit.request import (
    Given,
    checked_depth,
    checked_mask,
    checked_noise,
)
from impostor_jax.fit.surface import at_most, cropped
from impostor_jax.opencv import cv2
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.correlated import CorrelatedNoise
from impostor_jax.sensor.gaussian import ConstantNoise
from impostor_jax.sensor.matching import BAND_LENGTH, BANDS, OFFSET
from impostor_jax.sensor.matching_window import MatchingWindow
from impostor_jax.sensor.quantization import StereoDisparity
from impostor_jax.sensor.scale_error import ScaleError
from impostor_jax.sensor.structured_light import StructuredLight

FEWEST = 200
"""Differences that tell a level of noise to a tenth."""

LEAST = 1e-5
"""Noise over depth below which an image has none: rounding, or a scene without."""

CLIP = 3.0
"""Standard deviations to which differences are clipped: a jump is no noise."""

CLIPPED = 0.9950
"""Mean square of normal numbers clipped to three standard deviations."""

MEDIAN_SQUARE = 0.4549
"""Of normal numbers."""

WINDOW, SPIKE = 5, 9.0
"""Pixels across which the median tells where a reading ought to be, and how many times
as far as the middle one there an outlier lies from it: 6 standard deviations."""

MOST_SPIKES = 0.2
"""Share of outliers beyond which noise comes out too large: of a quarter, 1.4 times."""

STEPS = 3.0
"""Steps of rounding by which an outlier lies off, at least."""

WEIGHTS = {3: (-1, 3, -3, 1), 4: (1, -4, 6, -4, 1)}
"""Of the third difference and the fourth, which bends leave less of."""

NEXT, NEAR, FAR = 2, 3, 8
"""Pixels between readings that tell a filter of a pixel from a window, that tell white
noise from filtered, and that tell all of what is filtered: real cameras' grain is of 3
to 6 pixels."""

FINE, FINE_WINDOW = 1.25, 2.0
"""Variance of differences between pixels so near over that between those `NEXT` to each
other up to which the grain is fine, and half of the window that is taken for it: what
smooths by half a pixel leans by less than the noise from there on."""

LAGS, LENGTHS = (1, 2, 3, 5, 8), (1.5, 2.0, 3.0, 4.0, 6.0)
"""Pixels between readings that tell the length of grain, and lengths that it may have:
few, so that few programs are compiled."""

MOST_GRAIN = 0.99
"""Part of the variance that is grain, at most: no reading is without an error."""

OF_THIRD = np.array([-1.5, 0.6, -0.1])
"""What correlations at one, two and three lags do to a third difference's variance."""

SHARED = 1.5
"""Variance of differences over that of neighbors from which errors are shared: of six
images of five cameras it is 1.6 to 6, of drawn white noise 0.9 to 1.1."""

CURVED = 2.5
"""The same where no plane around the object tells, but the object's own surface."""

TILE, CELL = 48, 8
"""Pixels across a tile that a plane is fitted to, and of the blocks in it."""

MOST_TILES = 9
"""That are looked at, evenly spread over the image."""

COVERED = 0.9
"""Share of a tile's pixels that hold a reading, at least."""

SCATTER = 1.6
"""Variance of the means of blocks on planes, over that of white noise, less 1, times
the root of the number of tiles, from which there is a smooth error: 5 standard
deviations of the median of white noise."""

TWO_SURFACES = 5.0
"""Scatter of the means over that of the lowest quarter of tiles beyond which there is
more than one surface in one: of four cameras' planes it is up to 4 times."""

ROUNDED = 0.65
"""Distance from planes, in steps of rounding, up to which readings err by that alone:
noise of a twentieth of a step takes some of them beyond."""

MOST_ROUNDED = 1.35
"""Noise of an object over that of rounding up to which there is no other, where planes
tell none."""

LOST = 1.6
"""Deviation of a smooth error over what a plane through a tile leaves of it, of one
whose correlation length is half of the tile's."""

NARROW = 1.25
"""Focal length over the image's width from which it was warped to a color camera's: of
depth cameras it is 0.5 to 0.9, of such an image twice that, and its sensor's own pixels
are about two of its."""

MOST_SMOOTH = 10 * BANDS
"""Deviation of the means of blocks, in inverse depth, beyond which a tile is no plane:
depth cameras' smooth errors are of some `BANDS`."""

MOST_LINES = 40
"""Rows, and columns, along which differences are taken, evenly spread."""

NUM_DEPTHS = 5
"""Ranges of depth in which noise is measured."""

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
            some = [level for own in surfaces for level in _variances(*own, lag, 3)]
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


class MeasuredNoise(NamedTuple):
    """What an image tells of its noise.

    Attributes:
        noise: The model of it.
        text: What a reader is told of it.
        is_of_all: Whether the model holds at all depths, wherever it was measured.
    """

    noise: AbstractDepthNoise
    text: str
    is_of_all: bool = False


NOT_MEASURED = "The noise is not measured: 1 mm is taken, and held against nothing."
"""What a reader is told where nothing tells the noise."""


def with_measured(views: Sequence[Given], sigma: Any) -> tuple[list[Given], Any, str]:
    """Views with the noise that their images tell, where none is given.

    Args:
        views: Concrete, each with a mask.
        sigma: As a caller gives it.

    Returns:
        The views, the noise of one or a list of all, and what a reader is told.
    """
    found, told = [], ""
    for view in views:
        if view.sigma is None:
            image = np.asarray(checked_depth(view.depth, view.camera))
            mask = checked_mask(view.mask, view.camera)
            measured = measured_noise(image, np.asarray(mask), view.camera)
            told = told or (NOT_MEASURED if measured is None else measured.text)
            view = view._replace(sigma=None if measured is None else measured.noise)
        found.append(view)
    if not told:
        return found, sigma, told
    sigmas = [view.sigma for view in found]
    return found, sigmas if len(found) > 1 else sigmas[0], told


def measured_noise(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: AbstractRays,
) -> MeasuredNoise | None:
    """Noise of the readings of an object; None where too little tells of it.

    Args:
        image: Depths in meters; 0 where there is no reading.
        region: Pixels of the object, or of all that is seen.
        camera: That took it.
    """
    seen = image > 0
    beside = seen & ~region
    # All that is looked at: in a large image it is little.
    windows = [cropped(region), *_tiles_of(beside if beside.any() else seen)]
    return _measured(_despiked(image, windows), region, camera)


def _despiked(
    image: Float[np.ndarray, "h w"], windows: Sequence[Window] = (np.s_[:, :],)
) -> Float[np.ndarray, "h w"]:
    """Some windows of an image, without readings that lie far from what is around them.

    Differences of the fourth order hold five readings each: of a tenth of outliers two
    fifths are wrong, more than clipping takes away. Where they are so many that they
    hide each other, no reading is left.
    """
    usual, num_seen, num_spikes = np.zeros_like(image), 0, 0
    for window in windows:
        part = image[window]
        is_spike = _spikes(part)
        usual[window] = np.where(is_spike, 0, part)
        num_seen += np.count_nonzero(part)
        num_spikes += np.count_nonzero(is_spike)
    return usual if num_spikes <= MOST_SPIKES * num_seen else np.zeros_like(image)


def _spikes(image: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Readings that lie far from what is around them."""
    seen = image[image > 0]
    if not len(seen):
        return np.zeros(image.shape, bool)
    single = np.ascontiguousarray(image, np.float32)
    middle = cv2.medianBlur(single, WINDOW)
    off = np.abs(single - middle)
    # On a slanted plane the median is often the very reading, and of rounded ones most
    # are it: there what is usual elsewhere counts. Noise and steps may grow by z^2.
    some_off = off.ravel()[at_most(off.size, SAMPLE)]
    some_off = some_off[some_off > 0]
    least = float(np.median(some_off)) if len(some_off) else 0.0
    growth = np.maximum(1, middle / np.median(seen[at_most(len(seen), SAMPLE)])) ** 2
    usual = np.maximum(cv2.medianBlur(off, WINDOW), least * growth)
    least_off = np.maximum(SPIKE * usual, STEPS * _step(seen) * growth)
    # Where most has no reading nothing tells.
    return (off > least_off) & (middle > 0) & (image > 0)


def _measured(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: AbstractRays,
    is_scene: bool = False,
) -> MeasuredNoise | None:
    """The same of an image without outliers; whether the region is of many things."""
    some = region & (image > 0)
    if np.count_nonzero(some) < FEWEST:
        return None
    box = cropped(region)
    depth = image[box].astype(float)
    own = some[box]
    middle = float(np.median(depth[own]))
    inverse = np.where(own, 1 / np.where(own, depth, 1), 0)
    # Of inverse depth; that of depth at the middle is larger by its square.
    own_levels = {lag: _variances(inverse, own, lag, 4) for lag in (1, NEAR)}
    if not own_levels[1]:
        return None
    step = _step(depth[own]) / middle**2
    # Along the axis along which the surface bends less.
    white = max(math.sqrt(min(own_levels[1])), step / math.sqrt(12))
    if not white * middle > LEAST:
        return None
    if not isinstance(camera, PinholeCamera):
        return _white(white * middle**2)
    seen = image > 0
    beside = seen & ~region
    is_beside = bool(beside.any())
    around = _around(image, beside if is_beside else seen, camera)
    if around is not None and not (is_beside or is_scene):
        # An object by itself bends: differences of the fourth order tell of filters,
        # and its fit of smooth errors. Those far apart do not tell grain from that.
        is_filtered = around.is_filtered and _is_filtered(own_levels, step)
        smooth = around.smooth if is_filtered else 0.0
        told = {"is_filtered": is_filtered, "smooth": smooth, "grain": None}
        around = around._replace(**told)
    if around is None:
        is_filtered = _is_filtered(own_levels, step)
        is_fine = is_filtered and _is_fine(
            _variances(inverse, own, NEXT, 4), own_levels[NEAR]
        )
        around = Around(is_filtered, 0.0, is_fine)
    # Where planes tell nothing but the step, the object alone tells more.
    most = (MOST_ROUNDED * around.step) ** 2 / 12
    is_rounded = not around.is_equal or min(_variances(depth, own, 1, 4)) < most
    if around.step and is_rounded:
        return _rounded(around.step)
    if not (around.is_filtered or around.smooth > 0):
        return _white(white * middle**2)
    far = _variances(inverse, own, FAR, 3) or _variances(inverse, own, NEAR, 3)
    total = max(white, math.sqrt(min(far))) if far else white
    bands = around.smooth or max(BANDS, total)
    noise = _matching(total, around.grain, bands, camera, around.is_fine)
    reach = noise.bias.window_reach
    text = (
        f"Measured in the image: noise of {1e3 * total * middle**2:.2g} mm that "
        f"neighbors share, smooth errors of {1e3 * bands * middle**2:.2g} mm; "
        f"readings within {reach} pixels of jumps are left out, and the scale, which "
        "no image tells, is counted."
    )
    # What neighbors share is of the inverse depth.
    return MeasuredNoise(noise, text, is_of_all=True)


def law_of_noise(
    image: Float[np.ndarray, "h w"], camera: AbstractRays
) -> MeasuredNoise:
    """How the noise of an image grows with depth, whatever it shows; 1 mm if nothing.

    Args:
        image: Depths in meters; 0 where there is no reading.
        camera: That took it.
    """
    usual = _despiked(image)
    whole = _measured(usual, usual > 0, camera, is_scene=True)
    if whole is None:
        return MeasuredNoise(checked_noise(None), NOT_MEASURED)
    if whole.is_of_all:
        return whole
    seen = usual > 0
    # What stands before a wall may have few readings, and little of the wall's noise.
    ends = np.geomspace(usual[seen].min(), usual[seen].max(), NUM_DEPTHS + 1)
    middles, levels = [], []
    for low, high in itertools.pairwise(ends):
        own = seen & (usual >= low) & (usual <= high)
        known = own.any() and _measured(usual, own, camera)
        if known and isinstance(known.noise, ConstantNoise):
            middles.append(float(np.median(usual[own])))
            levels.append(float(known.noise.deviation))
    if not levels:
        return whole
    return whole._replace(noise=_growing(np.array(middles), np.array(levels)))


def law_of_pixels(
    noise: PerPixelNoise, image: Float[np.ndarray, "h w"]
) -> AbstractDepthNoise:
    """How noise that is told pixel by pixel grows with depth.

    Args:
        noise: Of the image.
        image: Depths in meters; 0 where there is no reading.
    """
    own = np.flatnonzero(image)
    own = own[at_most(len(own), SAMPLE)]
    if not len(own):
        return noise.middle
    sigma = np.asarray(noise.image, float)
    return _growing(image.ravel()[own].astype(float), sigma.ravel()[own])


def _growing(
    depth: Float[np.ndarray, " n"], level: Float[np.ndarray, " n"]
) -> StructuredLight:
    """The law floor + growth z^2 of standard deviations at some depths."""
    # Each counts by its relative error; of neither part there is less than none.
    terms = np.stack([np.ones_like(level), depth**2], axis=1) / level[:, None]
    floor, growth = optimize.nnls(terms, np.ones_like(level))[0]
    # The model has some of either.
    floor = max(floor, 1e-3 * level.min())
    return StructuredLight(floor, growth, best_depth=0.0, grazing=0.0)


def _white(level: float) -> MeasuredNoise:
    text = f"Measured in the image: white noise of {1e3 * level:.3g} mm."
    return MeasuredNoise(checked_noise(level), text)


def _rounded(step: float) -> MeasuredNoise:
    text = f"Depth is rounded to {1e3 * step:.3g} mm, and planes show no other noise."
    return MeasuredNoise(checked_noise(step / math.sqrt(12)), text, is_of_all=True)


def _matching(
    deviation: float,
    grain: Grain | None,
    bands: float,
    camera: PinholeCamera,
    is_fine: bool,
) -> AbstractDepthNoise:
    """A camera that matches windows; its deviations are of inverse depth."""
    part = 0.0 if grain is None else min(grain.part, MOST_GRAIN)
    own = deviation * math.sqrt(1 - part)
    enlarged = 2 if float(camera.fx) > NARROW * camera.width else 1
    # Static numbers take few values, so that other images do not compile a fit anew.
    law = StereoDisparity(float(camera.fx), 1.0, own * float(camera.fx), step=0.0)
    window = {"half_window": FINE_WINDOW} if is_fine else {"native_scale": enlarged}
    windowed = MatchingWindow(law, **window)
    if grain is not None:
        shared = deviation * math.sqrt(part)
        windowed = CorrelatedNoise(windowed, shared, grain.length)
    banded = CorrelatedNoise(windowed, bands, BAND_LENGTH * enlarged)
    return ScaleError(banded, OFFSET, law="disparity")


def _step(depth: Float[np.ndarray, " n"]) -> float:
    """Step to which depths are rounded, in meters; 0 where they are not."""
    depth = depth[:: -(-len(depth) // SAMPLE)]
    steps = np.diff(np.unique(depth))
    if len(steps) < 2 or len(steps) > len(depth) / 4:
        return 0.0
    return float(np.median(steps))


def _variances(
    inverse: Float[np.ndarray, "h w"],
    own: Bool[np.ndarray, "h w"],
    lag: int,
    order: int,
) -> list[float]:
    """Variance of white noise that differences tell, along each axis.

    None of an axis along which there are too few.
    """
    weights, found = WEIGHTS[order], []
    for axis in (0, 1):
        count = inverse.shape[axis] - order * lag
        if count <= 0:
            continue
        stride = -(-inverse.shape[1 - axis] // MOST_LINES)
        values, there = (np.moveaxis(x, axis, 0)[:, ::stride] for x in (inverse, own))
        difference, use = np.zeros_like(values[:count]), np.ones_like(there[:count])
        for k, weight in enumerate(weights):
            part = slice(k * lag, k * lag + count)
            difference += weight * values[part]
            use &= there[part]
        if np.count_nonzero(use) >= FEWEST / 2:
            square = float(np.square(weights).sum())
            found.append(_clipped(difference[use]) / square)
    return found


def _clipped(values: Float[np.ndarray, " n"]) -> float:
    """Variance of normal numbers among which are some that are too large."""
    squares = values**2
    variance = float(np.median(squares)) / MEDIAN_SQUARE
    for _ in range(4):
        if not variance > 0:
            # Most differences of what is coarsely rounded are 0.
            return float(np.mean(squares))
        most = CLIP**2 * variance
        variance = float(np.mean(np.minimum(squares, most))) / CLIPPED
    return variance


def _is_filtered(levels: dict[int, list[float]], step: float) -> bool:
    """Whether neighbors share errors, along rows and along columns."""
    near, apart = levels[1], levels[NEAR]
    if len(near) < 2 or len(apart) < 2:
        return False
    least = step**2 / 12
    pairs = zip(near, apart, strict=True)
    return all(far > CURVED * max(one, least) for one, far in pairs)


def _in_means(near: float, apart: float) -> float:
    """Variance of a mean of n readings, times n, where neighbors alone share errors.

    Args:
        near: Variance that third differences of neighbors tell, 1 - 1.5 times their
            correlation of that of one reading.
        apart: The same of others, which is all of it.
    """
    correlation = min(max((1 - near / apart) / 1.5, 0.0), 0.5)
    return apart * (1 + 2 * correlation) ** 2


def _is_fine(next_but_one: Sequence[float], apart: Sequence[float]) -> bool:
    """Whether neighbors but one share little, along rows and along columns."""
    pairs = zip(next_but_one, apart, strict=False)
    return all(far < FINE * near for near, far in pairs)


class Around(NamedTuple):
    """What planes around an object tell of noise.

    Attributes:
        is_filtered: Whether neighbors share errors.
        smooth: Deviation of a smooth error of inverse depth; 0 if there is none.
        is_fine: Whether only neighbors do, and those but one share little.
        grain: What neighbors share; None where they do not, or nothing tells.
        step: To which depths are rounded, in meters, if that is all that they err by;
            0 otherwise. Neighbors share it, but it leads a fit nowhere.
        is_equal: Whether each plane has one depth, so that the step is all it tells.
    """

    is_filtered: bool
    smooth: float
    is_fine: bool
    grain: Grain | None = None
    step: float = 0.0
    is_equal: bool = False


def _tiles_of(usable: Bool[np.ndarray, "h w"]) -> list[Window]:
    """Some tiles of an image, evenly spread, most of whose readings are usable."""
    tall, wide = (size // TILE for size in usable.shape)
    whole = usable[: tall * TILE, : wide * TILE].reshape(tall, TILE, wide, TILE)
    rows, cols = np.nonzero(whole.mean(axis=(1, 3)) > COVERED)
    pick = at_most(len(rows), MOST_TILES)
    return [
        (slice(row, row + TILE), slice(col, col + TILE))
        for row, col in zip(TILE * rows[pick], TILE * cols[pick], strict=True)
    ]


def _around(
    image: Float[np.ndarray, "h w"],
    usable: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
) -> Around | None:
    """What planes among the usable readings tell; None where there is none."""
    side = TILE // CELL
    row, col = np.indices((TILE, TILE))

    def blocks(field: np.ndarray) -> np.ndarray:
        return field.reshape(side, CELL, side, CELL).sum(axis=(1, 3)).ravel()

    shared, fine, scattered, excess, surfaces = [], [], [], [], []
    farthest, num_equal = [], 0
    for tile in _tiles_of(usable):
        use, depth = usable[tile], image[tile].astype(float)
        inverse = np.where(use, 1 / np.where(use, depth, 1), 0)
        near, apart = (_variances(inverse, use, lag, 3) for lag in (1, NEAR))
        counts = blocks(use)
        if not near or not apart or counts.min() < CELL * CELL / 2:
            continue
        if np.ptp(depth[use]) == 0:
            # What is coarsely rounded, faces the camera or is as far as it reads.
            num_equal += 1
            continue
        white = max(float(np.mean(near)), (LEAST / float(np.median(depth[use]))) ** 2)
        # A plane's inverse depth is linear in these, and through a lens not in pixels.
        x, y = directions_of(camera, row + tile[0].start, col + tile[1].start, float)
        rays = np.stack([x, y, np.ones_like(x)])
        # Where readings lack on one side of a block their mean lies to the other.
        plane = np.linalg.lstsq(rays[:, use].T, inverse[use], rcond=None)[0]
        beside = np.where(use, inverse - np.tensordot(plane, rays, 1), 0)
        means = blocks(beside) / counts
        basis = np.linalg.qr(np.stack([*map(blocks, rays)], axis=1))[0]
        left = means - basis @ (basis.T @ means)
        scatter = float(left @ left) / (side * side - 3)
        if scatter > MOST_SMOOTH**2:
            # Of two surfaces, or one that bends.
            continue
        farthest.append(float(np.max(np.abs(beside * depth**2))))
        shared.append(float(np.mean(apart)) / white)
        if shared[-1] > SHARED:
            fine.append(_is_fine(_variances(inverse, use, NEXT, 3), apart))
        grain = _in_means(white, float(np.mean(apart)))
        surfaces.append((inverse, use))
        scattered.append(scatter / (grain * float(np.mean(1 / counts))))
        excess.append(scatter)
    step = _grid_of(image[image > 0])
    if not shared:
        return (
            Around(False, 0.0, False, None, step, True) if num_equal and step else None
        )
    step = step if np.median(farthest) <= ROUNDED * step else 0.0
    # Tiles of one camera scatter alike, and those of two surfaces by far more.
    spread = np.array(scattered)
    is_plane = spread <= TWO_SURFACES * np.quantile(spread, 0.25)
    least = 1 + SCATTER / math.sqrt(np.count_nonzero(is_plane))
    is_smooth = np.median(spread[is_plane]) > least
    excess = np.array(excess)[is_plane]
    smooth = LOST * math.sqrt(float(np.median(excess))) if is_smooth else 0.0
    is_filtered = bool(np.median(shared) > SHARED)
    is_fine = is_filtered and bool(np.median(fine) > 0.5)
    planes = [own for own, flat in zip(surfaces, is_plane, strict=True) if flat]
    grain = Grain.of(planes) if is_filtered else None
    return Around(is_filtered, smooth, is_fine, grain, step)


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
