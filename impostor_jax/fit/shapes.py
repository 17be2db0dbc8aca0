"""Fit a shape to depth images: the way that is the same for all of them.

Four steps: take the object's readings, guess shapes outside JAX, go to the fixed point
of a step, and say how sure the result is. The last two are compiled functions of
arrays that come in few sizes. Most images are explained by the first guess; where one
is not, or where the caller asks for it, the others are tried, too.
"""

__all__ = ["fit_shape", "prepare_fit"]

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from impostor_jax.arguments import is_concrete, working_precision
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.effort import MIN_READINGS, Effort
from impostor_jax.fit.assess import Assessment
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.border import fit_of_one_surface, without_others
from impostor_jax.fit.camera_poses import (
    as_they_disagree,
    at_poses,
    in_cameras,
    told_of_poses,
    with_usual_poses,
)
from impostor_jax.fit.clusters import clustered_outliers
from impostor_jax.fit.copied import with_copies
from impostor_jax.fit.edges import without_edges
from impostor_jax.fit.far import fitted_near
from impostor_jax.fit.filtered import less_noise, shared_errors
from impostor_jax.fit.fittable import Fittable, no_guess
from impostor_jax.fit.gather import table_of
from impostor_jax.fit.learned import fit_with_learned_rays, with_learned_rays
from impostor_jax.fit.line_errors import line_errors
from impostor_jax.fit.measured import with_measured
from impostor_jax.fit.options import Options
from impostor_jax.fit.outline_gap import (
    compared_with_outline,
    doubted_edges,
    tested_beyond_ends,
)
from impostor_jax.fit.pixelwise import Pixelwise
from impostor_jax.fit.prior import Prior
from impostor_jax.fit.problem import DepthImage, Inputs, Mask, Settings, Table
from impostor_jax.fit.program import Program, fit_from
from impostor_jax.fit.regions import (
    chosen_pixels,
    most_readings,
    pixel_indices,
    traced_indices,
    warn_of_units,
)
from impostor_jax.fit.request import (
    FitRequest,
    Given,
    check_readings,
    check_types,
    checked_mask,
    checked_noise,
    checked_pose_sigma,
    checked_prior,
    checked_readings,
    checked_settings,
)
from impostor_jax.fit.result import Fit, each_of
from impostor_jax.fit.seam import refuted_by_seam
from impostor_jax.fit.seen import Seen, all_shown_by, seen_by, shown_by
from impostor_jax.fit.standing import standing_on
from impostor_jax.fit.starts import Search, guesses_of
from impostor_jax.fit.stated import tested_by_readings
from impostor_jax.fit.status import FitStatus
from impostor_jax.fit.weighing import best_of, likeliest
from impostor_jax.primitives.base import AbstractPrimitive, in_camera_frame
from impostor_jax.sensor.base import AbstractDepthNoise

ALL_OWN = 0.995
"""Share of a region's readings on the shape, from which on none are foreign."""

SOME, MOST = 0.25, 0.5
"""Share of an object's readings from which a reader is told that they were left out,
and from which the fit fails."""

LEFT_OUT = "% of the region's readings were left out, as of something else"
"""What a reader is told."""

EDGES_OFF = "ends are less sure, since edges beside the wall are off in the image"
"""What a reader is told."""

MOST_LOOKS, MOST_FAILED = 4, 2
"""Times that foreign readings are looked for, and that a fit without them fails: one
that a floor spoils may not tell its corner."""


