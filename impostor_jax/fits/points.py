"""Fit a cylinder to points, of which each was seen from a place.

A point is the reading of a ray, from where the sensor stood through the point, and is
compared along it, as a pixel's is: sensors err along the ray, and the orthogonal
distance of points is biased. What only an image shows is left out: background beside an
end, outlines, and errors that neighbors share.
"""

__all__ = [
    "fit_cylinder_to_points",
    "fit_merged",
    "fit_points",
    "in_one_frame",
    "prepare_points",
]

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from impostor_jax.arguments import is_concrete, users_level, working_precision
from impostor_jax.camera.ray_table import RayTable, turned_to
from impostor_jax.clouds.wall import Wall, apart, wall_of, walls_of
from impostor_jax.device import on_processor
from impostor_jax.effort import MIN_READINGS, Effort, effort_of
from impostor_jax.fit.filtered import FEWEST, LESS, OVERSTATED
from impostor_jax.fit.fittable import CYLINDER, no_guess
from impostor_jax.fit.learned import CLEARLY, likelier
from impostor_jax.fit.measured import NOT_MEASURED
from impostor_jax.fit.options import Errors, MaskMeaning, Options, Scale
from impostor_jax.fit.regions import BUCKETS, DepthUnitsWarning, places_for
from impostor_jax.fit.request import USUAL_SIGMA, FitRequest, check_types
from impostor_jax.fit.result import Fit
from impostor_jax.fit.shapes import fit_shape, prepare_fit
from impostor_jax.fit.status import FitStatus
from impostor_jax.fits.among import surest_among
from impostor_jax.fits.facing import tested_by_facing
from impostor_jax.fits.given_points import (
    GivenPoints,
    check_options,
    level_of,
    number_of,
    points_given,
    single_noise,
)
from impostor_jax.fits.limb import rays_clear_of_limb
from impostor_jax.fits.rough import (
    DISAGREE,
    with_errors_of_places,
    with_shared_errors,
)
from impostor_jax.fits.viewless import Viewless, seen_across
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.numerics import eps
from impostor_jax.opencv import cv2
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.local_world import LocalWorld

WIDEST = 55.0
"""Angle in degrees, from the middle of all rays, up to which one frame holds them;
beyond, they are those of the six faces of a cube."""

MOST_LEVELS = 3
"""Fits with another level of noise than the first."""

SAME_LEVEL = 0.1
"""Change of that level, over itself, with which it is known."""

FAILED = (
    FitStatus.NO_FIRST_GUESS,
    FitStatus.POOR_FIT,
    FitStatus.STEP_LIMIT,
    FitStatus.NOT_FINITE,
)
"""Statuses after which most points may be of something else, among which a cylinder is
looked for. So may be those that face away from their origin."""

FEW, ALMOST_ALL = 500, 0.9
"""Points up to which a fit near which so many of them lie tells their noise, though it
is refused: of so few a wall may tell a tenth of it."""

MOST = 0.98
"""Part of the points that is on the wall where none are of something else."""

MOST_SCATTERED = 1.5
"""Chi-squared from which a wall may be one that lies among those of two objects."""

UNLIKE_TOLD, UNLIKE_MEASURED = 2.0, 4.0
"""Chi-squared, or its inverse, of one of two walls over that of the other, from which
the noise that was told excludes it; and the same of residuals where none was."""

MOST_ROUNDED = 0.1
"""Part of the noise that the rounding of coordinates may be."""

COARSEST_LEVEL = 0.3
"""Noise in meters that no scanner has, from which points look as if in other units."""

MOST_OF_MEASURED = 4.0
"""Chi-squared that noise leaves which was measured in the same points, at most: of a
wall by chance among points of something else it was 8, of right ones up to 1.5."""

MIXED = (
    "some readings beside the limb are mixed with what is behind it: rays that pass it "
    "closely are left out"
)
"""What a reader is told of them."""

COARSEST = 0.1
"""Noise over the extent of the points, at most, where nobody tells it."""


