"""What a solution shows: its ends, its covariance, and whether it can be believed."""

__all__ = ["Assessment", "assess"]

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int8

from impostor_jax.compiling import computed_once
from impostor_jax.fit.across import across_found
from impostor_jax.fit.agreement import contradiction, reduced_chi2, strays, tail
from impostor_jax.fit.alternatives import no_alternatives
from impostor_jax.fit.between_views import between_views
from impostor_jax.fit.body import AbstractBody, Readout, coordinates_of
from impostor_jax.fit.budget import Deviations
from impostor_jax.fit.deviations import are_numbers, deviations_of
from impostor_jax.fit.evidence import (
    Readings,
    Terms,
    crossing_terms,
    joined_readings,
    joined_terms,
    readings_of,
)
from impostor_jax.fit.form import departures_of, no_form
from impostor_jax.fit.posterior import cost_of, explains, hidden_pixels
from impostor_jax.fit.prior import prior_residuals, scale_left
from impostor_jax.fit.problem import Problem, View
from impostor_jax.fit.result import DISAGREEING, Fit
from impostor_jax.fit.solve import STAGES, Solution, in_coordinates, spread_of
from impostor_jax.fit.status import STATUSES, FitStatus, code_of_first
from impostor_jax.fit.uncertainty import (
    LEAST_LEFT,
    covariance_root,
    sandwich_root,
    score_covariance,
)
from impostor_jax.numerics import product, safe_divide
from impostor_jax.sensor.across import AcrossRay

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

MOST_UNMET = 0.02
"""Share of the inliers whose rays may miss the shape."""

