"""A sensor, calibrated from its own images.

On a plane every deviation is the sensor's. What neighbors differ by tells the noise of
single readings and the grain; what cells of many pixels have in common tells the warp;
and a cylinder whose radius is known tells the scale.
"""

__all__ = ["Calibration", "calibrate_sensor", "calibration_of"]

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import is_concrete, one_of, real_number
from impostor_jax.calibrate.differences import differences_of
from impostor_jax.calibrate.flats import Flat, flat_of, without_bends
from impostor_jax.calibrate.laws import KINDS, Kind, law_of_all, readings_of, sigma_of
from impostor_jax.calibrate.request import (
    checked_images,
    checked_masks,
    checked_objects,
)
from impostor_jax.calibrate.scale import Scale, scale_of
from impostor_jax.calibrate.warp import Smooth, Warp, warp_of
from impostor_jax.camera.base import AbstractCamera, check_depth_along_z, not_accepted
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.device import on_processor
from impostor_jax.numerics import Numbers
from impostor_jax.sensor.base import AbstractDepthNoise, Depths, Normals
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.correlated import CorrelatedNoise
from impostor_jax.sensor.fields import SmoothField
from impostor_jax.sensor.matching_window import MatchingWindow
from impostor_jax.sensor.scale_error import ScaleError

FEWEST_PIXELS = 3000
"""On planes, in all images: of these, a correlated few hundred tell of noise."""

MARGIN = 2
"""Pixels that are left out at the edge of a plane, beyond what a window reaches."""

GENEROUS = 1.5
"""Factor of the noise by which planes are looked for: no deviation is cut off."""

MOST_GRAIN = 2.0
"""Variance of the grain over that of single readings, at most: a fit holds readings to
the law, and would call a can a poor fit whose readings err by three times as much."""

USUAL_WARP = Smooth(0.001, 24.0)
"""With which differences are first compared."""

LONGER = 2.0
"""Factor of the length with which a warp is looked for again."""

DIGITS = 4
"""Of the numbers of a sensor: no calibration tells more."""


class Calibration(NamedTuple):
    """What images tell of a sensor.

    Attributes:
        sensor: The noise model.
        law: Its noise of single readings.
        power: Of the depth, with which smooth errors grow.
        grain: The error that next neighbors share, if there is one.
        is_filtered: Whether that is most of the noise: then the law counts it, too.
        warp: The error that many pixels share, if there is one.
        scale: The error of all depths, if an object of known size was seen.
        depths: Smallest and largest on planes, in meters.
        num_planes: In all images.
        num_pixels: On planes.
        num_images: With planes.
    """

    sensor: AbstractDepthNoise
    law: AbstractDepthNoise
    power: float
    grain: Smooth | None
    is_filtered: bool
    warp: Warp | None
    scale: Scale | None
    depths: tuple[float, float]
    num_planes: int
    num_pixels: int
    num_images: int

    def summary(self) -> str:
        """What was found, line by line, for a reader."""
        near, far = self.depths
        places = np.geomspace(near, far, 3)
        sigmas = sigma_of(self.law, places, np.ones(3))
        noise = ", ".join(
            f"{1e3 * sigma:.2f} mm at {depth:.2f} m"
            for sigma, depth in zip(sigmas, places, strict=True)
        )
        lines = [
            f"{self.num_planes} planes in {self.num_images} images, "
            f"{self.num_pixels} pixels",
            f"  noise   {noise} (face on)",
        ]
        at = " at 1 m" if self.power else ""
        if self.grain is None:
            lines.append("  grain   none")
        else:
            deviation, length = self.grain
            there = ", counted in the noise too" if self.is_filtered else ""
            lines.append(
                f"  grain   {1e3 * deviation:.2f} mm{at}, {length:.1f} px{there}"
            )
        if self.warp is None:
            lines.append("  warp    none")
        else:
            deviation, length = self.warp.deviation, self.warp.length
            of_deviation, of_length = self.warp.relative_errors
            lines.append(
                f"  warp    {1e3 * deviation:.2f} mm{at} "
                f"(std {1e3 * deviation * of_deviation:.2f}), "
                f"{length:.0f} px (std {length * of_length:.0f})"
            )
        if self.scale is not None:
            unit = "1/m of disparity" if self.power else "of the depth"
            lines.append(
                f"  scale   off by {self.scale.mean:.4f} {unit} "
                f"(std {self.scale.deviation:.4f}, {self.scale.number} images)"
            )
        return "\n".join(lines)


