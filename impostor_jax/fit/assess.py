"""What a solution shows: its ends, its covariance, and whether it can be believed."""

__all__ = ["Assessment", "assess"]

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int8

from impostor_jax.fit.across import across_found
from impostor_jax.fit.agreement import reduced_chi2, tail
from impostor_jax.fit.alternatives import no_alternatives
from impostor_jax.fit.body import AbstractBody, coordinates_of
from impostor_jax.fit.budget import Deviations, if_known
from impostor_jax.fit.covariance import (
    FreeCoordinates,
    Uncertainty,
    free_coordinates,
    uncertainty_of,
)
from impostor_jax.fit.deviations import are_numbers, deviations_of, open_where_unseen
from impostor_jax.fit.inliers import Compared, Inliers, compared, inliers_of
from impostor_jax.fit.posterior import cost_of, explains, hidden_pixels
from impostor_jax.fit.problem import Problem, View
from impostor_jax.fit.result import DISAGREEING, Fit, PoseErrors
from impostor_jax.fit.solve import Solution
from impostor_jax.fit.status import STATUSES, FitStatus, code_of_first
from impostor_jax.numerics import product, safe_divide

MOST_CHI2 = 9.0
"""Reduced chi-squared up to which readings may be of the shape, where their noise is
known: residuals of three standard deviations. The bands of a structured-light sensor,
1.5 mm and more where single readings scatter by one, stay below; a can of half the
radius that is held does not."""

ROUGH_CHI2, ROUGH = 4.0, 0.1
"""Reduced chi-squared from which on residuals must be a small part of the radius: no
bands are as rough as a shape that readings of another one lie about."""

MOST_DEPARTED = 0.5
"""Departure from the shape, over its radius, from which on a wall is of another one."""

MOST_UNMET, SURELY = 0.02, 3.0
"""Share of the inliers whose rays may miss the shape, by more than so many deviations
of where that is."""

MOST_FILLED = 0.25
"""Share of the readings through the mouth of a bore that may lie in front of its wall:
of outliers, and not of a floor or a filling, beside which the wall's would be wrong."""

UNLIKELY = 0.05
"""Probability of the readings below which a fit is repeated where noise is deep or an
end is unseen."""

HIDES_TILT = 0.03
"""Noise in radii from which the depth of a short object does not tell its tilt."""

HIDES_TURN = 0.1
"""The same from which even a fit that is clear does not tell it from one turned by a
quarter. With less, of 44 clear fits of squat cans none had a better one beside it."""

LEAST_RADIUS = 0.5
"""Of what an image can show, in distances of neighboring rays where the body is."""

MOST_HIDDEN = 0.02
"""Share, in readings, of the pixels around that may see through the body."""


class Assessment(NamedTuple):
    """What is said of a solution.

    Attributes:
        fit: The result, in the world frame.
        body: The estimate, in the first view's frame.
        cost: How badly it explains the image: the negative logarithm of its posterior
            probability, to be compared with that of others.
        is_possible: Whether it has a size that the image can show: a pixel's at least,
            and a radius that is known to less than itself.
        repeats: Readings that tell as much as one whose error is its own and as `sigma`
            says.
        is_clear: Whether it explains the image so well that no other start could do
            better.
        hides_tilt: Whether the noise may hide which of two tilts is the true one.
        hides_turn: Whether it may hide that the axis is turned by a quarter, too.
        ends_early: Whether readings that it leaves out may lead on from where it ended:
            where its readings are unlikely, or nobody knows.
        residual: Of each view's readings, in meters as the sensor measures.
        marks: Of the same: 2 of those on the shape, 1 of others that were used.
        num_ended: Starts that ended there.
    """

    fit: Fit
    body: AbstractBody
    cost: Float[Array, ""]
    is_possible: Bool[Array, ""]
    repeats: Float[Array, ""]
    is_clear: Bool[Array, ""]
    hides_tilt: Bool[Array, ""]
    hides_turn: Bool[Array, ""]
    ends_early: Bool[Array, ""]
    residual: Sequence[Float[Array, " n"]] = ()
    marks: Sequence[Int8[Array, " n"]] = ()
    num_ended: int | Int[Array, ""] = 1


