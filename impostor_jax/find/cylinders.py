"""Find every cylinder in a depth image."""

__all__ = ["MOST_PIXELS", "checked_radii", "find_cylinders", "read_by"]

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.arguments import is_concrete, real_number, whole_number
from impostor_jax.camera.base import AbstractCamera, not_accepted
from impostor_jax.camera.spherical import SphericalCamera
from impostor_jax.device import on_processor
from impostor_jax.effort import Effort, effort_of
from impostor_jax.find.fitting import Fitter
from impostor_jax.find.found import Found
from impostor_jax.find.planes import PlaneRegions, primitives_of
from impostor_jax.find.search import Detection, Request, search
from impostor_jax.find.sectors import sectors_of, view_of_sector
from impostor_jax.find.view import View, dense_stride, view_of
from impostor_jax.fit.far import near_prior, told_in_world
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.measured import law_of_noise, law_of_pixels
from impostor_jax.fit.options import Options
from impostor_jax.fit.per_pixel import PerPixelNoise
from impostor_jax.fit.ranges import warn_of_ranges
from impostor_jax.fit.regions import warn_of_units
from impostor_jax.fit.request import checked_noise, checked_prior, checked_readings
from impostor_jax.primitives.local_world import LocalWorld
from impostor_jax.primitives.plane import Plane
from impostor_jax.rendering.render import render
from impostor_jax.sensor.base import AbstractDepthNoise

MOST_PIXELS = 340_000
"""That are searched, a little more than 640 x 480; of a larger image every n-th row and
column. The fits take all."""

MOST_SHARED = 0.3
"""Part of what shows a cylinder that may show another one, found in another sector of
a scan, too."""

FEWEST_READINGS = 4096
"""That a fit of a search takes, if there are so many."""

SURE_PRIOR = 4.0
"""Standard deviations of a prior radius within which one is looked for."""


@on_processor
def find_cylinders(
    depth: Any,
    camera: AbstractCamera,
    sigma: Any = None,
    *,
    min_pixels: int = Request.min_pixels,
    min_arc: float = Request.min_arc,
    radius_range: tuple[float, float] = Request.radius_range,
    prior: Mapping[str, Any] | None = None,
    effort: Effort | str = "balanced",
) -> Found:
    """Find every cylinder in a depth image, without a mask.

        found = ij.find_cylinders(depth, camera, sigma=ij.StructuredLight())
        print(found)
        print(found.fits[0], found.confidence[0])

    Tables, walls and other planes are taken away; walls of cylinders are proposed from
    patches of the rest, compared with the image as they would be rendered, and fitted
    as `fit_cylinder` does. Cones, balls, edges of boxes and bent things are told from
    cylinders by what departs from one. Of cans of one radius that stand exactly on each
    other one is found.

    Args:
        depth: (H, W), planar depth in meters, of a scanner ranges; 0, NaN and infinity
            mean no reading.
        camera: That took it: with or without a lens, orthographic, or a scanner, whose
            sectors are searched one after the other, up to 60 degrees of elevation.
        sigma: Standard deviation of a reading in meters; (H, W) of each, as in
            `fit_cylinder`; or a noise model of the sensor. If None it is measured in
            the image, by each fit among its own readings. Where planes show that it is
            larger, that counts.
        min_pixels: Fewest pixels of a cylinder; 150 by default.
        min_arc: Smallest angle about its axis over which it, or the rim of a cap, is
            seen, in radians; 0.6 by default.
        radius_range: Smallest and largest radius, in meters; 3 mm to 1 m by default.
        prior: As of `fit_cylinder`. A radius is looked for within four standard
            deviations.
        effort: How much work it takes, as of `fit_cylinder`; `stride` says that every
            n-th row and column is searched. Without doubts the quick fit by which a
            candidate is tried is the one that is returned.

    Returns:
        What was found, the surest first; the same for the same image. Nothing that is
        less likely than not.

    Raises:
        ValueError: An argument has a wrong shape, dtype or value, or is traced.
    """
    if not is_concrete((depth, camera, sigma, prior)):
        raise ValueError("depth, camera, sigma and prior must be concrete, got traced "
                         "ones: a search runs outside JAX")  # fmt: skip
    if not isinstance(camera, AbstractCamera):
        raise ValueError(f"camera must be a camera, got {not_accepted(camera)}")
    options = Options(prior=prior, effort=effort_of(effort))
    checked_prior(prior, CYLINDER.parameters, None)
    world = LocalWorld.of([camera])
    if world is not None:
        # Nothing that is found near it lies far from the origin of that.
        found = find_cylinders(
            depth,
            world.seen_by(camera),
            sigma,
            min_pixels=min_pixels,
            min_arc=min_arc,
            radius_range=radius_range,
            prior=near_prior(world, prior),
            effort=effort,
        )
        return _told_in_world(world, found, camera, options)
    request = Request(
        min_pixels=whole_number("min_pixels", min_pixels, 1),
        min_arc=real_number("min_arc", min_arc, positive=True, unit="radians"),
        radius_range=checked_radii(radius_range, prior),
    )
    image, noise, told = read_by(depth, camera, sigma)
    if isinstance(camera, SphericalCamera) and min(image.shape) < 2:
        raise ValueError(
            f"camera must have two rows and columns at least, got {image.shape}"
        )
    options = dataclasses.replace(options, effort=_of_fits(options.effort))
    warn_of_ranges(image, camera)
    is_measured = sigma is None and told is not None
    parts = [
        (view, dataclasses.replace(fitter, is_measured=is_measured))
        for view, fitter in _parts(image, camera, noise, told, options)
    ]
    for _, fitter in parts[:1]:
        fitter.prepare()
    found = [search(view, request, fitter) for view, fitter in parts]
    detections = sorted(
        _distinct([one for part in found for one in part.detections]),
        key=lambda one: -one.confidence,
    )
    if not detections:
        # Noise that was measured is in the same units.
        usual = checked_noise(None) if sigma is None else noise
        warn_of_units(image, image > 0, usual)
    masks = [one.mask for one in detections]
    return Found(
        fits=tuple(one.fit for one in detections),
        masks=np.array(masks, bool).reshape(-1, *image.shape),
        visible=np.array(
            [
                _visible(one.fit.cylinder, camera, mask)
                for one, mask in zip(detections, masks, strict=True)
            ]
        ),
        confidence=np.array([one.confidence for one in detections]),
        inside=np.array([one.entry.evidence.wall.side < 0 for one in detections], bool),
        planes=_planes(parts, [part.planes for part in found]),
    )