@fitted_near
def fit_shape(
    request: FitRequest,
    places: Sequence[Any] | None = None,
    rounding: float | None = None,
    in_search: bool = False,
    is_trial: bool = False,
    doubted: float = 0.0,
) -> Fit:
    """Fit a shape.

    A mask must be given unless something is traced. Where the images are made of
    points, `places` are those of `Pixelwise.of_points`, and `rounding` is the standard
    deviation that their coordinates were rounded with. A step `in_search` is told the
    noise of the whole image, and where to begin. A trial that fails does not look for
    the part of a large region that is of the shape. By `doubted` pixels edges in the
    images may be off.
    """
    kind, depth, camera, _, sigma, initial, options = request
    effort, views, given = options.effort, request.views, request.values
    for view in views:
        check_types(kind.shape, view.camera, initial)
    told = ""
    if places is None and is_concrete(given):
        views, sigma, told = with_measured(views, sigma)
    with working_precision(effort.precision, given) as converted:
        settings = checked_settings(kind, options, initial, sigma)
        beliefs = checked_prior(options.prior, kind.expectable, initial)
        checked, noises = zip(*map(_checked, views), strict=True)
        cameras = [converted(view.camera) for view in checked]
        noises, start, beliefs = converted(([*noises], initial, beliefs))
        masks = [view.mask for view in checked]
        images = [view.depth for view in checked]
        if not is_concrete((images, masks, start, cameras, noises, beliefs)):
            if start is None:
                raise ValueError(
                    "initial must be given to a traced fit: the first guess runs "
                    "outside JAX"
                )
            traced = [*zip(images, masks, cameras, noises, strict=True)]
            return _fit_traced(traced, kind.body.of(start), beliefs, settings, options)
        check_readings(checked)
        seen = [
            seen_by(np.asarray(image), np.asarray(one), *by)
            for image, one, *by in zip(images, masks, cameras, noises, strict=True)
        ]
        poses = checked_pose_sigma(options.pose_sigma, len(seen))
        seen = [one._replace(pose=p) for one, p in zip(seen, poses, strict=True)]
        asks_poses = options.pose_sigma is None and places is None and len(seen) > 1
        if asks_poses:
            seen = with_usual_poses(seen)
        is_outline = options.mask_meaning == "outline"
        if is_outline and kind.closed is None:
            seen = [one.without_holes() for one in seen]
        # Noise that was measured is in the same units.
        doubts = [
            warn_of_units(
                one.image, one.region, checked_noise(None) if told else one.noise
            )
            for one in seen
        ]

        if places is None:
            seen = [with_copies(one) for one in seen]
        if doubted:
            seen = [one.with_doubted_edges(doubted) for one in seen]
        correlated = any(options.correlated(one.noise) for one in seen)

        also = effort, correlated, rounding, in_search, is_trial

        def fitted_as(asked: FitRequest) -> Fit:
            options, begin = asked.options, asked.initial
            settings = checked_settings(kind, options, begin, sigma)
            known = converted(checked_prior(options.prior, kind.expectable, begin))
            return _fit_seen(kind, seen, begin, known, settings, *also)

        fit = _fit_seen(kind, seen, start, beliefs, settings, *also)
        if asks_poses and effort.doubts:

            def at_wider(seen: Sequence[Seen]) -> Fit:
                return _fit_seen(kind, seen, start, beliefs, settings, *also)

            fit, seen = as_they_disagree(fit, seen, at_wider)
        seen = at_poses(seen, fit)
        of_poses, disagreement = told_of_poses(fit, seen, not asks_poses)

        def refitted(sigma: Any, told: str, doubted: float = doubted) -> Fit:
            again = request._replace(sigma=sigma)
            how = {"in_search": in_search, "is_trial": is_trial, "doubted": doubted}
            fit = fit_shape(again, **how)
            said = {"measured": told, "doubt": next(filter(None, doubts), "")}
            return fit.noting(**{name: text for name, text in said.items() if text})

        is_told = places is None and sigma is not None and not told
        if is_told and effort.doubts and options.errors is None:
            shown = shared_errors(fit, views, seen)
            if shown is None and options.scale == "estimated" and not in_search:
                shown = less_noise(fit, kind.body, views, seen)
            if shown is not None:
                return refitted(*shown)
        if places is None and effort.doubts and options.errors is None:
            shared = line_errors(fit, seen, told)
            if shared is not None:
                noises, of_lines = shared
                return refitted(noises if len(noises) > 1 else noises[0], of_lines)
        fit = tested_by_readings(fit, request._replace(initial=start), fitted_as)
        if places is None:
            fit = compared_with_outline(fit, seen, is_outline)
            if not (is_outline or doubted) and effort.doubts:
                doubted = doubted_edges(fit, seen)
                if doubted:
                    return refitted(sigma, told, doubted)
            if is_outline and effort.doubts:
                fit = tested_beyond_ends(fit, seen)
        if effort.doubts:
            fit = refuted_by_seam(fit, seen)
        if fit.pose_errors is not None:
            given_by = [view.camera for view in checked]
            fit = fit.having(pose_errors=in_cameras(fit.pose_errors, given_by, seen))
        edges = f"{EDGES_OFF} by {doubted:.1f} pixels." if doubted else ""
        is_thinned = not all(one.is_taken(effort.readings) for one in seen)
        rest = ""
        if places is None and effort.doubts and not is_thinned:
            fit, rest = _of_most(kind, fit, seen)
        # A caller may write other pixels to a mask, and the depth is a copy.
        regions = [np.array(one) for one in masks]
        known = {"depth": images, "sigma": [v.sigma for v in checked], "mask": regions}
        if not isinstance(depth, list | tuple):
            known = {name: values[0] for name, values in known.items()}
        elif not isinstance(sigma, list | tuple):
            known["sigma"] = checked[0].sigma
        if places is not None:
            told_by_point = Pixelwise.of_points(fit.pixelwise, places)
            fit = fit.having(pixelwise=(told_by_point,), source="points")
            known["places"] = places
        given = [*camera] if isinstance(camera, list | tuple) else camera
        doubts += [disagreement, fit.asked.doubt, edges, rest]
        known |= {"camera": given, "initial": initial, "options": options}
        return fit.noting(
            arguments=known,
            measured=told,
            poses=of_poses,
            doubt=next(filter(None, doubts), ""),
            is_quick=not effort.doubts,
            is_thinned=is_thinned,
        )