MIN_END_TERMS = 5
"""Fewest inlying readings of a cap, or crossings, that show an end; and fewest of
either that tell of any other coordinate."""

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
    views, prior, settings = problem.views, problem.prior, problem.settings
    # The axis is signed so that its largest component in the world is positive.
    sign = problem.in_world(solution.body).sign
    body = solution.body.reversed(jnp.where(settings.keep_ends, 1, sign))
    bodies = [view.own(body) for view in views]
    of_views = computed_once(
        lambda: readings_of(problem, bodies, [view.noise for view in views])
    )
    readings = joined_readings(of_views, views, body)
    terms, seen = readings.terms, readings.passing
    last = STAGES[-1]
    edges = problem.of_each(
        lambda view, own: crossing_terms(
            view.edge, own, view.noise, settings.is_outline, last.place
        ),
        bodies,
    )
    edges = joined_terms(edges, views, body)
    used, depth = readings.used, _of_all([view.pixels.depth for view in views])
    count = jnp.sum(used)
    # As the sensor errs: of a scanner along the ray.
    length = _of_all([view.pixels.length for view in views])
    meters = jnp.where(used, -readings.off * length, 0)
    spread = spread_of(terms.residual, used)

    def is_near() -> Bool[Array, " n"]:
        # The residuals take a cap for a whole plane; readings beyond its rim are not
        # on it.
        return used & (jnp.abs(terms.residual) <= 3 * spread) & ~seen.is_past_rim

    inlier = computed_once(is_near)
    crossing = (edges.weight > 0) & (jnp.abs(edges.residual) < 6)
    whitened = jnp.where(inlier, terms.residual, 0)
    slack = 3 * spread / jnp.where(terms.weight > 0, terms.weight, 1)
    shown = jnp.where(terms.weight > 0, body.end_shown(seen, depth, slack), 0)
    ends = jnp.array(body.ends, shown.dtype)[:, None]
    counts = jnp.sum(inlier[None] & (shown[None] == ends), axis=1)
    counts += jnp.sum(crossing[None] & (edges.end[None] == ends), axis=1)
    ends_seen = counts >= MIN_END_TERMS
    outward = jnp.where(inlier[None], body.outward(seen), -jnp.inf)
    reach = jnp.max(outward, axis=1, initial=-jnp.inf)
    estimate = body
    body, carried = estimate.drawn_in(
        ends_seen | ~jnp.asarray(settings.draws_in), reach
    )
    num_inliers = jnp.maximum(jnp.sum(inlier), 1).astype(meters.dtype)
    rms = jnp.sqrt(jnp.sum(jnp.where(inlier, meters, 0) ** 2) / num_inliers)
    squares = jnp.sum(whitened**2)

    basis = body.free_basis(settings.free, problem.unit, problem.unit)
    # An end that is not seen is free, though some readings beyond it may lean on it.
    # The ends are the last coordinates. A few readings do not show a bore, either.
    depends = jnp.sum(inlier[None] & (terms.gradient != 0), axis=1)
    depends += jnp.sum(crossing[None] & (edges.gradient != 0), axis=1)
    others = depends[: basis.shape[0] - ends_seen.size] >= MIN_END_TERMS
    leans = jnp.where(jnp.concatenate([others, ends_seen]), 1, 0).astype(basis.dtype)
    into = product(basis.T * leans[None], carried)
    num_moves, bias = len(into), problem.bias
    if bias.scales:
        # What the sensor shows may be larger, and no reading tells.
        into = jnp.pad(into, ((0, 1), (0, 0)))
    beside = _of_all([view.beside for view in views])
    # A reading of the wall that grazes it beside a rim may be the cap's as well: one of
    # them, if it counts, tells more of the radius than all others.
    at_rim = jnp.abs(seen.rim - seen.cap_radius) < problem.unit
    at_rim &= seen.cap_radius > 0
    tells = inlier & ~(readings.is_square & at_rim)
    of_all = _products(terms, tells, into)
    of_border = _products(terms, tells & (beside > 0), into)
    of_edges = _products(edges, crossing, into)

    def in_world(
        body: AbstractBody, larger: Float[Array, " s"] | None = None
    ) -> AbstractBody:
        if bias.scales:
            # What the sensor shows, as large as is known otherwise.
            expected, deviation = scale_left(prior, body, bias)
            if larger is not None:
                expected += deviation * larger[0]
            body = body.magnified(expected)
        return problem.in_world(body)

    world = in_world(body)

    def read(free: Float[Array, " c"]) -> tuple[Readout, Float[Array, " p"]]:
        moved = body.retracted(product(basis, free[:num_moves]), settings.free)
        told = in_world(moved, free[num_moves:]).readout(world, ends_seen)
        return told, prior_residuals(prior, moved, bias)

    change, known = jax.jacfwd(read)(jnp.zeros(len(into), basis.dtype))
    # What is held stays, whatever moves the place at which it is read.
    for name in filter(change.__contains__, settings.held):
        change[name] = jnp.where(settings.held[name], 0, change[name])
    widening = repeats = jnp.maximum(squares / num_inliers, 1)
    # Summed up, they are the information; each is what its errors pull by.
    parts = {
        "noise": of_all[:-1, :-1] / widening,
        "outline": of_edges[:-1, :-1],
        "prior": product(known.T, known),
        "scale": jnp.diag(jnp.where(np.arange(len(into)) < num_moves, 0.0, 1.0)),
    }
    root, directions, free = covariance_root(_sum_of(parts.values()))
    independent = product(root, root.T)
    pull_of_others = product(known.T, prior_residuals(prior, body, bias))
    pull_of_others += of_edges[:-1, -1] / widening
    pull = pull_of_others + of_all[:-1, -1] / widening
    statistic = contradiction(of_border / widening, pull, independent)
    swelling, departures = estimate.swelling(terms.gradient), None
    rests = whitened[None]
    if swelling is not None:
        departures = departures_of(
            terms.augmented,
            swelling,
            tells & ~seen.on_cap,
            into,
            root,
            pull,
            widening,
        )
        rests = jnp.stack([whitened, jnp.where(inlier, departures.residual, 0)])
    between = None
    if not problem.is_single:
        # A wall that departs is seen otherwise from each side.
        told = terms.augmented, rests[-1], tells
        given = into, root, pull_of_others, widening
        between = between_views(problem, *told, *given)
        of_each_view = jnp.where(inlier, between.residual, 0)
        rests = jnp.concatenate([rests, of_each_view[None]])
    biases = [view.noise.bias for view in views]
    leans = any(b.lean is not None for b in biases)
    shares_errors = bool(
        correlated or leans or any(b.fields or b.scales for b in biases)
    )
    # In coordinates in which independent errors have a variance of 1. So are the slopes
    # of readings: their sums would round away what an image hardly tells.
    parts = {name: product(root.T, part, root) for name, part in parts.items()}
    by_form = by_views = jnp.zeros_like(independent)
    if shares_errors:
        whitening = product(root.T, into)
        gradient = product(whitening, terms.gradient)
        gradient = jnp.where(tells[None], gradient, 0) / widening
        score = gradient * (terms.weight * readings.follows)[None]
        if correlated:
            slopes, rests = problem.apart(gradient), problem.apart(rests)
            of_readings = [
                score_covariance(slope.T, rest, view.lattice)
                for view, slope, rest in zip(views, slopes, rests, strict=True)
                if view.lattice is not None
            ]
            of_each = _sum_of(of_readings)
            parts["correlation"] = of_each[0] - parts["noise"]
            by_views = of_each[0] - of_each[-1]
            if departures is not None:
                by_form = of_each[0] - of_each[1]
        scores = problem.apart(score / length[None])
        smooth = _shared(problem, scores, problem.apart(seen.depth * length), body)
        parts["warp"], of_scales = smooth
        parts["scale"] += of_scales
        if leans:
            lean = _leaning(problem, scores, bodies, of_views)
            parts["alignment"] = lean[:, None] * lean[None]
    learns = any(isinstance(view.noise, AcrossRay) for view in views)
    if learns:
        # Where what was learned of the rays is off by a deviation.
        noises = [
            view.noise.doubted() if isinstance(view.noise, AcrossRay) else view.noise
            for view in views
        ]
        of_doubted = computed_once(lambda: readings_of(problem, bodies, noises))
        doubted = joined_readings(of_doubted, views, body).terms
        pulls = doubted.gradient * doubted.residual[None]
        pulls -= terms.gradient * terms.residual[None]
        pulls = jnp.sum(jnp.where(tells[None], pulls, 0), axis=1) / widening
        doubt = product(root.T, into, pulls)
        parts["noise"] += doubt[:, None] * doubt[None]
    whole, shared = root, jnp.ones_like(repeats)
    if shares_errors or learns:
        whole = sandwich_root(root, _sum_of(parts.values()), LEAST_LEFT)
    if shares_errors:
        # Errors that neighbors share let a part pull harder by as much as they widen
        # the standard deviations.
        shared = _wider(whole, independent)
    statistic, repeats = statistic / shared, repeats * shared
    if between is not None and shares_errors:
        # Those within a view: where views disagree, neighbors seem to share an error.
        left = sandwich_root(root, _sum_of(parts.values()) - by_views, LEAST_LEFT)
        alone = _wider(left, independent)
        between = between._replace(
            chi2=between.chi2 / alone, chi2_of_form=between.chi2_of_form / alone
        )
    form = no_form(repeats.dtype)
    if departures is not None:
        if correlated:
            # Not all that neighbors share is an error, where a wall departs.
            left = sandwich_root(root, _sum_of(parts.values()) - by_form, LEAST_LEFT)
            shared = _wider(left, independent)
        form, parts["form"] = departures.told(shared)
        if between is not None:
            # What looks like another form may be poses that err.
            may_err = form.departs & (between.chi2 >= DISAGREEING)
            spread_of_views = product(between.moves.T, between.moves)
            parts["form"] += jnp.where(may_err, spread_of_views, 0)
        whole = sandwich_root(root, _sum_of(parts.values()), LEAST_LEFT)
    shares = {name: product(root, part, root.T) for name, part in parts.items()}
    std, budget, covariance, observed, is_known = deviations_of(
        world, change, whole, shares, directions, free
    )
    statistic = jnp.where(strays(inlier, used, beside), jnp.inf, statistic)
    chi2 = reduced_chi2(squares, num_inliers)
    num_missed = jnp.sum(inlier & seen.is_missed, dtype=meters.dtype)
    finest = jnp.max(terms.weight)
    is_small = (spread < 5) | (spread < body.radius * finest / 50)
    # More readings than not, on a shape that their rays meet.
    agrees = 2 * num_inliers >= count.astype(meters.dtype)
    agrees &= num_missed <= MOST_UNMET * num_inliers
    agrees &= jnp.where(settings.trusts_sigma, chi2 < MOST_CHI2, is_small)
    is_rough = (chi2 > ROUGH_CHI2) & (rms > ROUGH * body.radius)
    agrees &= ~(settings.trusts_sigma & is_rough)
    agrees &= ~_is_filled(readings, depth, spread)
    if between is not None:
        agrees &= between.chi2_of_form < DISAGREEING
    # Of what bends in no way a departure is no number, and no fault.
    agrees &= ~jnp.any(jnp.abs(form.value) > MOST_DEPARTED + 3 * form.deviation)
    # A fit that is not traced goes on with what agrees, and takes errors that do not
    # for correlated.
    agrees &= (statistic < (DISAGREEING if correlated else np.inf)) | ~jnp.asarray(
        settings.refutes
    )
    pixel = jnp.min(jnp.stack([view.pixel for view in views]))
    # The harmonic mean of depths: a reading may be as far off as can be.
    nearness = jnp.sum(jnp.where(used, 1 / jnp.where(used, depth, 1), 0))
    middle = jnp.maximum(count, 1).astype(depth.dtype) / jnp.maximum(nearness, 1e-6)
    has_size = body.radius > LEAST_RADIUS * pixel * middle
    is_flat = _is_as_flat(problem, terms.weight, inlier, squares)
    code = _status_code(
        converged=solution.converged,
        finite=solution.finite
        & are_numbers(body, std, budget, covariance, chi2, statistic),
        fits=agrees,
        determined=has_size & ~is_flat & is_known,
    )
    success = code == STATUSES.index(FitStatus.CONVERGED)
    num_free = jnp.sum(jnp.any(settings.free != 0, axis=0)).astype(chi2.dtype)
    p_value = tail(chi2, num_inliers - num_free)

    # One list for two, and no image: which they are of no program knows.
    marks = jnp.where(used, jnp.where(inlier, 2, 1), 0).astype(jnp.int8)
    fit = Fit(
        shape=world.shape,
        std=jax.tree.map(lambda x: jnp.where(success, x, jnp.inf), std),
        std_budget=jax.tree.map(lambda x: jnp.where(success, x, jnp.inf), budget),
        coordinates=coordinates_of(world),
        ends_seen=ends_seen,
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
        border_chi2=statistic,
        alternatives=no_alternatives(world.shape),
        across=across_found(problem, bodies, of_views, repeats),
        form=form,
    )
    hides = hidden_pixels(problem, estimate)
    cost = cost_of(problem, estimate, of_views, hides)
    hidden = hides / jnp.maximum(count, 1).astype(rms.dtype)
    hides_tilt = problem.nominal > HIDES_TILT * body.radius
    is_clear = success & (hidden <= MOST_HIDDEN) & (~hides_tilt | body.is_long)
    is_clear &= explains(readings, spread)
    is_deep = problem.nominal > HIDES_TURN * body.radius
    ends_early = (p_value < UNLIKELY) & (hides_tilt | ~jnp.all(ends_seen))
    ends_early |= hides_tilt & ~jnp.asarray(settings.trusts_sigma)
    return Assessment(
        fit=fit,
        body=body,
        cost=jnp.where(solution.finite, cost, jnp.inf),
        is_possible=has_size & ~is_flat & _radius_is_told(body, std),
        repeats=repeats,
        is_clear=is_clear,
        hides_tilt=hides_tilt,
        hides_turn=hides_tilt & body.is_square & (~is_clear | is_deep),
        ends_early=ends_early,
        residual=problem.apart(meters),
        marks=problem.apart(marks),
    )


