"""How far errors move an estimate: its covariance, as a sum over their causes.

The information of all terms gives the covariance if each reading errs by itself. What
readings err by together, and what an estimate leaves out, widens it: errors that
neighbors share, those of a sensor's scale and of its smooth warp, a lean of walls, rays
that are known by what was learned, a wall that departs from its shape.
"""

__all__ = ["FreeCoordinates", "Uncertainty", "free_coordinates", "uncertainty_of"]

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.compiling import computed_once
from impostor_jax.fit.agreement import contradiction, strays
from impostor_jax.fit.between_views import DOUBTED, BetweenViews, between_views
from impostor_jax.fit.body import AbstractBody, Readout
from impostor_jax.fit.evidence import Terms, joined_readings, readings_of
from impostor_jax.fit.form import Form, departures_of, no_form
from impostor_jax.fit.inliers import MIN_END_TERMS, Compared, Inliers
from impostor_jax.fit.prior import prior_residuals, scale_left
from impostor_jax.fit.problem import Problem, in_coordinates
from impostor_jax.fit.result import DISAGREEING
from impostor_jax.fit.uncertainty import (
    LEAST_LEFT,
    covariance_root,
    sandwich_root,
    score_covariance,
)
from impostor_jax.numerics import product, safe_divide
from impostor_jax.sensor.across import AcrossRay


class FreeCoordinates(NamedTuple):
    """The coordinates in which an estimate is free, and what it is read by.

    Attributes:
        body: The estimate in the first view's frame, up to where it is seen.
        world: The same in the world.
        into: Coordinates of the estimate, as of `View.coordinates`, that each free one
            moves, one a row: the body's, then the sensor's scale where it has one,
            which moves none, then what poses are off by.
        num_own: How many the body's are.
        change: Derivative of the world's `readout`.
        known: Derivative of the prior's residuals.
    """

    body: AbstractBody
    world: AbstractBody
    into: Float[Array, "c t"]
    num_own: int
    change: Readout
    known: Float[Array, "p c"]


def free_coordinates(
    problem: Problem, estimate: AbstractBody, on: Inliers
) -> FreeCoordinates:
    """Draw an estimate in to where it is seen, and see how it may move.

    Args:
        problem: What was given.
        estimate: In the first view's frame.
        on: What lies on it.
    """
    prior, settings, bias = problem.prior, problem.settings, problem.bias
    is_kept = on.ends_seen | ~jnp.asarray(settings.draws_in)
    body, carried = estimate.drawn_in(is_kept, on.reach)
    basis = body.free_basis(settings.free, problem.unit, problem.unit)
    # An end that is not seen is free, though some readings beyond it may lean on it.
    # The ends are the last coordinates. A few readings do not show a bore, either.
    others = on.num_telling[: basis.shape[0] - on.ends_seen.size] >= MIN_END_TERMS
    leans = jnp.concatenate([others, on.ends_seen])
    leans = jnp.where(leans, 1, 0).astype(basis.dtype)
    into = product(basis.T * leans[None], carried)
    num_own = len(into)
    if bias.scales:
        # What the sensor shows may be larger, and no reading tells.
        into = jnp.pad(into, ((0, 1), (0, 0)))
    num_seen = len(into)
    if problem.off is not None:
        poses = jnp.eye(problem.off.size, dtype=into.dtype)
        into = jax.scipy.linalg.block_diag(into, poses)

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
        moved = body.retracted(product(basis, free[:num_own]), settings.free)
        larger = free[num_own:num_seen]
        told = in_world(moved, larger).readout(world, on.ends_seen)
        return told, prior_residuals(prior, moved, bias)

    change, known = jax.jacfwd(read)(jnp.zeros(len(into), basis.dtype))
    # What is held stays, whatever moves the place at which it is read.
    for name in filter(change.__contains__, settings.held):
        change[name] = jnp.where(settings.held[name], 0, change[name])
    return FreeCoordinates(body, world, into, num_own, change, known)


