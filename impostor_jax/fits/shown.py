"""A fit of an object that may have no mask: which pixels show it is found first.

Of a cylinder they are those of the surest one that a search finds. Where a start is
given, they are those that read near its surface; of a ball or a cup each large object
is fitted that stands out of the planes of the scene.
"""

__all__ = ["failure_of", "fit_or_failure", "fit_shown"]

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.arguments import is_concrete, working_precision
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.spherical import SphericalCamera
from impostor_jax.clouds.wall import walls_of
from impostor_jax.effort import MIN_READINGS
from impostor_jax.find.cylinders import MOST_PIXELS, find_cylinders
from impostor_jax.find.found import Found
from impostor_jax.find.normals import stray
from impostor_jax.find.objects import objects_of
from impostor_jax.find.planes import PlaneRegions, planes_of
from impostor_jax.find.search import Request
from impostor_jax.find.view import View, dense_stride, view_of
from impostor_jax.fit.border import FAILED, MANY
from impostor_jax.fit.far import fitted_near
from impostor_jax.fit.fittable import CYLINDER, Fittable, no_guess
from impostor_jax.fit.measured import NOT_MEASURED
from impostor_jax.fit.options import Options
from impostor_jax.fit.outline import fit_outline
from impostor_jax.fit.pose import in_double
from impostor_jax.fit.ranges import refuted_as_ranges
from impostor_jax.fit.regions import warn_of_units
from impostor_jax.fit.request import (
    FitRequest,
    Given,
    ReadingsError,
    TooFewReadingsError,
    check_readings,
    check_types,
    checked_depth,
    checked_mask,
    checked_prior,
    checked_readings,
    checked_settings,
)
from impostor_jax.fit.result import Fit
from impostor_jax.fit.shapes import fit_shape
from impostor_jax.fit.status import FitStatus
from impostor_jax.fit.surface import cropped, upper_median
from impostor_jax.fits.viewless import seen_across
from impostor_jax.opencv import cv2
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.rendering.render import render
from impostor_jax.sensor.base import AbstractDepthNoise

LARGEST = 0.5
"""Radius over the middle depth of an image, up to which a cylinder is looked for."""

BORDER = 8
"""Pixels along the border of an image of a plane that goes on beyond it: the cells that
planes are made of."""

LEAST_OF_BORDER = 0.1
"""How many of these there are at least, over the image's width and height."""

BESIDE = 4
"""Pixels beside a plane in which what stands on it begins."""

IN_FRONT, LEAST_IN_FRONT = 5.0, 20
"""Standard deviations from which readings there lie in front of it, and how many do."""

STEEPEST = 4.0
"""Widths of a pixel by which they rise in one pixel at most: what rises more hides the
plane, and does not stand on it."""

WITHIN = 0.1
"""Part of what is seen in a bore that lies within the convex hull of the rest of a
tube, at least: a fifth of some pipes. What stands behind a tube lies outside."""

SURE = 0.6
"""Probability that a cylinder is there, from which the rest of a mask is left out: that
the fit to all of it failed says that it is of something else."""

MOST_OF_MASK = 0.4
"""Part of a mask's readings that it has, at least."""

GOES_ON, LEAST_PIXELS = 0.08, 1.5
"""Radii and pixels by which the image shows the wall's outline beyond that cylinder's,
from which on what was left out is of the same wall: of ovals parts were fitted whose
radius was 8 % off, by up to four deviations."""

MOST_OBJECTS = 5
"""How many objects are fitted, the largest first."""

SMALL = (
    f"Cylinders of {Request.min_pixels} pixels and more are looked for: a smaller one "
    "needs a mask."
)
"""What a reader is told besides where an image without a mask shows none."""


@fitted_near
def fit_shown(request: FitRequest) -> Fit:
    """As `fit_shape`; without a mask the object is looked for, unless it is traced.

    Without depth the mask is all there is, and `fit_outline` fits.
    """
    if request.depth is None:
        return fit_outline(request)
    views = request.views
    are_masked = all(view.mask is not None for view in views)
    if request.options.mask_meaning == "outline" and not are_masked:
        # Pixels that are near a start, or found, end where that does.
        raise ValueError(
            "mask must be given where mask_meaning is 'outline', got None: the edge of "
            "what is found is no silhouette"
        )
    if not is_concrete(request._replace(mask=None).values):
        return fit_shape(request)
    if are_masked:
        fit = _fit_masked(request)
    else:
        fit = _fit_looked_for(request)
    return refuted_as_ranges(fit, views)


