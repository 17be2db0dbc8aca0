"""Find every cylinder in a cloud of points."""

__all__ = ["Detection", "find_cylinders_in_points", "search_cloud"]

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from impostor_jax.arguments import is_concrete, real_number, whole_number
from impostor_jax.clouds.cloud import MOST_POINTS, Cloud, cloud_of
from impostor_jax.clouds.confidence import confidence, facts_of
from impostor_jax.clouds.planes import Planes, planes_of
from impostor_jax.clouds.search import (
    Candidate,
    Request,
    belonging,
    continues,
    searched,
)
from impostor_jax.clouds.support import Support
from impostor_jax.device import on_processor
from impostor_jax.effort import MIN_READINGS, Effort, effort_of
from impostor_jax.find.cylinders import checked_radii
from impostor_jax.find.found import FoundInPoints
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.options import Options
from impostor_jax.fit.request import checked_prior
from impostor_jax.fit.result import Fit
from impostor_jax.fit.threads import in_background
from impostor_jax.fits.given_points import (
    GivenPoints,
    as_numbers,
    level_of,
    number_of,
    points_given,
)
from impostor_jax.fits.points import (
    fit_merged,
    fit_points,
    in_one_frame,
    prepare_points,
)
from impostor_jax.primitives.plane import Plane

MOST_LEVELS = 4
"""Of voxels, each smaller than the last."""

LARGE = 20_000
"""Points from which planes and proposals take as long as programs take to compile."""

MOST_UNRESOLVED = 6.0
"""Largest radius, in spacings of a cloud, that is looked for by smaller voxels, too."""

LEAST_CHANCE = 0.2
"""Of the confidence that is asked for: that before a fit, of what is fitted."""

MOST_MOVED = 0.3
"""Change of the radius by a fit, over itself, up to which it is of the same wall."""


@on_processor
def find_cylinders_in_points(
    points: Any,
    origin: Any = None,
    sigma: Any = None,
    *,
    normals: Any = None,
    min_points: int = Request.min_points,
    min_arc: float = Request.min_arc,
    radius_range: tuple[float, float] = Request.radius_range,
    prior: Mapping[str, Any] | None = None,
    effort: Effort | str = "balanced",
) -> FoundInPoints:
    """Find every cylinder in a cloud of points: pipes, stems, cans.

        cloud = ij.io.read_points("plot.laz")
        found = ij.find_cylinders_in_points(cloud.points, cloud.origin)
        print(found)
        stem = cloud.points[found.labels == 1]

    Planes are taken away; walls are proposed from patches of the rest, grown along
    their axes, and fitted as `fit_cylinder_to_points` does. Of a stem that tapers or
    bends the piece is found that a cylinder explains, and its other pieces are not
    found beside it. Points within a wall, and rays through it, speak against it. Lines
    of a scan, as the rings of a lidar, must lie closer than half a radius: neighbors of
    one line tell no normal. A fit to points that are known to be of a wall needs none.

    Args:
        points: (N, 3), in meters, in the world frame, in any order; or (N, 6), each
            with the place from which the sensor saw it. Of more than 200 000 one of
            each voxel is searched, and the fits take all.
        origin: As in `fit_cylinder_to_points`; (N, 3) where each point has its own. If
            None, as of merged scans, nobody knows what rays go through.
        sigma: Standard deviation of a range in meters, or a noise model of single
            readings; measured at each wall if None.
        normals: (N, 3), at the points, of either sign and any length; found from their
            neighbors if None, and where one is 0 or NaN.
        min_points: Fewest points of a cylinder, of those that are searched; 60 by
            default.
        min_arc: Smallest angle about its axis over which it is seen, in radians; 0.6 by
            default.
        radius_range: Smallest and largest radius, in meters; 3 mm to 1 m by default.
        prior: As of `fit_cylinder`. A radius is looked for within four standard
            deviations.
        effort: How much work the fits take, as of `fit_cylinder`.

    Returns:
        What was found, the surest first; the same for the same cloud. Nothing that is
        less likely than not.

    Raises:
        ValueError: An argument has a wrong shape or value, or is traced.
    """
    if not is_concrete((points, origin, sigma, normals, prior)):
        raise ValueError("points, origin, sigma, normals and prior must be concrete, "
                         "got traced ones: a search runs outside JAX")  # fmt: skip
    options = Options(prior=prior, effort=effort_of(effort))
    checked_prior(prior, CYLINDER.parameters, None)
    given = points_given(points, origin)
    if sigma is not None and given.starts is None:
        number_of(sigma)
    request = Request(
        min_points=whole_number("min_points", min_points, 1),
        min_arc=real_number("min_arc", min_arc, positive=True, unit="radians"),
        radius_range=checked_radii(radius_range, prior),
        sigma=level_of(sigma, given),
    )
    turned = None if normals is None else _checked_normals(normals, given)
    detections, cloud, planes = search_cloud(given, request, sigma, options, turned)
    labels = np.zeros(len(given.ends), np.int32)
    for number, one in enumerate(detections, start=1):
        labels[one.own] = number
    return FoundInPoints(
        fits=tuple(one.fit for one in detections),
        labels=labels,
        visible=np.array([one.candidate.support.visible for one in detections]),
        confidence=np.array([one.confidence for one in detections]),
        inside=np.array([one.candidate.support.is_inside for one in detections], bool),
        planes=_planes(cloud, planes),
        num_searched=len(cloud),
        on_lines=cloud.on_lines,
    )