@on_processor
def calibrate_sensor(
    depths: Any,
    camera: AbstractCamera,
    mask: Any = None,
    *,
    kind: str = "structured_light",
    objects: Any = None,
    radius: Any = None,
    half_window: Any = 4.3,
    native_scale: Any = 1.0,
    baseline: Any = 0.05,
) -> AbstractDepthNoise:
    """The noise model of a sensor, from images of planes.

        sensor = ij.calibrate_sensor(depths, camera)
        fit = ij.fit_cylinder(depth, camera, sigma=sensor)

    Planes are looked for in each image: walls, tables, floors, at the distances and
    slants at which the sensor will be used. Where images are of one distance, the noise
    grows with it as is usual. The error of matching at edges is not measured, its reach
    is given; and planes do not show errors of which a plane stays one.

    Args:
        depths: (N, H, W) or (H, W), planar depth in meters; 0, NaN and infinity mean no
            reading.
        camera: That took them.
        mask: Of the same shape, or of one image for all: True on pixels that may be
            used; all if None.
        kind: Of the sensor: "structured_light", "stereo", "time_of_flight" or
            "constant". The first two match windows; their smooth errors are of the
            disparity, and grow with the square of the depth. Those of the others do not
            grow.
        objects: Of the same shape as depths: True on the wall of a cylinder of known
            size, as a mask of `fit_cylinder`; none where it is not seen. With a radius.
            The scale's error is then a part of the sensor: an offset of the disparity
            of the first two kinds, which is what was measured on such cameras, and a
            factor of the others. One distance does not tell the two apart.
        radius: Of that cylinder, in meters.
        half_window: As of `MatchingWindow`, for the first two kinds.
        native_scale: Pixels of the image for one of the sensor's.
        baseline: Of a stereo camera, in meters: its deviation is in pixels by that.

    Returns:
        The law of single readings, in a `MatchingWindow` for the first two kinds; in a
        `CorrelatedNoise` for the grain, of some pixels, and one for the warp, of tens
        to hundreds, each if it is significant; and in a `ScaleError` if a size is
        known. Its deviation holds what so few images do not tell of the mean. Of images
        that were smoothed, whose readings have hardly any noise of their own, the law
        counts the grain, too: a fit judges itself by that. Readings that are drawn then
        err by up to 1.4 times as much.

    Raises:
        ValueError: An argument has a wrong shape, dtype or value, or is traced; too few
            pixels are on planes; or no fit of the objects succeeds.
    """
    return calibration_of(
        depths,
        camera,
        mask,
        kind=kind,
        objects=objects,
        radius=radius,
        half_window=half_window,
        native_scale=native_scale,
        baseline=baseline,
    ).sensor


def calibration_of(
    depths: Any,
    camera: AbstractCamera,
    mask: Any = None,
    *,
    kind: str = "structured_light",
    objects: Any = None,
    radius: Any = None,
    half_window: Any = 4.3,
    native_scale: Any = 1.0,
    baseline: Any = 0.05,
) -> Calibration:
    """What `calibrate_sensor` finds, with what it found it on."""
    given = depths, camera, mask, objects, radius, half_window, native_scale, baseline
    if not is_concrete(given):
        raise ValueError("depths, camera and what is known must be concrete, got "
                         "traced ones: a calibration runs outside JAX")  # fmt: skip
    if not isinstance(camera, AbstractCamera):
        raise ValueError(f"camera must be a camera, got {not_accepted(camera)}")
    check_depth_along_z(camera)
    one_of("kind", kind, KINDS)
    native_scale = real_number("native_scale", native_scale, positive=True)
    baseline = real_number("baseline", baseline, positive=True, unit="meters")
    images = checked_images(depths, camera)
    usable = checked_masks("mask", mask, images.shape)
    seen = checked_objects(objects, radius, camera, images.shape)
    of_kind = KINDS[kind]
    own: Any = camera
    first = of_kind.law(float(own.fx) / native_scale, baseline)
    # Its checks are those of the arguments.
    reach = MatchingWindow(first, half_window, native_scale).bias.window_reach
    margin = MARGIN + (int(reach) if of_kind.matches else 0)
    table = usable & ~seen
    # Planes are looked for by the usual noise, and again by what is found on them.
    flats = _flats(images, table, camera, _Total(first, ()), of_kind, margin)
    differences = differences_of(flats)
    rough = readings_of(differences, of_kind, first, USUAL_WARP, find_warp=True)
    noise = _Total(rough.law, _fields((rough.grain, rough.warp), of_kind))
    flats = _flats(images, table, camera, noise, of_kind, margin)
    variances = [_variance(flat, rough.law, of_kind.power) for flat in flats]
    flats = without_bends(flats, variances)
    law, grain, is_filtered, warp = _measured(flats, of_kind, first)
    fields = _fields((grain, warp), of_kind)
    sensor = law = jax.tree.map(_rounded, law)
    if of_kind.matches:
        sensor = MatchingWindow(law, half_window, native_scale)
    for field in fields:
        sensor = CorrelatedNoise(sensor, field.deviation, field.length, field.power)
    scale = None
    if radius is not None:
        relation = "disparity" if of_kind.matches else "scale"
        assert isinstance(camera, PinholeCamera)
        scale = scale_of(images, seen, float(radius), camera, sensor, relation)
        if scale is None:
            raise ValueError(
                "objects must show a cylinder that can be fitted, got none whose fit "
                "succeeds"
            )
        deviation, mean = _rounded(scale.deviation), _rounded(scale.mean)
        sensor = ScaleError(sensor, deviation, mean, relation)
    known = np.concatenate([flat.depth[flat.labels > 0] for flat in flats])
    return Calibration(
        sensor, law, of_kind.power, grain, is_filtered, warp, scale,
        depths=(float(known.min()), float(known.max())),
        num_planes=sum(len(np.unique(flat.labels)) - 1 for flat in flats),
        num_pixels=len(known),
        num_images=sum(bool(flat.labels.any()) for flat in flats),
    )  # fmt: skip