@on_processor
def fit_cylinder_to_points(
    points: Any,
    origin: Any = None,
    sigma: Any = None,
    initial: Cylinder | None = None,
    *,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: MaskMeaning = "region",
    scale: Scale = "estimated",
    errors: Errors | None = None,
    effort: Effort | str = "balanced",
) -> Fit:
    """Fit a capped cylinder to points, as `fit_cylinder` does to the pixels of images.

        cloud = ij.io.read_points("scan.laz")
        stem = cloud.points[is_stem]
        fit = ij.fit_cylinder_to_points(stem, (0.0, 0.0, 1.7), sigma=0.004)

    The points are those of the object, in any order, outliers among them. An end is
    seen where points lie on its cap; otherwise the height is the visible extent. Where
    most points are of something else, up to two thirds, the cylinder is looked for
    among them as `find_cylinders_in_points` does, and fitted if it is sure.

    Args:
        points: (N, 3), in meters, in the world frame; or (N, 6), each with the place
            from which the sensor saw it.
        origin: (3,), that place where it is one for all, or (N, 3). Where it is wrong,
            points of the wall face away from it: the fit is `CONTRADICTED`, and
            `reason` says which share of them. If None, of points (N, 3) as of clouds
            that were merged, rays from the side that most of them face stand for it,
            and what they err by across these is learned; what lies off the wall near
            which half of them lie, as caps and branches, is left out, and they may
            surround it.
        sigma: Standard deviation of a range in meters, or a noise model of single
            readings, as in `fit_cylinder`. What they err by across their rays is
            learned unless the model says it. If None, it is measured: how far points
            scatter about a round wall.
        initial: Start of the fit, in the world frame; found from the points if None.
        fixed: Names of parameters that keep their value in `initial`, as in
            `fit_cylinder`; none by default.
        prior: Expected value and standard deviation of parameters by name, in meters
            and radians, as in `fit_cylinder`; none by default.
        mask_meaning: "region": points have no outline.
        scale: "estimated" by default, or "fixed", as in `fit_cylinder`.
        errors: "independent", or None, which says the same: points have no neighbors.
        effort: "fast", "balanced" (the default), "exact" or an `Effort`.

    Returns:
        The fit; `residual`, `inliers` and `region` have the shape (N,). `source` is
        "points".

    Raises:
        ValueError: An argument has a wrong shape or value, or there are fewer than 50
            points, or they came in single precision, and so far from the origin of
            the world that it rounds their coordinates by a tenth of what they extend
            over: give them in double precision, or subtract an offset before. What less
            rounding adds to their noise is counted.
    """
    asked = Options(fixed, prior, mask_meaning, scale, errors, effort_of(effort))
    check_options(asked)
    if not is_concrete((points, origin, sigma, initial)):
        raise ValueError(
            "points, origin, sigma and initial must be concrete, got traced ones"
        )
    given = points_given(points, origin)
    fit = fit_points(given, sigma, initial, asked)
    if initial is not None:
        return fit
    is_refuted = fit.status is FitStatus.CONTRADICTED and not asked.prior
    # Of a pole with a sign neither tells what both are of.
    is_failed = is_refuted or fit.status in (*FAILED, FitStatus.UNDETERMINED)
    is_mixed = fit.is_shape and _is_mixed(fit, len(given.ends))
    if given.starts is not None and (is_failed or is_mixed):
        # Rings and wires show no surface to a guess, but a wall to its distances; and
        # what lies beside a wall moves it, unless it is left out.
        for wall in _known_walls(given):
            seen = seen_across(given.ends, wall)
            near = fit_points(_near_ones(given, seen), sigma, seen.start, asked, wall)
            if is_failed and near.is_shape:
                return near
            # Few of them make the wall no likelier, and move it by nine deviations.
            if likelier(fit, near, -CLEARLY, by_chance=False) is near:
                return near
    if is_failed:
        found = surest_among(given, level_of(sigma, given))
        if found is not None:
            support, own = found
            cloud = given._replace(counts=own)
            return fit_points(cloud, sigma, support.start, asked, support.wall)
    return fit