def _fit_seen(
    kind: Fittable,
    seen: Sequence[Seen],
    start: AbstractPrimitive | None,
    prior: Prior,
    settings: Settings,
    effort: Effort,
    correlated: bool,
    rounding: float | None,
    in_search: bool,
    is_trial: bool,
) -> Fit:
    """Fit to those readings of a region that are of the shape.

    Errors are taken for `correlated` at first; what follows is as of `fit_shape`.
    """
    quick = dataclasses.replace(effort, doubts=False)

    # Without types of arrays, which would be looked up at each call, in 20 us.
    def fitted(parts: Any, correlated: bool, known: Any, begin: Any) -> Fit:
        asked = settings
        if any(part.region is not one.region for part, one in zip(parts, seen)):  # noqa: B905
            # Only of the whole one a caller says that its edge is the silhouette.
            asked = dataclasses.replace(settings, is_outline=False)
        clear = [part.without_edges() for part in parts]
        # What a fit of the same ended with is a start beside which nothing is.
        is_sure = begin is not None and (in_search or begin is not start)
        own = quick if is_sure else effort
        return _fit_pixels(kind, clear, begin, known, prior, asked, own, correlated)

    def resumed(parts: Any, before: Fit) -> Fit:
        used = [
            # What it took for the object's, if that is told of all pixels.
            one._replace(region=np.asarray(region))
            if one.is_taken(effort.readings)
            else one
            for one, region in zip(parts, each_of(before.region), strict=True)
        ]
        return fitted(used, correlated, None, before.shape)

    def fitted_to(parts: Any, first: Any = start) -> Fit:
        def from_first(
            parts: Any, correlated: bool, known: Any = None, begin: Any = first
        ) -> Fit:
            return fitted(parts, correlated, known, begin)

        def to_surface(parts: Any) -> Fit:
            # An outline is as exact as its caller says.
            is_exact = bool(settings.is_outline)
            how = correlated, is_exact, is_trial
            return fit_of_one_surface(from_first, kind.body, parts, *how)

        return fit_with_learned_rays(to_surface, resumed, parts, rounding)

    if not effort.doubts:
        if start is not None and not in_search:
            # What is not its own would be off by as much in every image of a video.
            body = kind.body.of(jax.tree.map(jnp.asarray, start))
            seen = without_others(seen, body, 1.0, bool(settings.is_outline))
        return fitted(seen, correlated, None, start)
    fit, kept, is_bare = _without_foreign(kind, fitted_to(seen), fitted_to, seen)
    # Where a shoulder was left out the other end may be wrong.
    return _with_feet(kind, fit, fitted_to, kept) if is_bare else fit


def _checked(view: Given) -> tuple[Given, AbstractDepthNoise]:
    """A view with arrays for values, and the noise of its readings."""
    image, noise, sigma = checked_readings(view.depth, view.camera, view.sigma)
    mask = checked_mask(view.mask, view.camera)
    return Given(image, view.camera, mask, sigma), noise