class Uncertainty(NamedTuple):
    """How sure an estimate is in its free coordinates.

    Attributes:
        root: Of their covariance.
        shares: What that is the sum of, by the names of a budget's parts.
        directions: As `covariance_root` returns them, as columns.
        is_free: Which of them the image leaves free.
        repeats: Readings that tell as much as one whose error is its own and as `sigma`
            says.
        border_chi2: By how much readings at the border pull elsewhere.
        form: Of the wall.
        between: What the views say, each against the others; None of one.
        independent: Covariance if each reading errs by itself.
    """

    root: Float[Array, "c c"]
    shares: dict[str, Float[Array, "c c"]]
    directions: Float[Array, "c c"]
    is_free: Bool[Array, " c"]
    repeats: Float[Array, ""]
    border_chi2: Float[Array, ""]
    form: Form
    between: BetweenViews | None
    independent: Float[Array, "c c"]


def uncertainty_of(
    problem: Problem,
    estimate: AbstractBody,
    told: Compared,
    on: Inliers,
    free: FreeCoordinates,
    correlated: bool,
) -> Uncertainty:
    """Covariance of an estimate, and what else its errors tell.

    Args:
        problem: What was given.
        estimate: In the first view's frame.
        told: What the views show, compared with it.
        on: What of that lies on it.
        free: Its free coordinates.
        correlated: Whether the covariance allows for correlated residuals.
    """
    views, into, terms = problem.views, free.into, told.readings.terms
    alone = _independent(problem, told, on, free)
    root, independent, variance = alone.root, alone.covariance, on.variance
    rests, departures, between = {"all": on.whitened}, None, None
    swelling = estimate.swelling(terms.gradient)
    if swelling is not None:
        counts = on.tells & ~told.readings.passing.on_cap
        given = into, root, alone.pull, on.variance
        departures = departures_of(terms.augmented, swelling, counts, *given)
        rests["form"] = jnp.where(on.inlier, departures.residual, 0)
    if not problem.is_single:
        # A wall that departs is seen otherwise from each side.
        left = [*rests.values()][-1]
        given = terms.augmented, left, on.tells, into, root, alone.of_others, variance
        between = between_views(problem, *given)
        rests["views"] = jnp.where(on.inlier, between.residual, 0)

    # In coordinates in which independent errors have a variance of 1. So are the slopes
    # of readings: their sums would round away what an image hardly tells.
    parts = {name: product(root.T, part, root) for name, part in alone.parts.items()}
    # What of that which neighbors share an explanation leaves nothing of.
    explained = dict.fromkeys(rests, jnp.zeros_like(independent))
    biases = [view.noise.bias for view in views]
    leans = any(bias.lean is not None for bias in biases)
    shares_errors = bool(
        correlated or leans or any(bias.fields or bias.scales for bias in biases)
    )
    if shares_errors:
        gradient = product(product(root.T, into), terms.gradient)
        gradient = jnp.where(on.tells[None], gradient, 0) / variance
        if correlated:
            of_rests = _of_neighbors(problem, gradient, rests)
            whole = of_rests["all"]
            parts["correlation"] = whole - parts["noise"]
            explained = {name: whole - part for name, part in of_rests.items()}
        score = gradient * (terms.weight * told.readings.follows)[None]
        scores = problem.apart(score / told.length[None])
        parts["warp"], of_scales = _of_bias(problem, scores, told, free.body)
        parts["scale"] += of_scales
        if leans:
            lean = _leaning(problem, scores, told)
            parts["alignment"] = lean[:, None] * lean[None]
    learns = any(isinstance(view.noise, AcrossRay) for view in views)
    if learns:
        doubt = product(root.T, into, _doubted(problem, estimate, told, on))
        parts["noise"] += doubt[:, None] * doubt[None]

    def sandwich() -> Float[Array, "c c"]:
        return sandwich_root(root, _sum_of(parts.values()), LEAST_LEFT)

    def wider_by(root: Float[Array, "c c"]) -> Float[Array, ""]:
        if problem.off is None:
            return _wider(root, independent)
        # At poses that are held: what these err by readings do not share.
        pulls = product(alone.information, root)[: -problem.off.size]
        held = alone.information[: len(pulls), : len(pulls)]
        held_root, *_ = covariance_root(held)
        covariance = product(held_root, held_root.T)
        return _wider(product(covariance, pulls), covariance)

    def wider_without(name: str) -> Float[Array, ""]:
        left = _sum_of(parts.values()) - explained[name]
        return wider_by(sandwich_root(root, left, LEAST_LEFT))

    whole, wider = root, jnp.ones_like(variance)
    if shares_errors or learns:
        whole = sandwich()
    if shares_errors:
        # Errors that neighbors share let a part pull harder by as much as they widen
        # the standard deviations.
        wider = wider_by(whole)
    border_chi2, repeats = alone.border_chi2 / wider, variance * wider
    if between is not None and shares_errors:
        # Those within a view: where views disagree, neighbors seem to share an error.
        within = wider_without("views")
        between = between._replace(
            chi2=between.chi2 / within, chi2_of_form=between.chi2_of_form / within
        )
    form = no_form(repeats.dtype)
    if departures is not None:
        if correlated:
            # Not all that neighbors share is an error, where a wall departs.
            wider = wider_without("form")
        form, parts["form"] = departures.told(wider)
    if between is not None:
        # What looks like another form may be poses that err.
        least = jnp.where(form.departs, DISAGREEING, DOUBTED)
        may_err = (between.chi2 >= least) | (between.chi2_of_form >= DOUBTED)
        parts["poses"] += jnp.where(may_err, between.spread, 0)
    if departures is not None or between is not None:
        whole = sandwich()
    is_stray = strays(on.inlier, told.readings.used, told.beside)
    return Uncertainty(
        root=whole,
        shares={name: product(root, part, root.T) for name, part in parts.items()},
        directions=alone.directions,
        is_free=alone.is_free,
        repeats=repeats,
        border_chi2=jnp.where(is_stray, jnp.inf, border_chi2),
        form=form,
        between=between,
        independent=independent,
    )


