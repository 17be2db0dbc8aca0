"""What an image tells of its own noise, where a caller tells nothing of the sensor.

High differences of inverse depth along rows and columns vanish on planes and nearly so
on what bends gently: what is left is noise. Of white noise they are as large between
neighbors as between pixels that are farther apart. Sensors that match windows, or
filter, err alike within a window: theirs grow with the distance. Planes around the
object show that best, and smooth errors that noise hides from pixel to pixel.

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
from impostor_jax.fit.high_differences import FEWEST, variances
from impostor_jax.fit.patches import (
    LEAST,
    LONG,
    NEAR,
    NEXT,
    SAMPLE,
    SHORT,
    Around,
    Window,
    around_of,
    is_fine,
    pixel_of,
    windows_of,
)
from impostor_jax.fit.per_pixel import PerPixelNoise
from impostor_jax.fit.regions import SQUARE
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
from impostor_jax.sensor.matching import BANDS, OFFSET
from impostor_jax.sensor.matching_window import MatchingWindow
from impostor_jax.sensor.quantization import StereoDisparity
from impostor_jax.sensor.scale_error import ScaleError
from impostor_jax.sensor.structured_light import StructuredLight

WINDOW, SPIKE = 5, 9.0
"""Pixels across which the median tells where a reading ought to be, and how many times
as far as the middle one there an outlier lies from it: 6 standard deviations."""

ISLAND, JUMP = 1000, 0.1
"""Pixels up to which what readings jump around is no surface of its own, as a value
that stands for none, and the part of a depth that is a jump."""

OF_OBJECT, MOST_JUMPS = 0.1, 0.5
"""Share of an object from which on it is its surface all the same, and share of all
readings beyond which jumps are noise."""

MOST_SPIKES = 0.2
"""Share of outliers beyond which noise comes out too large: of a quarter, 1.4 times."""

FAR = 8
"""Pixels between readings that tell all of what is filtered: real cameras' grain is of
3 to 6 pixels."""

MOST_MIXED = 1.5
"""Their variance over what their median tells, at most: of objects in real images it is
0.9 to 1.5, and up to 15 where many reach across an edge, as of a mask that is too
large. Bodies whose noise came out five times too large were lost."""

FINE_WINDOW = 2.0
"""Half of the window that is taken for fine grain: what smooths by half a pixel leans
by less than the noise from there on."""

STEPS = 3.0
"""Steps of rounding by which an outlier lies off, at least."""

BEYOND = 10.0
"""Median distances from the median of an object's inverse depths beyond which a
reading is of what lies behind: of a cylinder that is seen from the side none is."""

MOST_GRAIN = 0.99
"""Part of the variance that is grain, at most: no reading is without an error."""

LEAST_OWN = 1 / 3
"""Deviation of a reading's own error over that of smooth ones, at least: where these
are almost all, as in depth that a network tells, most of a wall would be outliers."""

CURVED = 2.5
"""Variance of differences of an object over that of neighbors from which errors are
shared, where no plane around it tells."""

MOST_ROUNDED = 1.35
"""Noise of an object over that of rounding up to which there is no other, where planes
tell none."""

NUM_DEPTHS = 5
"""Ranges of depth in which noise is measured."""


class MeasuredNoise(NamedTuple):
    """What an image tells of its noise.

    Attributes:
        noise: The model of it.
        text: What a reader is told of it.
        is_of_all: Whether the model holds at all depths, wherever it was measured.
        around: What planes told, where the noise is white.
    """

    noise: AbstractDepthNoise
    text: str
    is_of_all: bool = False
    around: Around = Around()


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
    # All that is looked at: in a large image it may be little.
    windows = [cropped(region), *windows_of(beside if beside.any() else seen)]
    if sum(image[window].size for window in windows) > image.size:
        windows = [np.s_[:, :]]
    return _measured(_despiked(image, region, windows), region, camera)


def _despiked(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    windows: Sequence[Window] = (np.s_[:, :],),
) -> Float[np.ndarray, "h w"]:
    """Some windows of an image, without readings that lie far from what is around them.

    Differences of the fourth order hold five readings each: of a tenth of outliers two
    fifths are wrong, more than clipping takes away. Where they are so many that they
    hide each other, no reading is left.
    """
    usual, num_seen, num_spikes = np.zeros_like(image), 0, 0
    for window in windows:
        part = _without_islands(image[window], region[window])
        is_spike = _spikes(part)
        usual[window] = np.where(is_spike, 0, part)
        num_seen += np.count_nonzero(part)
        num_spikes += np.count_nonzero(is_spike)
    return usual if num_spikes <= MOST_SPIKES * num_seen else np.zeros_like(image)


def _without_islands(
    image: Float[np.ndarray, "h w"], region: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w"]:
    """An image without what is small and lies far from what is around it.

    Holes that a camera or a file fills with a number make jumps, which differences of
    pixels that are far apart take for errors that neighbors share: where they were a
    twentieth of a can, its radius was 450 times less sure.

    Args:
        image: Depths in meters; 0 where there is no reading.
        region: Pixels of the object.
    """
    seen = image > 0
    if not seen.any():
        return image
    depth = np.ascontiguousarray(image, np.float32)
    high = cv2.dilate(depth, SQUARE)
    low = cv2.erode(np.where(seen, depth, np.inf).astype(np.float32), SQUARE)
    is_inner = (seen & (high / (1 + JUMP) <= low)).astype(np.uint8)
    count, labels = cv2.connectedComponents(is_inner, connectivity=4)
    own = np.bincount(labels[region], minlength=count)
    is_small = np.bincount(labels.ravel()) < ISLAND
    is_small &= own <= OF_OBJECT * np.count_nonzero(region)
    is_small[0] = False
    if not is_small.any():
        return image
    # With their own border, and what lies beside that.
    island = np.isin(labels, np.flatnonzero(is_small)).astype(np.uint8)
    island = cv2.dilate(island, SQUARE) > 0
    jumps = np.count_nonzero(seen & ((is_inner == 0) | island))
    is_noise = jumps > MOST_JUMPS * np.count_nonzero(seen)
    return image if is_noise else np.where(island, 0, image)


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


class _Own(NamedTuple):
    """Readings of an object, and what they tell of the noise by themselves.

    Attributes:
        depth: In the object's box, in meters.
        inverse: 1 / depth; 0 where it is not the object's.
        use: Which are the object's.
        middle: Their median depth.
        levels: Variance of inverse depth, along each axis, between readings of a lag.
        step: To which they are rounded, of inverse depth; 0 where they are not.
    """

    depth: Float[np.ndarray, "h w"]
    inverse: Float[np.ndarray, "h w"]
    use: Bool[np.ndarray, "h w"]
    middle: float
    levels: dict[int, list[float]]
    step: float

    @staticmethod
    def of(
        image: Float[np.ndarray, "h w"], region: Bool[np.ndarray, "h w"]
    ) -> "_Own | None":
        """Those of a region; None where too few tell of noise."""
        some = region & (image > 0)
        if np.count_nonzero(some) < FEWEST:
            return None
        box = cropped(region)
        depth, use = image[box].astype(float), some[box]
        inverse = np.where(use, 1 / np.where(use, depth, 1), 0)
        # What a mask shows beside the object makes jumps.
        values = inverse[use]
        off = np.abs(values - np.median(values[at_most(len(values), SAMPLE)]))
        usual = float(np.median(off[at_most(len(off), SAMPLE)]))
        is_beside = (off > BEYOND * usual) & (usual > 0)
        if is_beside.any():
            use[use] = ~is_beside
            inverse[~use] = 0
        middle = float(np.median(depth[use]))
        levels = {lag: variances(inverse, use, lag, 4) for lag in (1, NEAR)}
        step = _step(depth[use]) / middle**2
        own = _Own(depth, inverse, use, middle, levels, step)
        return own if levels[1] else None

    @property
    def is_exact(self) -> bool:
        """Whether there is no noise but what rounding of single precision makes."""
        return self.white * self.middle <= LEAST

    @property
    def white(self) -> float:
        """Deviation of the noise that neighbors do not share, of inverse depth."""
        # Along the axis along which the surface bends less.
        return max(math.sqrt(min(self.levels[1])), self.step / math.sqrt(12))

    @property
    def total(self) -> float:
        """The same with what they share."""
        far = variances(self.inverse, self.use, FAR, 3, MOST_MIXED)
        far = far or variances(self.inverse, self.use, NEAR, 3, MOST_MIXED)
        return max(self.white, math.sqrt(min(far))) if far else self.white

    @property
    def is_filtered(self) -> bool:
        """Whether neighbors share errors, along rows and along columns."""
        near, apart = self.levels[1], self.levels[NEAR]
        if len(near) < 2 or len(apart) < 2:
            return False
        least = self.step**2 / 12
        pairs = zip(near, apart, strict=True)
        return all(far > CURVED * max(one, least) for one, far in pairs)

    def is_rounded(self, around: Around) -> bool:
        """Whether rounding is all that they err by, as planes do."""
        if not around.step:
            return False
        # Where planes tell nothing but the step, the object alone tells more.
        most = (MOST_ROUNDED * around.step) ** 2 / 12
        return not around.is_equal or min(variances(self.depth, self.use, 1, 4)) < most


def _measured(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: AbstractRays,
    is_scene: bool = False,
) -> MeasuredNoise | None:
    """The same of an image without outliers; whether the region is of many things."""
    own = _Own.of(image, region)
    if own is None:
        return None
    if not isinstance(camera, PinholeCamera):
        return None if own.is_exact else _white(own, Around())
    seen = image > 0
    beside = seen & ~region
    is_beside = bool(beside.any())
    around = around_of(image, beside if is_beside else seen, camera)
    if around is not None and not (is_beside or is_scene):
        # An object by itself bends: differences of the fourth order tell of filters,
        # and its fit of smooth errors. Those far apart do not tell grain from that.
        is_filtered = around.is_filtered and own.is_filtered
        bands = around.bands if is_filtered else 0.0
        told = {"is_filtered": is_filtered, "bands": bands, "warp": 0.0, "grain": None}
        around = around._replace(**told)
    if around is None:
        next_but_one = variances(own.inverse, own.use, NEXT, 4)
        fine = own.is_filtered and is_fine(next_but_one, own.levels[NEAR])
        around = Around(own.is_filtered, fine, pixel=pixel_of(camera))
    if own.is_exact and not around.is_smooth:
        return None
    if own.is_rounded(around):
        return _rounded(around.step)
    if around.is_filtered or (around.bands > 0 and not around.warp > 0):
        # Bands alone are those of cameras that match windows.
        return _matched(own, around)
    return _white(own, around.at(own.middle, own.white) if is_beside else around)


def law_of_noise(
    image: Float[np.ndarray, "h w"], camera: AbstractRays
) -> MeasuredNoise:
    """How the noise of an image grows with depth, whatever it shows; 1 mm if nothing.

    Args:
        image: Depths in meters; 0 where there is no reading.
        camera: That took it.
    """
    usual = _despiked(image, image > 0)
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
        own = _Own.of(usual, seen & (usual >= low) & (usual <= high))
        if own is not None and (whole.around.is_smooth or not own.is_exact):
            middles.append(own.middle)
            level = _with_least(own.white, whole.around)
            levels.append(level * own.middle**2)
    if not levels:
        return whole
    noise = _growing(np.array(middles), np.array(levels))
    if whole.around.is_smooth:
        noise = _with_smooth(noise, whole.around)
    return whole._replace(noise=noise)


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


def _white(own: _Own, around: Around) -> MeasuredNoise:
    level = _with_least(own.white, around) * own.middle**2
    noise, text = checked_noise(level), f"white noise of {1e3 * level:.3g} mm"
    if around.is_smooth:
        noise = _with_smooth(noise, around)
        text += (
            f", smooth errors of {1e3 * around.smooth * own.middle**2:.2g} mm; the "
            "scale, which no image tells, is counted"
        )
    return MeasuredNoise(noise, f"Measured in the image: {text}.", around=around)


def _with_least(level: float, around: Around) -> float:
    """Deviation of each reading's own error, of inverse depth, or the least of it."""
    return max(level, LEAST_OWN * around.smooth)