def _radius_is_told(body: AbstractBody, std: Deviations) -> Bool[Array, ""]:
    """Whether a radius, or an edge, one of several, is known to less than itself."""
    radii = [x for x in body.coordinates if "radius" in x or x == "size"]
    outer = [getattr(std, name) for name in radii if name != "inner_radius"]
    return jnp.any(jnp.stack(outer) < body.radius)


def _of_all(parts: Sequence[Array]) -> Array:
    """Values of all views, one after the other."""
    return parts[0] if len(parts) == 1 else jnp.concatenate(parts)


def _shared(
    problem: Problem,
    scores: Sequence[Float[Array, "c n"]],
    depths: Sequence[Float[Array, " n"]],
    body: AbstractBody,
) -> tuple[Float[Array, "c c"], Float[Array, "c c"]]:
    """Covariance of sums of a score times smooth errors, and times those of a scale.

    One view's error of scale looks like another size, which is counted there. Two views
    do not agree on it: it is an error of each.

    Args:
        problem: What was given.
        scores: Of each view's readings, per meter that the sensor measures.
        depths: Of the surface there, as it measures them.
        body: The estimate, in the first view's frame.
    """
    views = problem.views
    if problem.is_central:
        (view,), (score,), (depth,) = views, scores, depths
        warp = view.noise.bias.score_covariance(
            score, depth, view.row, view.col, body.center[2]
        )
        return warp, jnp.zeros_like(warp)
    warps = [
        view.noise.bias.without_scales.score_covariance(
            score, depth, view.row, view.col, body.center[2]
        )
        for view, score, depth in zip(views, scores, depths, strict=True)
    ]
    pulls = [
        view.noise.bias.scale_pulls(score, depth)
        for view, score, depth in zip(views, scores, depths, strict=True)
    ]
    of_scales = _sum_of([product(pull.T, pull) for pull in pulls])
    if len({pull.shape for pull in pulls}) == 1:
        together = jnp.sum(jnp.stack(pulls), axis=0)
        of_one = product(together.T, together)
        of_scales = jnp.where(problem.settings.one_sensor, of_one, of_scales)
    return _sum_of(warps), of_scales