def _without_foreign(
    kind: Fittable,
    fit: Fit,
    fitted_to: Callable[[Sequence[Seen]], Fit],
    seen: Sequence[Seen],
) -> tuple[Fit, Sequence[Seen], bool]:
    """The fit without readings of the region that are not of the shape.

    Returns:
        The fit; what it is of; and whether nothing was found on the object that is not
        of its shape.
    """
    own = seen = at_poses(seen, fit)
    left_out = clusters = [np.zeros_like(one.region) for one in seen]
    num_failed = 0
    for _ in range(MOST_LOOKS):
        is_own = fit.num_inliers >= ALL_OWN * int(fit.num_pixels)
        if is_own or not fit.status.has_numbers:
            break
        body = kind.body.of(fit.shape)
        if fit.success:
            clusters = [
                before | clustered_outliers(one, body, told)
                for before, one, told in zip(clusters, seen, fit.pixelwise, strict=True)
            ]
        foreign = clusters
        if kind.foreign is not None:
            foreign = [
                found | kind.foreign(one, body)
                for found, one in zip(clusters, seen, strict=True)
            ]
        if all(map(np.array_equal, foreign, left_out)):
            break
        kept = [
            one._replace(image=np.where(found, 0, one.image).astype(one.image.dtype))
            for one, found in zip(seen, foreign, strict=True)
        ]
        if sum(one.num_readings for one in kept) < MIN_READINGS:
            break
        left_out, fit = foreign, fitted_to(kept)
        seen, own = at_poses(seen, fit), at_poses(kept, fit)
        num_failed += not bool(fit.success)
        if num_failed == MOST_FAILED:
            break
    return fit, own, not any(map(np.any, clusters))


def _of_most(kind: Fittable, fit: Fit, seen: Sequence[Seen]) -> tuple[Fit, str]:
    """The fit, or a failed one that left out most of what is seen of an object.

    A part of another shape may look like this one, to the noise. Readings beside edges,
    where they may lean, and those in a shape's mouth are left out for other reasons.

    Returns:
        The fit, and what a reader is told of what it left out.
    """

    def share_left(seen: Sequence[Seen]) -> float:
        return 1 - int(fit.num_pixels) / max(sum(one.num_readings for one in seen), 1)

    if not bool(fit.success) or share_left(seen) < SOME:
        return fit, ""
    seen = [one.without_edges() for one in seen]
    if kind.foreign is not None:
        body = kind.body.of(fit.shape)
        inside = [kind.foreign(one, body) for one in seen]
        seen = [
            one._replace(region=one.region & ~foreign)
            for one, foreign in zip(seen, inside, strict=True)
        ]
    share = share_left(seen)
    if share > MOST:
        return fit.failed(FitStatus.POOR_FIT), ""
    return fit, f"{100 * share:.0f} {LEFT_OUT}." if share > SOME else ""


def _with_feet(
    kind: Fittable,
    fit: Fit,
    fitted_to: Callable[[Sequence[Seen], AbstractPrimitive], Fit],
    seen: Sequence[Seen],
) -> Fit:
    """The fit with those ends that the object stands on, where it stands on some."""
    ends_seen = np.asarray(fit.ends_seen)
    if not bool(fit.success) or ends_seen.all():
        return fit
    body = kind.body.of(fit.shape)
    standing = [standing_on(one, body, ends_seen) for one in seen]
    if all(one is other for one, other in zip(standing, seen, strict=True)):
        return fit
    found = fitted_to(standing, fit.shape)
    is_told = np.count_nonzero(found.ends_seen) > np.count_nonzero(ends_seen)
    return found.noting(stands=True) if bool(found.success) and is_told else fit


def _fit_pixels(
    kind: Fittable,
    seen: Sequence[Seen],
    initial: AbstractPrimitive | None,
    known: Fit | None,
    prior: Prior,
    settings: Settings,
    effort: Effort,
    correlated: bool,
) -> Fit:
    """Fit from the start that is given, or from guesses.

    What is seen has no edges; `known` is a fit of the same pixels, or of more. Start
    and prior are in the world frame.
    """
    guesses = guesses_of(kind, seen) if initial is None else []
    is_outline = bool(settings.is_outline)
    shown = all_shown_by(seen, effort.readings, correlated, is_outline)
    inputs = Inputs(prior, settings, shown, effort.kernel)
    program = Program(inputs, correlated)
    counts = [one.num_readings for one in seen]
    search = Search(kind, effort, program, counts)
    search.run(guesses, initial, known)
    found, num_starts = search.found, search.num_starts
    if not found:
        return no_guess(kind, *(one.region for one in seen))
    sizes = [one.image.shape for one in seen]
    fit = best_of(found, num_starts) if num_starts > 1 else found[0].fit
    return _told_by_pixel(fit, likeliest(found), shown, sizes)