class _Independent(NamedTuple):
    """What an estimate's uncertainty would be if each reading erred by itself.

    Attributes:
        parts: Of the information, by the names of a budget's parts.
        information: Their sum.
        root: Of the covariance, the inverse of their sum.
        covariance: That itself.
        directions: As `covariance_root` returns them.
        is_free: Which of them the image leaves free.
        of_others: Pull of all but the readings, and what is believed of poses, on the
            free coordinates.
        pull: Of all.
        border_chi2: By how much readings at the border pull elsewhere.
    """

    parts: dict[str, Float[Array, "c c"]]
    information: Float[Array, "c c"]
    root: Float[Array, "c c"]
    covariance: Float[Array, "c c"]
    directions: Float[Array, "c c"]
    is_free: Bool[Array, " c"]
    of_others: Float[Array, " c"]
    pull: Float[Array, " c"]
    border_chi2: Float[Array, ""]


def _independent(
    problem: Problem, told: Compared, on: Inliers, free: FreeCoordinates
) -> _Independent:
    bias, into, known = problem.bias, free.into, free.known
    terms, variance = told.readings.terms, on.variance
    of_all = _products(terms, on.tells, into)
    of_border = _products(terms, on.tells & (told.beside > 0), into)
    of_edges = _products(told.edges, on.crossing, into)
    number = np.arange(len(into))
    is_scale = (number == free.num_own) & bool(bias.scales)
    is_pose = number >= free.num_own + bool(bias.scales)
    # Each is what its errors pull by, too.
    parts = {
        "noise": of_all[:-1, :-1] / variance,
        "outline": of_edges[:-1, :-1],
        "prior": product(known.T, known),
        "scale": jnp.diag(jnp.where(is_scale, 1.0, 0.0)),
        "poses": jnp.diag(jnp.where(is_pose, 1.0, 0.0)),
    }
    information = _sum_of(parts.values())
    root, directions, is_free = covariance_root(information)
    of_others = product(known.T, prior_residuals(problem.prior, free.body, bias))
    of_others += of_edges[:-1, -1] / variance
    pull = of_others + of_all[:-1, -1] / variance
    if problem.off is not None:
        off = jnp.concatenate([pose.known + pose.off for pose in problem.poses])
        pull = pull.at[-len(off) :].add(off)
    covariance = product(root, root.T)
    return _Independent(
        parts=parts,
        information=information,
        root=root,
        covariance=covariance,
        directions=directions,
        is_free=is_free,
        of_others=of_others,
        pull=pull,
        border_chi2=contradiction(of_border / variance, pull, covariance),
    )