def _wider(
    root: Float[Array, "c c"], independent: Float[Array, "c c"]
) -> Float[Array, ""]:
    """Mean factor on variances, at least 1.

    Args:
        root: Of the covariance.
        independent: Covariance if all readings err by themselves.
    """
    variance = jnp.diagonal(independent)
    wider = safe_divide(jnp.sum(root**2, axis=1), variance)
    moves = variance > 0
    mean = jnp.sum(jnp.where(moves, wider, 0)) / jnp.sum(moves, dtype=wider.dtype)
    return jnp.maximum(mean, 1)


def _leaning(
    problem: Problem,
    scores: Sequence[Float[Array, "c n"]],
    bodies: Sequence[AbstractBody],
    of_views: Sequence[Readings],
) -> Float[Array, " c"]:
    """Sum of a score times a deviation of what walls lean by, in all views alike.

    Args:
        problem: What was given.
        scores: As of `_shared`.
        bodies: The estimate, in each view's frame.
        of_views: What each view's readings say of it.
    """
    pulls = []
    views = zip(problem.views, scores, bodies, of_views, strict=True)
    for view, score, body, told in views:
        seen = told.passing
        # Per meter of depth, in which the lean is told.
        score = score * view.pixels.length[None]
        pulls.append(
            view.noise.bias.lean_pull(
                score, seen.depth, seen.cos_incidence, view.pixel, body.radius
            )
        )
    return jnp.sum(jnp.stack(pulls), axis=0)