def _is_mixed(fit: Fit, count: int) -> bool:
    """Whether points seem to be of more than a wall, or of a wall and its caps."""
    return bool(fit.num_inliers < MOST * count or fit.chi2.item() > MOST_SCATTERED)


def _near_ones(cloud: GivenPoints, seen: Viewless) -> GivenPoints:
    """The same, of which those near a wall count; all where these are too few."""
    counts = cloud.counts & seen.is_near
    is_enough = np.count_nonzero(counts) >= MIN_READINGS
    return cloud._replace(counts=counts) if is_enough else cloud


def fit_points(
    cloud: GivenPoints,
    sigma: Any,
    initial: Cylinder | None,
    asked: Options,
    wall: Wall | None = None,
) -> Fit:
    """The same of points that are checked.

    Args:
        cloud: The points.
        sigma: As of `fit_cylinder_to_points`, like the next two.
        initial: Start of the fit.
        asked: The options.
        wall: Near which they lie; looked for where it is needed if None.
    """
    if cloud.starts is None:
        return _fit_viewless(cloud, sigma, initial, asked, wall)

    def fitted(cloud: GivenPoints, start: Cylinder | None) -> Fit:
        if sigma is None:
            return _fit_with_level(cloud, start, asked, wall)
        return _fit_told(cloud, sigma, start, asked)

    fit = fitted(cloud, initial)
    fit = _clear_of_limb(fit, cloud, cloud.starts, asked, fitted)
    starts = cloud.starts[cloud.counts]
    if fit.status in FAILED and np.any(starts != starts[:1]):
        # Rays that miss a wall by a millimeter, as those of scans do that are aligned
        # so well, contradict it; its distances from the points do not.
        merged = fit_merged(cloud, sigma, initial, asked, wall)
        if merged.is_shape and merged.asked.doubt.startswith(DISAGREE):
            return merged
    return _held_against_places(fit, cloud)


def fit_merged(cloud: GivenPoints, *asked: Any) -> Fit:
    """The same without a viewpoint, of points that were seen from several places.

    Args:
        cloud: The points, with these places.
        asked: All else that `fit_points` takes.
    """
    fit = fit_points(cloud._replace(starts=None), *asked)
    return _held_against_places(fit, cloud)


def _held_against_places(fit: Fit, cloud: GivenPoints) -> Fit:
    """A fit, or what the places that its points were seen from make of it."""
    assert cloud.starts is not None
    ends, starts = cloud.ends[cloud.counts], cloud.starts[cloud.counts]
    return with_errors_of_places(tested_by_facing(fit, ends, starts), ends, starts)


def _clear_of_limb(
    fit: Fit,
    cloud: GivenPoints,
    starts: Float[np.ndarray, "n 3"],
    asked: Options,
    fitted: Callable[[GivenPoints, Cylinder], Fit],
) -> Fit:
    """The fit, or one without rays beside the limb where readings are mixed there.

    Args:
        fit: Of the points that count.
        cloud: The points.
        starts: Where the ray to each begins, outside of the wall.
        asked: The options.
        fitted: Fits others from a start.
    """
    if not fit.is_shape or not asked.effort.doubts:
        return fit
    clear = rays_clear_of_limb(fit.cylinder, cloud.ends, starts)
    if clear is None:
        return fit
    rest = cloud._replace(counts=cloud.counts & clear)
    again = fitted(rest, fit.cylinder)
    return again.noting(doubt=again.asked.doubt or MIXED) if again.is_shape else fit