def _rounded(step: float) -> MeasuredNoise:
    text = f"Depth is rounded to {1e3 * step:.3g} mm, and planes show no other noise."
    return MeasuredNoise(checked_noise(step / math.sqrt(12)), text, is_of_all=True)


def _matched(own: _Own, around: Around) -> MeasuredNoise:
    """That of a camera that matches windows."""
    total = _with_least(own.total, around)
    if not around.is_smooth:
        around = around._replace(bands=max(BANDS, total))
    part = 0.0 if around.grain is None else min(around.grain.part, MOST_GRAIN)
    # What neighbors share is of the inverse depth.
    law = StereoDisparity(1.0, 1.0, total * math.sqrt(1 - part), step=0.0)
    # Static numbers take few values, so that other images do not compile a fit anew.
    window = (
        {"half_window": FINE_WINDOW}
        if around.is_fine
        else {"native_scale": around.pixel}
    )
    noise = MatchingWindow(law, **window)
    if around.grain is not None:
        noise = CorrelatedNoise(noise, total * math.sqrt(part), around.grain.length)
    noise, square = _with_smooth(noise, around), own.middle**2
    text = (
        f"Measured in the image: noise of {1e3 * total * square:.2g} mm that "
        f"neighbors share, smooth errors of {1e3 * around.smooth * square:.2g} mm; "
        f"readings within {noise.bias.window_reach} pixels of jumps are left out, and "
        "the scale, which no image tells, is counted."
    )
    return MeasuredNoise(noise, text, is_of_all=True)


def _with_smooth(noise: AbstractDepthNoise, around: Around) -> AbstractDepthNoise:
    """With the smooth errors that planes show, and an unknown scale."""
    lengths = SHORT * around.pixel, LONG
    for deviation, length in zip((around.bands, around.warp), lengths, strict=True):
        if deviation > 0:
            noise = CorrelatedNoise(noise, deviation, length)
    return ScaleError(noise, OFFSET, law="disparity")


def _step(depth: Float[np.ndarray, " n"]) -> float:
    """Step to which depths are rounded, in meters; 0 where they are not."""
    depth = depth[:: -(-len(depth) // SAMPLE)]
    steps = np.diff(np.unique(depth))
    if len(steps) < 2 or len(steps) > len(depth) / 4:
        return 0.0
    return float(np.median(steps))