def _fit_masked(request: FitRequest) -> Fit:
    """Fit what a mask shows; where that fails, the cylinder that most of it shows.

    A bottle has a shoulder, a mug has a handle, and a segmenter's mask shows all.
    """
    kind, options, views = request.kind, request.options, request.views
    is_one = len(views) == 1 and request.initial is None
    is_region = options.mask_meaning == "region" and options.effort.doubts
    if kind is not CYLINDER or not is_one or not is_region:
        return fit_shape(request)
    fit = fit_shape(request, is_trial=True)
    if fit.is_shape or not is_concrete(request.mask):
        return fit
    mask = np.asarray(checked_mask(views[0].mask, views[0].camera))
    is_scan = isinstance(views[0].camera, SphericalCamera)
    is_unknown = fit.asked.measured == NOT_MEASURED
    if is_scan or is_unknown or fit.status is FitStatus.NO_FIRST_GUESS:
        found = _fit_from_wall(request, mask, is_unknown)
        if found is not None:
            return found
    if fit.status not in FAILED:
        return fit
    within = _fit_within(request, mask)
    if within is not None:
        return within
    # A trial may have ended early.
    return fit_shape(request) if np.count_nonzero(mask) > MANY else fit


def _fit_from_wall(
    request: FitRequest, mask: Bool[np.ndarray, "h w"], is_unknown: bool
) -> Fit | None:
    """Fit from a wall near which the readings of a checked mask lie as points.

    Where few rows see an object, as of a scanner with 16 lasers, no window of pixels
    tells a surface, nor its noise where that `is_unknown`. None where points do not
    tell a wall either.
    """
    (view,) = request.views
    image = np.asarray(checked_depth(view.depth, view.camera))
    rows, cols = np.nonzero(mask & (image > 0))
    ray = view.camera.rays(jnp.asarray(rows), jnp.asarray(cols), np.float32)
    start, along = (np.asarray(x.stack(), float) for x in (ray.origin, ray.direction))
    rotation, translation = in_double(view.camera.camera_from_world)
    points = (start + image[rows, cols, None] * along - translation) @ rotation
    for wall in filter(lambda wall: wall.is_known, walls_of(points)):
        begun = request._replace(initial=seen_across(points, wall).start)
        if not is_unknown:
            fit = fit_shape(begun)
        else:
            level = wall.scatter
            fit = fit_shape(begun._replace(sigma=level))
            if fit.is_shape:
                level *= fit.chi2.item() ** 0.5
                fit = fit_shape(begun._replace(sigma=level))
            text = f"Measured about its wall: noise of {1e3 * level:.3g} mm."
            fit = fit.noting(measured=text)
        if fit.is_shape:
            return fit
    return None


def _fit_within(request: FitRequest, mask: Bool[np.ndarray, "h w"]) -> Fit | None:
    """Fit the cylinder that most of a checked mask shows.

    None where none is sure, or another is half as large.
    """
    (view,), options = request.views, request.options
    with working_precision(options.effort.precision, request.values):
        image, _, sigma = checked_readings(view.depth, view.camera, view.sigma)
    inside = np.where(mask, np.asarray(image), 0)
    found = _looked_for(inside, view.camera, sigma, options)
    regions = [own & (inside > 0) for own in found.masks]
    shares = np.array([np.count_nonzero(own) for own in regions])
    shares = shares / np.count_nonzero(inside)
    if not len(shares) or np.sum(shares > shares.max() / 2) > 1:
        return None
    best = int(np.argmax(shares))
    if found.confidence[best] < SURE or shares[best] < MOST_OF_MASK:
        return None
    fit = fit_shape(request._replace(mask=regions[best]))
    if not fit.is_shape:
        return None
    gap = fit.outline_gap
    if gap is not None and gap.radii > GOES_ON and gap.pixels > LEAST_PIXELS:
        return None
    return fit.noting(
        doubt=f"{100 * shares[best]:.0f} % of the region is of the cylinder, and the "
        "rest was left out"
    )


def _fit_looked_for(request: FitRequest) -> Fit:
    """Fit what is found in images of which some have no mask.

    One noise of several images is of one sensor, so it is passed on as it was given.
    """
    # What is found goes on to what lies beside: it is cut down with any effort.
    effort = replace(request.options.effort, doubts=True)
    options = replace(request.options, effort=effort)
    request = request._replace(options=options)
    kind, views = request.kind, request.views
    if len(views) == 1:
        return _fit_found(FitRequest(kind, *views[0], request.initial, options))
    masks = _masks_of(request)
    if masks is None:
        images = [np.asarray(checked_depth(v.depth, v.camera)) for v in views]
        with working_precision(effort.precision, ()):
            return no_guess(kind, *(np.zeros(image.shape, bool) for image in images))
    return fit_shape(request._replace(mask=masks))