def assess(problem: Problem, solution: Solution, correlated: bool) -> Assessment:
    """Result of a fit in the world frame.

    Args:
        problem: What was given.
        solution: The estimate.
        correlated: Whether the covariance allows for correlated residuals.
    """
    settings, problem = problem.settings, problem.with_poses(solution.off)
    # The axis is signed so that its largest component in the world is positive.
    sign = problem.in_world(solution.body).sign
    estimate = solution.body.reversed(jnp.where(settings.keep_ends, 1, sign))
    told = compared(problem, estimate)
    on = inliers_of(told, estimate, problem.unit)
    free = free_coordinates(problem, estimate, on)
    body, world = free.body, free.world
    errors = uncertainty_of(problem, estimate, told, on, free, correlated)
    std, budget, covariance, observed, is_known = deviations_of(
        world,
        free.change,
        errors.root,
        errors.shares,
        errors.directions,
        errors.is_free,
    )
    meters, used = told.meters, told.readings.used
    count = jnp.sum(used)
    rms = jnp.sqrt(jnp.sum(jnp.where(on.inlier, meters, 0) ** 2) / on.num_inliers)
    chi2 = reduced_chi2(on.squares, on.num_inliers)
    agrees = _agrees(problem, free, told, on, errors, rms, chi2, correlated)
    is_possible = _has_size(problem, body, told) & ~_is_as_flat(problem, told, on)
    finite = solution.finite & are_numbers(
        body, std, budget, covariance, chi2, errors.border_chi2
    )
    determined = is_possible & is_known
    # The steps of a radius that readings leave open grow for ever.
    is_open = agrees & ~determined
    code = code_of_first(
        {
            FitStatus.NOT_FINITE: ~finite,
            FitStatus.STEP_LIMIT: ~solution.converged & ~is_open,
            FitStatus.POOR_FIT: ~agrees,
            FitStatus.UNDETERMINED: ~determined,
        }
    )
    success = code == STATUSES.index(FitStatus.CONVERGED)
    num_free = jnp.sum(jnp.any(settings.free != 0, axis=0)).astype(chi2.dtype)
    p_value = tail(chi2, on.num_inliers - num_free)

    # One list for two, and no image: which they are of no program knows.
    marks = jnp.where(used, jnp.where(on.inlier, 2, 1), 0).astype(jnp.int8)
    fit = Fit(
        shape=world.shape,
        std=if_known(success, open_where_unseen(std, body, on.ends_seen)),
        std_budget=if_known(success, open_where_unseen(budget, body, on.ends_seen)),
        coordinates=coordinates_of(world),
        ends_seen=on.ends_seen,
        covariance=covariance,
        observed=observed,
        success=success,
        status_code=code,
        num_steps=solution.num_steps,
        num_starts=jnp.ones((), int),
        num_agreeing=jnp.ones((), int),
        pixelwise=(),
        num_pixels=count,
        rms=rms,
        chi2=chi2,
        tail=jnp.where(settings.trusts_sigma, p_value, -1),
        border_chi2=errors.border_chi2,
        alternatives=no_alternatives(world.shape),
        across=across_found(problem, told.bodies, told.of_views, errors.repeats),
        form=errors.form,
        pose_errors=_pose_errors(problem, errors),
    )
    hides = hidden_pixels(problem, estimate)
    cost = cost_of(problem, estimate, told.of_views, hides)
    hidden = hides / jnp.maximum(count, 1).astype(rms.dtype)
    hides_tilt = problem.nominal > HIDES_TILT * body.radius
    is_clear = success & (hidden <= MOST_HIDDEN) & (~hides_tilt | body.is_long)
    is_clear &= explains(told.readings, on.spread)
    is_deep = problem.nominal > HIDES_TURN * body.radius
    ends_early = (p_value < UNLIKELY) & (hides_tilt | ~jnp.all(on.ends_seen))
    ends_early |= hides_tilt & ~jnp.asarray(settings.trusts_sigma)
    return Assessment(
        fit=fit,
        body=body,
        cost=jnp.where(finite, cost, jnp.inf),
        is_possible=is_possible & _radius_is_told(body, std),
        repeats=errors.repeats,
        is_clear=is_clear,
        hides_tilt=hides_tilt,
        hides_turn=hides_tilt & body.is_square & (~is_clear | is_deep),
        ends_early=ends_early,
        residual=problem.apart(meters),
        marks=problem.apart(marks),
    )


def _pose_errors(problem: Problem, errors: Uncertainty) -> PoseErrors | None:
    """What poses are off by, and how well that is known; None of exact ones."""
    poses = problem.poses
    if not poses:
        return None
    value, sigma = (
        jnp.stack([getattr(x, of) for x in poses]) for of in ("total", "sigma")
    )
    variance = jnp.sum(errors.root**2, axis=1)[-value.size :]
    # What would be left of the variance of each in deviations, which was 1.
    left = jnp.diagonal(errors.independent)[-value.size :]
    freedom = jnp.sum(jnp.maximum(1 - left, 0))
    std = sigma * jnp.sqrt(variance).reshape(value.shape)
    return PoseErrors(value, std, freedom)