def _fit_cloud(
    cloud: GivenPoints, sigma: Any, initial: Cylinder | None, asked: Options
) -> Fit:
    """Fit points of which it is known from where they were seen."""
    ends, starts, _, rounding, counts = cloud
    assert starts is not None
    with working_precision(asked.effort.precision, ()):
        views = _views_of(ends, starts)
        _check_stored(cloud)
        dtype, largest = _working_type(views), _largest(cloud)
        reach = np.median(np.linalg.norm(ends - starts, axis=1))
        noise, one = single_noise(sigma), jnp.ones((), jnp.result_type(float))
        _check_rounding(dtype, largest, reach, float(noise.sigma(reach * one, one)))
    for view in views:
        check_types(Cylinder, view.camera, initial)
        view.mask[0, : len(view.places)] &= counts[view.places]
    depths, cameras, masks, places = map(list, zip(*views, strict=True))
    if len(views) == 1:
        depths, cameras, masks = depths[0], cameras[0], masks[0]
    request = FitRequest(CYLINDER, depths, cameras, masks, sigma, initial, asked)
    return fit_shape(request, places=places, rounding=rounding)


def prepare_points(cloud: GivenPoints, sigma: Any, asked: Options) -> None:
    """Load or compile what `fit_points` takes from a start for `BUCKETS[0]` points.

    Args:
        cloud: The points, among which objects will be found.
        sigma: As of `fit_points`.
        asked: The options.
    """
    ends = cloud.ends - cloud.ends[0]
    extent = max(float(np.abs(ends).max()), eps(np.float32))
    if cloud.starts is None:
        # Parallel rays, which begin apart, stand for those that nobody tells of.
        starts = ends - (0.0, 0.0, extent)
    else:
        starts = cloud.starts - cloud.ends[0]
    unit = _directions(ends, starts)
    some = np.flatnonzero(unit @ unit[0] > np.cos(np.radians(WIDEST)))[:MIN_READINGS]
    level = extent if sigma is None else single_noise(sigma)
    with working_precision(asked.effort.precision, ()):
        view = _view_of(ends, starts, some, turned_to(unit[0]), BUCKETS[0])
    given = view.depth, view.camera, view.mask, level
    prepare_fit(FitRequest(CYLINDER, *given, None, asked), cloud.rounding)


def _fit_viewless(
    cloud: GivenPoints,
    sigma: Any,
    initial: Cylinder | None,
    asked: Options,
    wall: Wall | None,
) -> Fit:
    """The same where nobody tells from where they were seen."""
    _check_stored(cloud)
    walls = [wall] if wall else _known_walls(cloud)
    if not walls:
        nothing = no_guess(CYLINDER, np.ones(len(cloud.ends), bool))
        return nothing.having(source="points")
    if len(walls) == 1 or not walls[0].is_split(cloud.ends):
        return _fit_to_wall(cloud, sigma, initial, asked, walls[0])
    fits = [_fit_to_wall(cloud, sigma, initial, asked, one) for one in walls]
    shapes = [k for k, fit in enumerate(fits) if fit.is_shape]
    if len(shapes) < 2:
        return fits[shapes[0] if shapes else 0]
    is_split = [walls[k].is_split(cloud.ends) for k in shapes]
    return _likeliest([fits[k] for k in shapes], is_split, sigma is not None)


def _known_walls(cloud: GivenPoints) -> list[Wall]:
    """The walls near which points lie that these tell, the nearest first."""
    return [wall for wall in walls_of(cloud.ends) if wall.is_known]


def _fit_to_wall(
    cloud: GivenPoints,
    sigma: Any,
    initial: Cylinder | None,
    asked: Options,
    wall: Wall,
) -> Fit:
    """The same near one wall."""
    seen = seen_across(cloud.ends, wall)
    near = _near_ones(cloud, seen)._replace(starts=seen.starts)

    def fitted(cloud: GivenPoints, start: Cylinder) -> Fit:
        if sigma is None:
            return _fit_from_level(cloud, wall.scatter, start, asked)
        return _fit_told(cloud, number_of(sigma), start, asked)

    fit = fitted(near, seen.start if initial is None else initial)
    # Of rays that begin outside, all of them.
    ahead = cloud.ends - 2 * _extent(cloud) * seen.toward
    return _clear_of_limb(fit, near, ahead, asked, fitted)