def _sum_of(parts: Iterable[Float[Array, "*r c c"]]) -> Float[Array, "*r c c"]:
    return jnp.sum(jnp.stack([*parts]), axis=0)


def _products(
    terms: Terms, counts: Bool[Array, " n"], into: Float[Array, "k c"]
) -> Float[Array, "m m"]:
    """Products of some terms of Jacobian and residual, in free coordinates."""
    some = jnp.where(counts[None], terms.augmented, 0)
    return in_coordinates(product(some, some.T), into)


def _is_filled(
    readings: Readings, depth: Float[Array, " n"], spread: Float[Array, ""]
) -> Bool[Array, ""]:
    """Whether something else than its wall is seen in a bore."""
    seen = readings.passing
    within = readings.used & seen.within
    off = (seen.depth - depth) * readings.terms.weight > 4 * spread
    count, total = (jnp.sum(x, dtype=depth.dtype) for x in (within & off, within))
    return count > MOST_FILLED * total


def _status_code(
    converged: Bool[Array, ""],
    finite: Bool[Array, ""],
    fits: Bool[Array, ""],
    determined: Bool[Array, ""],
) -> Int[Array, ""]:
    """Code of the first thing that went wrong."""
    # The steps of a radius that readings leave open grow for ever.
    is_open = fits & ~determined
    wrong = {
        FitStatus.NOT_FINITE: ~finite,
        FitStatus.STEP_LIMIT: ~converged & ~is_open,
        FitStatus.POOR_FIT: ~fits,
        FitStatus.UNDETERMINED: ~determined,
    }
    return code_of_first(wrong)