def search_cloud(
    given: GivenPoints,
    request: Request,
    sigma: Any = None,
    options: Options | None = None,
    normals: Float[np.ndarray, "n 3"] | None = None,
) -> tuple[list["Detection"], Cloud, Planes]:
    """What is found in a cloud, the surest first, what was searched, and its planes.

    What is small beside the voxels of a large cloud is looked for in what is left of
    it, without planes, what was found, and what is flat, by smaller voxels.

    Args:
        given: The points.
        request: What is looked for.
        sigma: As of `find_cylinders_in_points`, checked, like the others.
        options: Of the fits.
        normals: At the points.
    """
    options = options or Options()
    if len(given.ends) >= LARGE:
        in_background(lambda: prepare_points(given, sigma, options))
    which = np.arange(len(given.ends))
    levels: list[tuple[Cloud, Planes]] = []
    found: list[Detection] = []
    pieces: list[Support] = []
    low, high = request.radius_range
    while True:
        own = (
            None if values is None else values[which]
            for values in (given.ends, given.starts, normals)
        )
        cloud = cloud_of(*own, MOST_POINTS)
        planes = planes_of(cloud)
        levels.append((cloud, planes))
        free = planes.label == 0
        fits = _Fits(given, cloud, which, request, sigma, options)
        asked = dataclasses.replace(request, radius_range=(low, high))
        # What is refused may be several smaller ones, which smaller voxels show.
        refused: list[Support] = []
        for candidate in searched(cloud, planes, asked):
            support = candidate.support.moved(cloud.middle)
            if any(continues(piece, support) for piece in pieces):
                free[candidate.own] = False
                continue
            if any(continues(one, support) for one in refused):
                continue
            one = fits.detection(candidate, support)
            if one is None:
                refused.append(support)
                continue
            found.append(one)
            pieces.append(support)
            free[candidate.own] = False
        high = min(high, MOST_UNRESOLVED * cloud.spacing)
        if len(cloud) == len(which) or len(levels) == MOST_LEVELS or high <= low:
            break
        which = which[(free & ~cloud.is_flat)[cloud.representative]]
        if len(which) < MIN_READINGS:
            break
    found.sort(key=lambda one: -one.confidence)
    return found, *levels[0]


class Detection(NamedTuple):
    """A cylinder that was found in a cloud.

    Attributes:
        fit: Of it.
        candidate: What it was before.
        own: Points of the caller's that are of it.
        facts: Those that its confidence is made of.
        confidence: Probability that it is there.
    """

    fit: Fit
    candidate: Candidate
    own: Int[np.ndarray, " k"]
    facts: Float[np.ndarray, " f"]
    confidence: float


@dataclasses.dataclass(frozen=True)
class _Fits:
    """Fits of what a search proposes.

    Attributes:
        given: The caller's points.
        cloud: Those that are searched.
        which: Of the caller's points, those that the cloud was made of.
        request: What is looked for.
        sigma: What the caller says of the noise.
        options: Of the fits.
    """

    given: GivenPoints
    cloud: Cloud
    which: Int[np.ndarray, " m"]
    request: Request
    sigma: Any
    options: Options

    def detection(self, candidate: Candidate, placed: Support) -> Detection | None:
        """What is found where a candidate is; None where nothing is.

        Args:
            candidate: In the cloud's frame.
            placed: Its support in the caller's.
        """
        support = candidate.support
        chance = confidence(facts_of(self.cloud, support))
        if chance < LEAST_CHANCE * self.request.least_sure:
            return None
        own = self._points_of(candidate)
        if len(own) < MIN_READINGS:
            return None
        wall, start = placed.wall, placed.start
        ends, starts, dtype, rounding, _ = self.given
        counts = np.ones(len(own), bool)
        starts = None if starts is None else starts[own]
        points = GivenPoints(ends[own], starts, dtype, rounding, counts)
        how = start, self.options, wall
        if starts is None or in_one_frame(ends[own], starts):
            fit = fit_points(points, self.sigma, *how)
        else:
            # Each number of frames would be compiled for itself; a fit without a
            # viewpoint needs one.
            fit = fit_merged(points, self.request.sigma, *how)
        radius = float(fit.cylinder.radius)
        if not bool(fit.success) or abs(radius / wall.radius - 1) > MOST_MOVED:
            return None
        facts = facts_of(self.cloud, support, fit)
        sure = confidence(facts)
        if sure < self.request.least_sure:
            return None
        return Detection(fit, candidate, own, facts, sure)

    def _points_of(self, candidate: Candidate) -> Int[np.ndarray, " k"]:
        """The caller's points that are of a candidate."""
        is_near = np.zeros(len(self.cloud), bool)
        is_near[candidate.own] = True
        members = self.which[is_near[self.cloud.representative]]
        least = self.request.sigma or 0.0
        points = self.given.ends[members] - self.cloud.middle
        return members[belonging(points, candidate.support, least)]


def _checked_normals(normals: Any, given: GivenPoints) -> Float[np.ndarray, "n 3"]:
    values = as_numbers("normals", normals, may_miss=True)
    if values.shape != given.ends.shape:
        raise ValueError(
            f"normals must be {given.ends.shape}, one a point, got {values.shape}"
        )
    # What other programs could not tell is NaN or 0.
    values = np.where(np.isfinite(values).all(axis=1, keepdims=True), values, 0)
    if not np.any(values):
        raise ValueError("normals must have a direction, got none that has")
    return values


def _planes(cloud: Cloud, planes: Planes) -> Plane:
    """Planes in the world frame, towards the viewpoint where that is known."""
    normals = planes.normals.copy()
    if cloud.origins is not None:
        for k, (point, normal) in enumerate(zip(planes.points, normals, strict=True)):
            seen_from = cloud.origins[planes.label == k + 1].mean(axis=0)
            if (seen_from - point) @ normal < 0:
                normals[k] = -normal
    return Plane(planes.points + cloud.middle, normals)