def _masks_of(request: FitRequest) -> list[Any] | None:
    """Masks of several views of which some have none; None where nothing is found.

    They are what reads near the start, or near what the views with a mask show, or else
    near what is found in the first view in which something is.
    """
    kind, views, options = request.kind, request.views, request.options
    for view in views:
        check_types(kind.shape, view.camera, request.initial)
    near = request.initial
    if near is None:
        masked = [view for view in views if view.mask is not None]
        alone = replace(options, fixed=(), mask_meaning="region")
        if masked:
            depths, cameras, masks, sigmas = map(list, zip(*masked, strict=True))
            asked = FitRequest(kind, depths, cameras, masks, sigmas, None, alone)
            fit = fit_shape(asked)
            near = fit.shape if fit.is_shape else None
        else:
            each = (FitRequest(kind, *view, None, alone) for view in views)
            fits = map(fit_or_failure, each)
            near = next((fit.shape for fit in fits if fit.is_shape), None)
    if near is None:
        return None
    masks = []
    for view in views:
        if view.mask is not None:
            masks.append(view.mask)
            continue
        with working_precision(options.effort.precision, view) as converted:
            image, noise, _ = checked_readings(view.depth, view.camera, view.sigma)
            shape, noise = converted((near, noise))
            masks.append(_near(shape, kind, np.asarray(image), view.camera, noise))
    return masks


def _fit_found(request: FitRequest) -> Fit:
    """Fit what is found in an image without a mask."""
    kind, depth, camera, _, sigma, initial, options = request
    check_types(kind.shape, camera, initial)
    precision = options.effort.precision
    with working_precision(precision, request.values) as converted:
        # Before a search: it takes longer than all else.
        checked_settings(kind, options, initial, sigma)
        checked_prior(options.prior, kind.expectable, initial)
        image, noise, sigma = checked_readings(depth, camera, sigma)
        image = np.asarray(image)
        check_readings([Given(image, camera, None, sigma)])
        if initial is not None:
            start, noise = converted((initial, noise))
            masks = [_near(start, kind, image, camera, noise)]
        elif kind is CYLINDER:
            masks = list(_looked_for(image, camera, sigma, options).masks[:1])
        else:
            masks = _objects(kind, image, camera, noise)
    fits = [
        fit_shape(FitRequest(kind, image, camera, one, sigma, initial, options))
        for one in masks
        if np.count_nonzero(image[one]) >= MIN_READINGS
    ]
    if len(fits) == 1:
        return fits[0]
    good = [fit for fit in fits if fit.is_shape]
    if not good:
        warn_of_units(image, image > 0, noise)
        with working_precision(precision, ()):
            nothing = no_guess(kind, np.zeros(image.shape, bool))
        is_search = kind is CYLINDER and initial is None
        return nothing.noting(doubt=SMALL) if is_search else nothing
    return max(good, key=lambda fit: fit.num_inliers)


def _looked_for(
    image: Float[np.ndarray, "h w"],
    camera: AbstractCamera,
    sigma: Any,
    options: Options,
) -> Found:
    """Cylinders in an image that shows one."""
    prior = {name: x for name, x in (options.prior or {}).items() if name == "radius"}
    low, high = Request.radius_range
    # The caller says that there is one: before a camera that stands far off, a silo.
    some = image[image > 0]
    high = max(high, LARGEST * float(upper_median(some)) if len(some) else 0)
    if prior:
        # Of what is known the search itself takes what is likely.
        value = float(prior["radius"][0])
        low, high = min(low, value / 2), max(high, 2 * value)
    return find_cylinders(
        image,
        camera,
        sigma,
        radius_range=(low, high),
        prior=prior or None,
        effort=options.effort,
    )


def _near(
    initial: AbstractPrimitive,
    kind: Fittable,
    image: Float[np.ndarray, "h w"],
    camera: AbstractCamera,
    noise: AbstractDepthNoise,
) -> Bool[np.ndarray, "h w"]:
    """Pixels that read within half a radius, or 5 sigma, of a start."""
    depth = render(initial, camera, outputs=("depth",)).depth
    assert depth is not None
    radius = kind.body.of(initial).radius
    return np.asarray(_reads_near(jnp.asarray(image), depth, noise, radius))


@jax.jit
def _reads_near(
    image: Float[Array, "h w"],
    depth: Float[Array, "h w"],
    noise: AbstractDepthNoise,
    radius: Float[Array, ""],
) -> Bool[Array, "h w"]:
    is_hit = jnp.isfinite(depth)
    depth = jnp.where(is_hit, depth, 1).astype(image.dtype)
    sigma = noise.sigma(depth, jnp.ones_like(depth))
    reach = jnp.maximum(5 * sigma, radius.astype(image.dtype) / 2)
    return is_hit & (image > 0) & (jnp.abs(image - depth) <= reach)