def _agrees(
    problem: Problem,
    free: FreeCoordinates,
    told: Compared,
    on: Inliers,
    errors: Uncertainty,
    rms: Float[Array, ""],
    chi2: Float[Array, ""],
    correlated: bool,
) -> Bool[Array, ""]:
    """Whether the readings are of such a shape, and there."""
    settings, terms, seen = problem.settings, told.readings.terms, told.readings.passing
    body, total = free.body, jnp.sum(told.readings.used).astype(rms.dtype)
    # In deviations of its square. Within what the estimate is unsure by a ray may meet
    # it: a twentieth of a pixel beside the outline of a ball of eight lie four of 218.
    missed = -seen.square * terms.weight**2 / np.sqrt(2)
    slopes = product(product(errors.root.T, free.into), terms.gradient)
    unsure = jnp.sqrt(jnp.sum(slopes * slopes, axis=0))
    misses = seen.is_missed & (missed > SURELY * unsure)
    num_missed = jnp.sum(on.inlier & misses, dtype=rms.dtype)
    finest = jnp.max(terms.weight)
    is_small = (on.spread < 5) | (on.spread < body.radius * finest / 50)
    # More readings than not, on a shape that their rays meet.
    agrees = 2 * on.num_inliers >= total
    agrees &= num_missed <= MOST_UNMET * on.num_inliers
    agrees &= jnp.where(settings.trusts_sigma, chi2 < MOST_CHI2, is_small)
    is_rough = (chi2 > ROUGH_CHI2) & (rms > ROUGH * body.radius)
    agrees &= ~(settings.trusts_sigma & is_rough)
    agrees &= ~_is_filled(told, on)
    if errors.between is not None:
        agrees &= errors.between.chi2_of_form < DISAGREEING
    # Of what bends in no way a departure is no number, and no fault.
    form = errors.form
    agrees &= ~jnp.any(jnp.abs(form.value) > MOST_DEPARTED + 3 * form.deviation)
    # A fit that is not traced goes on with what agrees, and takes errors that do not
    # for correlated.
    most = DISAGREEING if correlated else np.inf
    return agrees & ((errors.border_chi2 < most) | ~jnp.asarray(settings.refutes))


def _has_size(problem: Problem, body: AbstractBody, told: Compared) -> Bool[Array, ""]:
    """Whether an image can show a radius as small as that."""
    used, depth = told.readings.used, told.depth
    pixel = jnp.min(jnp.stack([view.pixel for view in problem.views]))
    # The harmonic mean of depths: a reading may be as far off as can be.
    nearness = jnp.sum(jnp.where(used, 1 / jnp.where(used, depth, 1), 0))
    count = jnp.maximum(jnp.sum(used), 1).astype(depth.dtype)
    middle = count / jnp.maximum(nearness, 1e-6)
    return body.radius > LEAST_RADIUS * pixel * middle


def _radius_is_told(body: AbstractBody, std: Deviations) -> Bool[Array, ""]:
    """Whether a radius, or an edge, one of several, is known to less than itself."""
    radii = [x for x in body.coordinates if "radius" in x or x == "size"]
    outer = [getattr(std, name) for name in radii if name != "inner_radius"]
    return jnp.any(jnp.stack(outer) < body.radius)


def _is_filled(told: Compared, on: Inliers) -> Bool[Array, ""]:
    """Whether something else than its wall is seen in a bore."""
    readings, depth = told.readings, told.depth
    seen = readings.passing
    within = readings.used & seen.within
    off = (seen.depth - depth) * readings.terms.weight > 4 * on.spread
    count, total = (jnp.sum(x, dtype=depth.dtype) for x in (within & off, within))
    return count > MOST_FILLED * total


def _is_as_flat(problem: Problem, told: Compared, on: Inliers) -> Bool[Array, ""]:
    """Whether a plane explains the readings as well as the body does.

    A plane is linear in inverse depth over the rays, so one linear solve finds it; of
    rays that begin elsewhere, over what leads from the origin to where the reading is,
    divided by its depth. A body has to beat it by 25, in squared standard deviations.
    """
    depth, inlier = told.depth, on.inlier
    inverse = jnp.where(inlier, 1 / jnp.where(inlier, depth, 1), 0)
    weight = jnp.where(inlier, told.readings.terms.weight * depth, 0)
    towards = jnp.concatenate([_towards(view) for view in problem.views], axis=1)
    rays = towards * (weight * depth)[None]
    normal = product(rays, rays.T)
    right = product(rays, weight * depth * inverse)
    # Cramer's rule: the rows of the adjugate are cross products.
    adjugate = jnp.cross(jnp.roll(normal, -1, axis=0), jnp.roll(normal, -2, axis=0))
    determinant = jnp.sum(normal[0] * adjugate[0])
    inverse_determinant = safe_divide(jnp.ones_like(determinant), determinant)
    plane = jnp.sum(adjugate.T * right[None], axis=1) * inverse_determinant
    flat = product(plane, rays) - weight * depth * inverse
    return jnp.sum(flat**2) < on.squares + 25 * on.variance


def _towards(view: View) -> Float[Array, "3 n"]:
    """Readings in the first view's frame, over their depths; 0 where there is none."""
    pixels, move = view.pixels, view.from_shared
    d, start = pixels.direction, pixels.start
    if move is None and start is None:
        return jnp.stack([d.x, d.y, d.z])
    read = pixels.depth > 0
    depth = jnp.where(read, pixels.depth, 1)
    points = jnp.stack([d.x, d.y, d.z], axis=-1) * depth[:, None]
    if start is not None:
        points += jnp.stack([start.x, start.y, start.z], axis=-1)
    if move is not None:
        points = move.inverse().apply(points)
    return jnp.where(read[None], points.T / depth[None], 0)