def _likeliest(fits: Sequence[Fit], is_split: Sequence[bool], is_told: bool) -> Fit:
    """Of fits near different walls the likeliest; ambiguous if another is as likely.

    Two rings of a pipe lie near a wall across it, too, which touches their planes, and
    may be nearer to that. Its residuals along rays are not those of the noise that was
    told; where nobody told it, they may be larger than those of the pipe.

    Args:
        fits: Two or more that succeeded.
        is_split: Whether points lie on parts of the wall of each that are apart.
        is_told: Whether the noise was told, and not measured by each.
    """
    of_fits = [(fit.chi2 if is_told else fit.rms).item() for fit in fits]
    off = np.log(np.maximum(of_fits, np.finfo(np.float32).tiny))
    off = np.abs(off) if is_told else off
    order = np.argsort(off)
    # Two walls may have led to one.
    axes = np.array([fits[k].cylinder.axis for k in order], float)
    best, *others = order[apart(axes)]
    if not others:
        return fits[best]
    other = others[0]
    least = np.log(UNLIKE_TOLD if is_told else UNLIKE_MEASURED)
    if off[other] - off[best] > least and (is_told or not is_split[best]):
        return fits[best]
    wall = fits[other].cylinder
    axis = ", ".join(f"{part:.3f}" for part in np.asarray(wall.axis))
    doubt = (
        f"so does one of radius {float(wall.radius):.4g} m with the axis ({axis}): an "
        "origin tells them apart"
    )
    return fits[best].failed(FitStatus.AMBIGUOUS).noting(doubt=doubt)


def _fit_with_level(
    cloud: GivenPoints,
    initial: Cylinder | None,
    asked: Options,
    wall: Wall | None,
) -> Fit:
    """The same where nobody tells how large the noise is."""
    wall = wall or wall_of(cloud.ends)
    if wall is not None and wall.is_known:
        return _fit_from_level(cloud, wall.scatter, initial, asked)
    fit = _fit_cloud(cloud, None, initial, asked).noting(measured=NOT_MEASURED)
    if fit.is_shape or not _is_of_few(fit, cloud):
        return fit
    level = USUAL_SIGMA * fit.chi2.item() ** 0.5
    return _fit_from_level(cloud, level, initial, asked)


def _fit_told(
    cloud: GivenPoints, sigma: Any, initial: Cylinder | None, asked: Options
) -> Fit:
    """The same with a noise that was told, unless the points show less of it."""
    fit = _fit_cloud(cloud, sigma, initial, asked)
    if not fit.is_shape or asked.scale == "fixed" or not asked.effort.doubts:
        return fit
    level, chi2 = level_of(sigma, cloud), fit.chi2.item()
    assert level is not None
    if chi2 < OVERSTATED and fit.num_inliers >= FEWEST:
        measured = _fit_from_level(cloud, level * chi2**0.5, initial, asked)
        if measured.is_shape:
            told = LESS.format(times=chi2**0.5) + measured.asked.measured
            return measured.noting(measured=told)
    return with_shared_errors(fit, cloud.ends, level * max(chi2, 1.0) ** 0.5)


def _fit_from_level(
    cloud: GivenPoints, level: float, initial: Cylinder | None, asked: Options
) -> Fit:
    """The same from a noise that may be another, until a fit tells it."""
    least, most = _resolution(cloud, asked), COARSEST * _extent(cloud)
    level = max(level, least)
    fit = _fit_cloud(cloud, level, initial, asked)
    for _ in range(MOST_LEVELS):
        scale = fit.across.scale.item()
        if not fit.is_shape:
            if not _is_of_few(fit, cloud):
                break
            # Half of a few rings may lie near a wall that is not theirs.
            scale = max(scale, min(fit.chi2.item() ** 0.5, most / level))
        wanted = max(level * scale, least)
        if abs(wanted / level - 1) < SAME_LEVEL:
            break
        level = wanted
        fit = _fit_cloud(cloud, level, initial, asked)
    if fit.is_shape and fit.chi2.item() > MOST_OF_MEASURED:
        fit = fit.failed(FitStatus.POOR_FIT)
    return _with_told_level(fit, cloud, level)