def _objects(
    kind: Fittable,
    image: Float[np.ndarray, "h w"],
    camera: AbstractCamera,
    noise: AbstractDepthNoise,
) -> list[Bool[np.ndarray, "h w"]]:
    """Pixels of the largest objects that stand out of planes, as a search sees them."""
    view = view_of(image, camera, noise, MOST_PIXELS, dense_stride(image, 1))
    usable = view.valid & ~stray(view)
    planes = planes_of(view, usable)
    around = _surroundings(view, planes, kind.most_of_face)
    on_plane = np.isin(planes.labels, around)
    fewest = -(-MIN_READINGS // view.stride**2)
    labels = objects_of(view, usable & ~on_plane, planes.noise, fewest)
    if kind.closed is not None:
        labels = _with_what_is_within(labels)
    labels = view.enlarged(labels, image.shape)
    count = min(int(labels.max(initial=0)), MOST_OBJECTS)
    return [(labels == number) & (image > 0) for number in range(1, count + 1)]


def _with_what_is_within(labels: Int[np.ndarray, "h w"]) -> Int[np.ndarray, "h w"]:
    """Objects together with those that are seen in their bores: a rim parts the two."""
    told = labels.copy()
    for number in range(1, min(int(labels.max(initial=0)), MOST_OBJECTS) + 1):
        own = told == number
        if not own.any():
            continue
        hull = cv2.convexHull(np.argwhere(own)[:, ::-1].astype(np.int32))
        inside = cv2.fillConvexPoly(own.astype(np.uint8), hull, 1) > 0
        count = int(labels.max()) + 1
        within = np.bincount(told[inside], minlength=count)
        is_within = within > WITHIN * np.bincount(told.ravel(), minlength=count)
        is_within[0] = False
        told[is_within[told]] = number
    return told


def _surroundings(view: View, planes: PlaneRegions, most: float) -> list[int]:
    """Planes that an object stands out of, and that are no faces of one.

    They go on beyond the image, are larger than a face, or something stands on them:
    what is seen beside a face of a box or the end of a cup lies behind it.

    Args:
        view: What is looked at.
        planes: That it shows.
        most: Part of the image that a face takes, as of `Fittable`.
    """
    labels, found = planes.labels, []
    counts = np.bincount(labels.ravel(), minlength=len(planes.planes) + 1)
    sides = labels[:BORDER], labels[-BORDER:], labels[:, :BORDER], labels[:, -BORDER:]
    at_border = np.concatenate([side.ravel() for side in sides])
    goes_on = np.bincount(at_border, minlength=len(counts))
    least = LEAST_OF_BORDER * sum(labels.shape)
    # Of two that meet in a corner the larger is what the other stands on.
    for number in 1 + np.argsort(-counts[1:], kind="stable"):
        is_around = goes_on[number] >= least or counts[number] > most * labels.size
        if is_around or _carries(view, planes, int(number), found):
            found.append(int(number))
    return found


def _carries(
    view: View, planes: PlaneRegions, number: int, around: Sequence[int]
) -> bool:
    """Whether beside a plane there is something in front that begins on it.

    Args:
        view: What is looked at.
        planes: That it shows.
        number: Of the plane.
        around: Planes that are no object's.
    """
    own = planes.labels == number
    rows, cols = cropped(own, margin=BESIDE)
    own, labels = own[rows, cols], planes.labels[rows, cols]
    square = np.ones((2 * BESIDE + 1,) * 2, np.uint8)
    beside = cv2.dilate(own.view(np.uint8), square).view(bool) & ~own
    beside &= view.valid[rows, cols] & ~np.isin(labels, around)
    place = np.flatnonzero(beside)
    x, y, linear, sigma, depth = (
        np.asarray(part[rows, cols], float).ravel()[place]
        for part in (view.x, view.y, view.linear, view.sigma, view.depth)
    )
    slope_x, slope_y, value = planes.planes[number - 1]
    # In meters: of an inverse depth they are its own times the squared depth.
    meters = depth**2 if view.is_central else -1.0
    rises = (linear - (slope_x * x + slope_y * y + value)) * meters
    in_front = rises > IN_FRONT * planes.noise * sigma
    in_front &= rises < STEEPEST * BESIDE * view.width(depth)
    return bool(np.count_nonzero(in_front) >= LEAST_IN_FRONT)


@fitted_near
def fit_or_failure(request: FitRequest) -> Fit:
    """As `fit_shown`, or a failed fit where there are too few readings."""
    try:
        return fit_shown(request)
    except TooFewReadingsError as error:
        return failure_of(request, error)


def failure_of(request: FitRequest, error: ReadingsError) -> Fit:
    """The failed fit of readings that cannot be fitted."""
    regions = []
    with working_precision(request.options.effort.precision, ()):
        for view in request.views:
            region = checked_mask(view.mask, view.camera)
            if region is None:
                region = np.zeros((view.camera.height, view.camera.width), bool)
            regions.append(np.asarray(region))
        failed = no_guess(request.kind, *regions)
    if request.depth is None:
        failed = failed.having(source="outline")
    return failed.noting(doubt=f"{error}.")