def _measured(
    flats: Sequence[Flat], kind: Kind, first: AbstractDepthNoise
) -> tuple[AbstractDepthNoise, Smooth | None, bool, Warp | None]:
    """Law, grain, whether that is most of the noise, and warp, as of `Calibration`."""
    differences = differences_of(flats)
    readings = readings_of(differences, kind, first, USUAL_WARP, find_warp=True)
    expected, longest = readings.warp, max(flats[0].labels.shape) / 2
    assert expected is not None
    expected = Smooth(expected.deviation, min(expected.length, longest / LONGER))
    warp, is_first = None, True
    while warp is None and expected.length < longest:
        variances = [_variance(flat, readings.law, kind.power) for flat in flats]
        warp = warp_of(flats, variances, readings.grain, expected)
        if warp is None:
            # What differences tell of is grain, then, and not all that there is.
            expected = Smooth(expected.deviation, LONGER * expected.length)
            if is_first:
                readings = readings_of(differences, kind, first, None)
            is_first = False
    known = None if warp is None else Smooth(warp.deviation, warp.length)
    if warp is not None and not is_first:
        readings = readings_of(differences, kind, first, known)
    law, grain = readings.law, readings.grain
    is_filtered = grain is not None and readings.ratio > MOST_GRAIN
    if grain is not None and is_filtered:
        law = law_of_all(differences, kind, first, known, grain)
    return law, grain, is_filtered, warp


def _variance(
    flat: Flat, law: AbstractDepthNoise, power: float
) -> Float[np.ndarray, "h w"]:
    """Of white noise, over depth to twice the power; 0 where there is no plane."""
    variance, on = np.zeros(flat.labels.shape), flat.labels > 0
    depth = flat.depth[on]
    variance[on] = (sigma_of(law, depth, flat.cosine[on]) / depth**power) ** 2
    return variance


def _flats(
    images: Float[np.ndarray, "n h w"],
    usable: Bool[np.ndarray, "n h w"],
    camera: AbstractCamera,
    noise: AbstractDepthNoise,
    kind: Kind,
    margin: int,
) -> list[Flat]:
    """The planes of all images; a `ValueError` where they are too few."""
    flats = [
        flat_of(image, camera, use, noise, kind.power, margin)
        for image, use in zip(images, usable, strict=True)
    ]
    count = sum(int(np.count_nonzero(flat.labels)) for flat in flats)
    if count < FEWEST_PIXELS:
        raise ValueError(
            f"depths must show planes on at least {FEWEST_PIXELS} pixels, {margin} and "
            f"more from their edges, got {count}: a bare wall or table does"
        )
    return flats


def _fields(
    smooth: Sequence[Smooth | Warp | None], kind: Kind
) -> tuple[SmoothField, ...]:
    return tuple(
        SmoothField(_rounded(part.deviation), kind.power, _rounded(part.length))
        for part in smooth
        if part is not None
    )


def _rounded(number: Any) -> float:
    return float(f"{float(number):.{DIGITS}g}")


class _Total(AbstractDepthNoise):
    """All deviations from a plane, for the search: nothing is drawn from it."""

    law: AbstractDepthNoise
    fields: tuple[SmoothField, ...]

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        square = self.law.sigma(depth, cos_incidence) ** 2
        for field in self.fields:
            square += field.shift(depth) ** 2
        return GENEROUS * jnp.sqrt(square)

    @property
    @override
    def bias(self) -> Bias:
        return Bias()

    @override
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        raise NotImplementedError