def _is_as_flat(
    problem: Problem,
    weight: Float[Array, " n"],
    inlier: Bool[Array, " n"],
    squares: Float[Array, ""],
) -> Bool[Array, ""]:
    """Whether a plane explains the readings as well as the body does.

    A plane is linear in inverse depth over the rays, so one linear solve finds it; of
    rays that begin elsewhere, over what leads from the origin to where the reading is,
    divided by its depth. A body has to beat it by 25, in squared standard deviations.

    Args:
        problem: The readings.
        weight: Inverse of their standard deviations.
        inlier: Readings that lie on the body.
        squares: Sum of their squared residuals from it, in standard deviations.
    """
    depth = _of_all([view.pixels.depth for view in problem.views])
    inverse = jnp.where(inlier, 1 / jnp.where(inlier, depth, 1), 0)
    weight = jnp.where(inlier, weight * depth, 0)
    towards = [_towards(view) for view in problem.views]
    towards = towards[0] if problem.is_single else jnp.concatenate(towards, axis=1)
    rays = towards * (weight * depth)[None]
    normal = product(rays, rays.T)
    right = product(rays, weight * depth * inverse)
    # Cramer's rule: the rows of the adjugate are cross products.
    adjugate = jnp.cross(jnp.roll(normal, -1, axis=0), jnp.roll(normal, -2, axis=0))
    determinant = jnp.sum(normal[0] * adjugate[0])
    inverse_determinant = safe_divide(jnp.ones_like(determinant), determinant)
    plane = jnp.sum(adjugate.T * right[None], axis=1) * inverse_determinant
    flat = product(plane, rays) - weight * depth * inverse
    scale = jnp.maximum(
        squares / jnp.maximum(jnp.sum(inlier), 1).astype(depth.dtype), 1
    )
    return jnp.sum(flat**2) < squares + 25 * scale


def _towards(view: View) -> Float[Array, "3 n"]:
    """Readings in the first view's frame, over their depths; 0 where there is none."""
    pixels, move = view.pixels, view.from_first
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