def _extent(cloud: GivenPoints) -> float:
    """Diagonal of the box about all points, in meters."""
    return float(np.linalg.norm(np.ptp(cloud.ends, axis=0)))


def _is_of_few(fit: Fit, cloud: GivenPoints) -> bool:
    """Whether a fit is refused for what a few points scatter about it."""
    count = np.count_nonzero(cloud.counts)
    is_near = fit.num_inliers >= ALMOST_ALL * count
    is_refused = fit.status in (FitStatus.POOR_FIT, FitStatus.STEP_LIMIT)
    return bool(is_refused and count <= FEW and is_near)


def _with_told_level(fit: Fit, cloud: GivenPoints, level: float) -> Fit:
    """A fit whose noise was measured, that says so."""
    if fit.success and level > COARSEST_LEVEL:
        doubt = (
            f"points must be in meters, and their noise was measured as {level:.2g}: "
            "are they in millimeters?"
        )
        warnings.warn(doubt, DepthUnitsWarning, stacklevel=users_level())
        fit = fit.noting(doubt=doubt)
    told = f"Measured in the points: noise of {1e3 * level:.3g} mm."
    return with_shared_errors(fit, cloud.ends, level).noting(measured=told)


def _resolution(cloud: GivenPoints, asked: Options) -> float:
    """Least noise that numbers let a fit tell, in meters, where nobody tells it.

    What rounds a distance between points in single precision, or the coordinates, is
    too little of it to be looked at.
    """
    around = np.abs(cloud.ends - np.median(cloud.ends, axis=0)).max()
    assert cloud.starts is not None
    with working_precision(asked.effort.precision, ()):
        dtype = _working_type(_views_of(cloud.ends, cloud.starts))
    least = max(around * eps(np.float32, 16), _largest(cloud) * eps(dtype, 16))
    return float(max(least, cloud.rounding))


def _largest(cloud: GivenPoints) -> float:
    """Of all coordinates, in meters."""
    assert cloud.starts is not None
    return float(max(np.abs(cloud.ends).max(), np.abs(cloud.starts).max()))


def _working_type(views: Sequence["_View"]) -> np.dtype:
    """That rounds coordinates in a fit to views of points."""
    # From a frame that lies far off, they are told in double precision.
    is_far = LocalWorld.of(view.camera for view in views) is not None
    return np.dtype(np.float64 if is_far else jnp.result_type(float))


class _View(NamedTuple):
    """Points whose rays one frame holds, as an image of one row.

    Attributes:
        depth: In the camera's frame; 0 where it only fills up.
        camera: Their rays.
        mask: Where there is a point.
        places: Which points they are.
    """

    depth: Float[np.ndarray, "1 w"]
    camera: RayTable
    mask: np.ndarray
    places: Int[np.ndarray, " n"]


def _check_stored(cloud: GivenPoints) -> None:
    """Raise where points were rounded by as much as they are apart."""
    step = float(np.abs(cloud.ends).max()) * eps(cloud.dtype)
    if step > COARSEST * _extent(cloud) > 0:
        raise ValueError(
            f"points must be told to a part of what they are of, got coordinates up to "
            f"{np.abs(cloud.ends).max():.6g} m, which {cloud.dtype} rounds by "
            f"{step:.2g} m: subtract an offset before they are rounded, or give them "
            "in double precision"
        )


def _check_rounding(
    dtype: np.dtype, largest: float, reach: float, sigma: float
) -> None:
    """Raise where coordinates, rounded, would err as much as the sensor.

    Args:
        dtype: That rounds them.
        largest: Of them, in meters.
        reach: From where the points were seen, or across all of them, in meters.
        sigma: Of the sensor.
    """
    if largest * eps(dtype) > max(MOST_ROUNDED * sigma, eps(dtype, 16) * reach):
        raise ValueError(
            f"points must lie near the origin of the world, got coordinates up to "
            f"{largest:.6g} m, which {dtype} rounds by {largest * eps(dtype):.2g} m: "
            "subtract an offset, or give them, and compute, in double precision "
            "(effort's precision 'float64')"
        )