def _products(
    terms: Terms, counts: Bool[Array, " n"], into: Float[Array, "k c"]
) -> Float[Array, "m m"]:
    """Products of some terms of Jacobian and residual, in free coordinates."""
    some = jnp.where(counts[None], terms.augmented, 0)
    return in_coordinates(product(some, some.T), into)


def _of_neighbors(
    problem: Problem,
    gradient: Float[Array, "c n"],
    rests: dict[str, Float[Array, " n"]],
) -> dict[str, Float[Array, "c c"]]:
    """Covariance of what correlated `rests` of residuals pull by, by their names."""
    slopes = problem.apart(gradient)
    left = problem.apart(jnp.stack([*rests.values()]))
    of_readings = [
        score_covariance(slope.T, rest, view.lattice)
        for view, slope, rest in zip(problem.views, slopes, left, strict=True)
        if view.lattice is not None
    ]
    return dict(zip(rests, _sum_of(of_readings), strict=True))


def _of_bias(
    problem: Problem,
    scores: Sequence[Float[Array, "c n"]],
    told: Compared,
    body: AbstractBody,
) -> tuple[Float[Array, "c c"], Float[Array, "c c"]]:
    """Covariance of sums of a score times smooth errors, and times those of a scale.

    One view's error of scale looks like another size, which is counted there. Two views
    do not agree on it: it is an error of each. Scores are per meter that the sensor
    measures, of each view's readings.
    """
    views = problem.views
    depths = problem.apart(told.readings.passing.depth * told.length)
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
    root: Float[Array, "s c"], independent: Float[Array, "s s"]
) -> Float[Array, ""]:
    """Mean factor on variances beside those of `independent` readings, at least 1."""
    variance = jnp.diagonal(independent)
    wider = safe_divide(jnp.sum(root**2, axis=1), variance)
    moves = variance > 0
    mean = jnp.sum(jnp.where(moves, wider, 0)) / jnp.sum(moves, dtype=wider.dtype)
    return jnp.maximum(mean, 1)


def _leaning(
    problem: Problem, scores: Sequence[Float[Array, "c n"]], told: Compared
) -> Float[Array, " c"]:
    """Sum of a score times a deviation of what walls lean by, in all views alike."""
    pulls = []
    views = zip(problem.views, scores, told.bodies, told.of_views, strict=True)
    for view, score, body, readings in views:
        seen = readings.passing
        # Per meter of depth, in which the lean is told.
        score = score * view.pixels.length[None]
        pulls.append(
            view.noise.bias.lean_pull(
                score, seen.depth, seen.cos_incidence, view.pixel, body.radius
            )
        )
    return jnp.sum(jnp.stack(pulls), axis=0)


def _doubted(
    problem: Problem, estimate: AbstractBody, told: Compared, on: Inliers
) -> Float[Array, " t"]:
    """Pull on the tangent coordinates where what was learned is off by a deviation."""
    noises = [
        view.noise.doubted() if isinstance(view.noise, AcrossRay) else view.noise
        for view in problem.views
    ]
    of_views = computed_once(lambda: readings_of(problem, told.bodies, noises))
    doubted = joined_readings(of_views, problem.views, estimate).terms
    terms = told.readings.terms
    pulls = doubted.gradient * doubted.residual[None]
    pulls -= terms.gradient * terms.residual[None]
    return jnp.sum(jnp.where(on.tells[None], pulls, 0), axis=1) / on.variance


def _sum_of(parts: Iterable[Float[Array, "*r c c"]]) -> Float[Array, "*r c c"]:
    return jnp.sum(jnp.stack([*parts]), axis=0)