def read_by(
    depth: Any, camera: AbstractCamera, sigma: Any
) -> tuple[Float[np.ndarray, "h w"], AbstractDepthNoise, Any]:
    """Depth in meters, its noise, and what fits are told of that.

    Where nothing is told it is measured in the image. A fit measures white noise among
    its own readings; what neighbors share is the camera's.
    """
    image, noise, told = checked_readings(depth, camera, sigma)
    if isinstance(noise, PerPixelNoise):
        noise = law_of_pixels(noise, np.asarray(image))
    if sigma is None:
        noise = law_of_noise(np.asarray(image), camera).noise
        if noise.bias.fields:
            image, noise, told = checked_readings(depth, camera, noise)
    return np.asarray(image), noise, told


def _of_fits(effort: Effort) -> Effort:
    """What the fits of a search take, of which more depends than of one fit."""
    readings = effort.readings and max(effort.readings, FEWEST_READINGS)
    steps = max(effort.max_steps, Effort.max_steps)
    return dataclasses.replace(effort, readings=readings, max_steps=steps)


def _told_in_world(
    world: LocalWorld, found: Found, camera: AbstractCamera, options: Options
) -> Found:
    """What was found in a local world, in the world that a camera is in."""
    fits = []
    for fit in found.fits:
        asked = fit.asked.arguments
        start = None if asked is None else asked["initial"]
        known = {
            "camera": camera,
            "initial": None if start is None else world.told_in_world(start),
            "options": options,
        }
        fits.append(told_in_world(world, fit, known))
    planes = world.told_in_world(found.planes)
    return dataclasses.replace(found, fits=tuple(fits), planes=planes)


def _parts(
    image: Float[np.ndarray, "h w"],
    camera: AbstractCamera,
    noise: AbstractDepthNoise,
    sigma: Any,
    options: Options,
) -> list[tuple[View, Fitter]]:
    """What is searched one after the other: an image, or the sectors of a scan."""
    asked, stride = (noise, sigma, options), options.effort.stride
    if not isinstance(camera, SphericalCamera):
        stride = dense_stride(image, stride)
        view = view_of(image, camera, noise, MOST_PIXELS, stride)
        return [(view, Fitter.of(image, camera, *asked))]
    return [
        (
            view_of_sector(sector, image, camera, noise, MOST_PIXELS, stride),
            Fitter.of_sector(sector, image, camera, *asked),
        )
        for sector in sectors_of(camera)
    ]


def _distinct(detections: list[Detection]) -> list[Detection]:
    """What was found, and in several sectors once: where most of it is seen."""
    kept: list[Detection] = []
    for one in sorted(detections, key=lambda one: -np.count_nonzero(one.mask)):
        most = MOST_SHARED * np.count_nonzero(one.mask)
        if all(np.count_nonzero(one.mask & other.mask) <= most for other in kept):
            kept.append(one)
    return kept


def checked_radii(
    radius_range: tuple[float, float], prior: Mapping[str, Any] | None
) -> tuple[float, float]:
    """Range of the radii that are looked for, in meters."""
    if not isinstance(radius_range, tuple | list) or len(radius_range) != 2:
        raise ValueError(
            f"radius_range must be two lengths in meters, got {radius_range!r}"
        )
    low, high = (
        real_number("radius_range", end, positive=True, unit="meters")
        for end in radius_range
    )
    if not low < high:
        raise ValueError(
            f"radius_range must be the smaller and the larger, got {radius_range!r}"
        )
    if prior and "radius" in prior:
        value, deviation = (float(x) for x in prior["radius"])
        low = max(low, value - SURE_PRIOR * deviation)
        high = min(high, value + SURE_PRIOR * deviation)
        if not low < high:
            raise ValueError(
                "radius_range must hold radii that prior['radius'] admits, got "
                f"{radius_range!r} and {prior['radius']!r}"
            )
    return low, high


def _visible(
    shape: Any, camera: AbstractCamera, mask: Bool[np.ndarray, "h w"]
) -> float:
    """Part of a silhouette, within the frame, that is seen."""
    whole = np.asarray(render(shape, camera, outputs=("mask",)).mask)
    return float(np.count_nonzero(whole & mask) / max(np.count_nonzero(whole), 1))


def _planes(parts: list[tuple[View, Fitter]], regions: list[PlaneRegions]) -> Plane:
    """Planes in the world frame, their normals towards the camera."""
    dtype = jnp.result_type(float)
    points, normals = [], []
    for (view, fitter), some in zip(parts, regions, strict=True):
        point, normal = (jnp.asarray(x, dtype) for x in primitives_of(view, some))
        if fitter.searched_from_world is not None:
            back = fitter.searched_from_world.inverse()
            point, normal = back.apply(point), back.rotate(normal)
        points.append(point)
        normals.append(normal)
    return Plane(jnp.concatenate(points), jnp.concatenate(normals))