def prepare_fit(request: FitRequest, rounding: float | None = None) -> None:
    """Load or compile what a fit from a start takes.

    Args:
        request: Of one view, checked, of as many pixels as will be fitted; without
            sigma as of white noise that was measured.
        rounding: As of `fit_shape`.
    """
    kind, depth, camera, mask, sigma, _, options = request
    noise = checked_noise(sigma, camera)
    effort, correlated = options.effort, options.correlated(noise)
    with working_precision(effort.precision, ()) as converted:
        settings = checked_settings(kind, options, None, sigma)
        known = converted(checked_prior(options.prior, kind.expectable, None))
        own = seen_by(np.asarray(depth), np.asarray(mask), *converted((camera, noise)))
        if rounding is not None:
            own = with_learned_rays(own, rounding)
        shown = (shown_by(own.without_edges(), effort.readings, correlated),)
        inputs = Inputs(known, settings, shown, effort.kernel)
        Program(inputs, correlated).prepare(kind.blank)


def _told_by_pixel(
    fit: Fit,
    found: Assessment,
    shown: Sequence[Table],
    shapes: Sequence[tuple[int, ...]],
    xp: Any = np,
) -> Fit:
    """A fit with what is told of each reading; the `shapes` are of the images."""
    parts = []
    of_views = zip(found.residual, found.marks, shown, shapes, strict=True)
    for residual, marks, table, (height, width) in of_views:
        place = table.row * width + table.col
        place = xp.where(table.row < height, place, height * width).astype(xp.int32)
        parts.append(Pixelwise(residual, marks, place, (height, width)))
    return fit.having(pixelwise=tuple(parts))


def _fit_traced(
    views: Sequence[tuple[DepthImage, Mask | None, Any, AbstractDepthNoise]],
    initial: AbstractBody,
    prior: Prior,
    settings: Settings,
    options: Options,
) -> Fit:
    """Fit with sizes that do not depend on any value, in the world frame."""
    correlated = any(options.correlated(noise) for *_, noise in views)
    how = options.effort.readings, correlated, options.mask_meaning == "outline"
    poses = checked_pose_sigma(options.pose_sigma, len(views))
    shown = tuple(
        _shown_traced(*view, initial, *how)._replace(pose=pose)
        for view, pose in zip(views, poses, strict=True)
    )
    settings = dataclasses.replace(settings, refutes=True)
    start = initial.transformed(shown[0].camera_from_world)
    inputs = Inputs(prior, settings, shown, options.effort.kernel)
    found = fit_from(inputs, start, correlated)
    sizes = [depth.shape for depth, *_ in views]
    return _told_by_pixel(found.fit, found, shown, sizes, jnp)


def _shown_traced(
    depth: DepthImage,
    mask: Mask | None,
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    initial: AbstractBody,
    readings: int | None,
    correlated: bool,
    is_outline: bool,
) -> Table:
    """What an image shows of an object, of which only the run knows.

    Raises:
        ValueError: The camera looks all around: which way it is turned to the object is
            found outside JAX.
    """
    if not isinstance(camera, PinholeCamera):
        raise ValueError(
            f"camera must be a PinholeCamera in a traced fit, got a "
            f"{type(camera).__name__}"
        )
    row, col = camera.frame.pixels()
    if mask is None:
        ray = camera.rays(row, col, depth.dtype)
        mask = in_camera_frame(initial.shape, camera).intersect(ray).mask
    missing = None if is_outline else jnp.asarray(mask & (depth == 0))
    # A mask that is known stays so: its pixels are found before anything is compiled.
    region = np.asarray(mask) if is_concrete(mask) else mask
    depth = without_edges(depth, region, camera, noise)
    sees = camera.sees(row, col)
    if sees is not None:
        region = jnp.asarray(region) & sees
    if isinstance(region, np.ndarray):
        most = most_readings(readings, noise)
        chosen = chosen_pixels(np.ones(region.shape), region, most)
        row, col = map(jnp.asarray, pixel_indices(chosen, most))
    else:
        row, col = traced_indices(region, readings)
    depth, region = map(jnp.asarray, (depth, region))
    return table_of(
        depth, region, row, col, camera, noise, correlated, missing=missing, xp=jnp
    )