def in_one_frame(
    ends: Float[np.ndarray, "n 3"], starts: Float[np.ndarray, "n 3"]
) -> bool:
    """Whether all rays are near enough to their mean for one frame to hold them."""
    unit = _directions(ends, starts)
    rotation = turned_to(unit.mean(axis=0))
    return bool(np.all(unit @ rotation[2] > np.cos(np.radians(WIDEST))))


def _directions(
    ends: Float[np.ndarray, "n 3"], starts: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    rays = ends - starts
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _views_of(
    ends: Float[np.ndarray, "n 3"], starts: Float[np.ndarray, "n 3"]
) -> list[_View]:
    """The rays in frames that look along them: one, or those of a cube's faces.

    Of these six views of one form, some of which may be empty: a program serves all,
    and no arrangement of scanners is compiled anew.
    """
    unit = _directions(ends, starts)
    rotation = turned_to(unit.mean(axis=0))
    if in_one_frame(ends, starts):
        every = np.arange(len(ends))
        return [_view_of(ends, starts, every, rotation, places_for(len(ends)))]
    around = unit @ rotation.T
    largest = np.argmax(np.abs(around), axis=1)
    negative = np.take_along_axis(around, largest[:, None], axis=1)[:, 0] < 0
    face = 2 * largest + negative
    width = places_for(int(np.bincount(face).max()))
    views = []
    for number in range(6):
        axis = rotation[number // 2] * (-1 if number % 2 else 1)
        places = np.flatnonzero(face == number)
        to_face = turned_to(axis), width, True
        if len(places):
            views.append(_view_of(ends, starts, places, *to_face))
            continue
        ahead = starts[:1] + axis
        view = _view_of(ahead, starts[:1], np.arange(1), *to_face)
        blank, no = np.zeros_like(view.depth), np.zeros_like(view.mask)
        views.append(view._replace(depth=blank, mask=no, places=places))
    return views


def _view_of(
    ends: Float[np.ndarray, "n 3"],
    starts: Float[np.ndarray, "n 3"],
    places: Int[np.ndarray, " m"],
    rotation: Float[np.ndarray, "3 3"],
    width: int,
    is_moving: bool = False,
) -> _View:
    """Some of the rays, filled up to a width; told by where each begins if moving."""
    ends, starts = ends[places], starts[places]
    origin = _origin(ends, starts, rotation[2])
    count = len(places)
    rays, begin = np.zeros((1, width, 3)), np.zeros((1, width, 3))
    rays[0, :count], begin[0, :count] = ends - starts, starts - origin
    flat = (ends - origin) @ rotation.T
    flat = flat[:, :2] / flat[:, 2:]
    hull = cv2.convexHull(flat.astype(np.float32))
    spacing = np.sqrt(max(cv2.contourArea(hull), 1e-12) / count)
    camera = RayTable.facing(
        rays,
        rotation,
        float(spacing),
        RigidTransform(np.eye(3), origin),
        begin if is_moving or np.any(begin) else None,
        is_image=False,
    )
    depth = (rays @ rotation.T)[..., 2].astype(camera.x.dtype)
    return _View(depth, camera, (np.arange(width) < count)[None], places)


def _origin(
    ends: Float[np.ndarray, "n 3"],
    starts: Float[np.ndarray, "n 3"],
    axis: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "3"]:
    """Place from which all points lie ahead: the sensor's, if it did not move."""
    if np.all(starts == starts[0]):
        return starts[0]
    origin = starts.mean(axis=0)
    ahead = (ends - origin) @ axis
    least = np.median(np.linalg.norm(ends - starts, axis=1)) / 2
    return origin - axis * max(0.0, least - float(ahead.min()))
