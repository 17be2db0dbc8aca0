"""The compiled fit: from a start to the estimate, in the first view's frame.

Each pass reads the images at the estimate, weights included, and gives the products of
all terms; a damped Gauss-Newton step follows. So evaluation and step are one pass, and
the fit ends where a step leads nowhere. The first stages blunt the outline and take a
block of readings that speaks for all; the last takes all of them.
"""

__all__ = [
    "STAGES",
    "STAGE_TOLERANCE",
    "Solution",
    "solve",
    "spread_of",
]

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from impostor_jax.device import is_processor
from impostor_jax.fit.body import AbstractBody, FreeDirections
from impostor_jax.fit.evidence import Terms, crossing_terms, reading_terms
from impostor_jax.fit.prior import prior_residuals
from impostor_jax.fit.problem import BLOCK, Problem, View, in_coordinates
from impostor_jax.fit.robust import KERNELS, robust_residual
from impostor_jax.fit.scatter import scatter_products
from impostor_jax.numerics import all_finite, eps, product, safe_divide


class Stage(NamedTuple):
    """A part of a fit.

    Attributes:
        soft: Half-chord in radii up to which the outline is blunted.
        place: Softness of the outline's place, in pixels.
        widening: Factor on the width of the robust loss.
        limit: Step at which it ends, in tens of standard deviations at
            `STAGE_TOLERANCE`.
        takes_all: Whether it takes all readings, or the block that speaks for all.
    """

    soft: float | Float[Array, ""]
    place: float | Float[Array, ""]
    widening: float | Float[Array, ""]
    limit: float | Float[Array, ""]
    takes_all: bool | Bool[Array, ""]


STAGES = (
    Stage(soft=0.3, place=1.0, widening=1.0, limit=0.5, takes_all=False),
    Stage(soft=0.1, place=1.0, widening=1.0, limit=0.3, takes_all=False),
    Stage(soft=0.1, place=0.5, widening=2.0, limit=0.2, takes_all=False),
    Stage(soft=0.0, place=0.1, widening=1.0, limit=0.2, takes_all=False),
    Stage(soft=0.0, place=0.02, widening=1.0, limit=0.02, takes_all=True),
)

STAGE_TOLERANCE = 0.2
"""Tolerance of an `Effort`, in standard deviations, for which the stages' steps are
given."""

FINE_TOLERANCE = 0.02
"""Largest one of a fit that is differentiated. Derivatives are those of the point where
it ends, and grazing readings change their form on the way: of a sphere of 44 pixels
they erred by 10 % with ten times this tolerance, and by 1e-4 with this."""

UNSETTLED = 10.0
"""Last step, in limits of the last stage, from which a fit has not converged."""

MOST_SUM = 20.0
"""Steps that one is stretched to at most, where they shrink by a ratio."""

MOST_BACK = 0.5
"""Part of a step that is taken back at most, where steps go to and fro."""

MOST_WORSE = 1.2
"""Loss after a step, over that before it, from which that is taken again, damped."""

LEAST_DAMPING = 0.1
"""Of such a step: part of the information's diagonal that is added to it."""

MOST_COARSE = 15
"""Steps of a stage but the last: on few readings some go to and fro for ever."""

RIDGE = 3e-3
"""Inverse width of the prior that keeps free coordinates in place, in their units."""

SEARCHED = 16
"""Parts that an interval with the median is divided into, three times."""


class Solution(eqx.Module):
    """An estimate in the first view's frame.

    Attributes:
        body: The estimate; the start where that is not finite.
        finite: Whether it is.
        converged: Whether the fit ended where a step leads nowhere.
        num_steps: Steps that it took.
        off: What poses are off by, as of `Problem`; None where all are exact.
    """

    body: AbstractBody
    finite: Bool[Array, ""]
    converged: Bool[Array, ""]
    num_steps: Int[Array, ""]
    off: Float[Array, "v 6"] | None


class _Estimate(NamedTuple):
    """Where a step leads from, and to.

    Attributes:
        body: In the first view's frame.
        off: As of `Solution`.
    """

    body: AbstractBody
    off: Float[Array, "v 6"] | None

    def moved(self, tangent: Float[Array, " k"], free: FreeDirections) -> "_Estimate":
        """By tangent coordinates of the body, and what poses are off by after these."""
        num_own = free.shape[0]
        body = self.body.retracted(tangent[:num_own], free)
        off = self.off
        return _Estimate(
            body, None if off is None else off + tangent[num_own:].reshape(off.shape)
        )


class _Pass(NamedTuple):
    """What a pass over the image tells at an estimate.

    Attributes:
        information: Of the free coordinates.
        pull: On these.
        basis: Tangent coordinates that one unit of each of them moves, as columns.
        loss: Of the readings.
    """

    information: Float[Array, "c c"]
    pull: Float[Array, " c"]
    basis: Float[Array, "c c"]
    loss: Float[Array, ""]

    def step(self, damping: Float[Array, ""] | float = 0.0) -> Float[Array, " c"]:
        """Damped step of Gauss and Newton, in free coordinates."""
        diagonal = jnp.diagonal(self.information)
        more = diagonal * (damping + eps(diagonal.dtype, 16)) + RIDGE**2
        damped = self.information + jnp.diag(more)
        return -jax.scipy.linalg.solve(damped, self.pull, assume_a="pos")


class _State(eqx.Module):
    """What a step hands to the next.

    Attributes:
        stage: Number of the stage.
        in_stage: Steps in it.
        count: Steps in all.
        estimate: From which the last step was taken.
        told: What its pass told.
        damping: Of that step.
        moved: Coordinates by which it moved the estimate.
        wanted: Those by which it would have without being stretched.
        left: Root mean square of `moved` in limits of the last stage; infinite before.
    """

    stage: Int[Array, ""]
    in_stage: Int[Array, ""]
    count: Int[Array, ""]
    estimate: _Estimate
    told: _Pass
    damping: Float[Array, ""]
    moved: Float[Array, " c"]
    wanted: Float[Array, " c"]
    left: Float[Array, ""]


class _Staged(optx.AbstractFixedPointSolver):
    """Steps of Levenberg and Marquardt to a fixed point, coarse ones first.

    What is iterated takes an estimate and a `Stage`, and returns where a step leads
    from there, and what the pass over the image told. A step that makes the readings'
    loss much larger is taken again, damped. One that makes it a little larger is not:
    the weights move with the estimate, so that no loss is at its minimum where it ends.

    Attributes:
        limits: Of the stages.
        max_steps: Of all of them. With half of these taken, each but the last takes one
            more.
        free: As `AbstractBody.free_directions` returns it.
    """

    limits: Float[Array, " s"]
    max_steps: int | Int[Array, ""]
    free: FreeDirections
    rtol: float = 0.0
    atol: float = 0.0
    norm: Callable[..., Any] = eqx.field(default=optx.rms_norm, static=True)

    @override
    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> _State:
        told = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), aux_struct)
        still, none = jnp.zeros_like(told.pull), jnp.zeros_like(told.loss)
        zero = jnp.zeros((), jnp.int32)
        return _State(zero, zero, zero, y, told, none, still, still, none + jnp.inf)

    @override
    def step(self, fn, y, args, options, state, tags):
        is_last = state.stage == len(STAGES) - 1
        _, told = fn(y, _stage_at(state.stage, self.limits.dtype))
        is_first = state.in_stage == 0
        # What is no number is worse, too.
        is_worse = ~is_first & ~(told.loss <= MOST_WORSE * state.told.loss)
        more = jnp.maximum(10 * state.damping, LEAST_DAMPING)
        less = jnp.where(state.damping > LEAST_DAMPING, state.damping / 10, 0)
        damping = jnp.where(is_worse, more, jnp.where(is_first, 0, less))
        estimate, told = jax.tree.map(
            partial(jnp.where, is_worse), (state.estimate, state.told), (y, told)
        )
        wanted = told.step(damping)
        # Through the weights it converges but linearly: by the secant of two steps.
        change = wanted - state.wanted
        share = safe_divide(jnp.sum(wanted * change), jnp.sum(change**2))
        has_two = is_last & ~is_first & (damping == 0) & (state.damping == 0)
        share = jnp.where(has_two, jnp.clip(share, -MOST_SUM, MOST_BACK), 0)
        moved = wanted - share * (state.moved + change)
        size = jnp.where(damping == 0, self.norm(moved), jnp.inf)
        count = state.count + 1
        is_long = (state.in_stage >= MOST_COARSE - 1) | (2 * count >= self.max_steps)
        goes_further = ((size < self.limits[state.stage]) | is_long) & ~is_last
        tangent = product(told.basis, moved)
        state = _State(
            stage=state.stage + jnp.where(goes_further, 1, 0),
            in_stage=jnp.where(goes_further, 0, state.in_stage + 1),
            count=count,
            estimate=estimate,
            told=told,
            damping=damping,
            moved=moved,
            wanted=wanted,
            left=jnp.where(is_last, size / self.limits[-1], jnp.inf),
        )
        return estimate.moved(tangent, self.free), state, told

    @override
    def terminate(self, fn, y, args, options, state, tags):
        is_last = state.stage == len(STAGES) - 1
        has_ended = is_last & (state.left < 1)
        # No estimate but one of the last stage is returned.
        is_stuck = is_last & ~has_ended & (state.in_stage > 0)
        is_stuck &= state.count >= self.max_steps
        result = optx.RESULTS.where(
            is_stuck,
            optx.RESULTS.nonlinear_max_steps_reached,
            optx.RESULTS.successful,
        )
        return has_ended | is_stuck, result

    @override
    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return y, aux, {}


def solve(problem: Problem, start: AbstractBody) -> Solution:
    """Go through the stages from a start in the first view's frame.

    Mapped over many problems it takes one after the other on a processor, where all
    would wait for the slowest.

    Derivatives:
        Of the estimate in all that was given but the start, by the implicit function
        theorem; where the fit did not converge they mean nothing.
    """
    return _followed(jax.tree.map(jnp.asarray, problem), start)


@jax.custom_jvp
def _followed(problem: Problem, start: AbstractBody) -> Solution:
    if is_processor():
        return jax.custom_batching.sequential_vmap(_through_stages)(problem, start)
    return _through_stages(problem, start)


@_followed.defjvp
def _followed_jvp(given, changes):
    """The pull of all terms is 0 where a fit ends, and stays 0.

    The products of the terms are not its derivative in the estimate: weights and
    targets move with that, too.
    """
    (problem, start), (d_problem, _) = given, changes
    problem = eqx.tree_at(
        lambda p: p.settings.tolerance,
        problem,
        jnp.minimum(problem.settings.tolerance, FINE_TOLERANCE),
    )
    solution = _followed(problem, start)
    free = problem.settings.free
    stage = _stage_at(-1, problem.unit.dtype)
    found = _Estimate(solution.body, solution.off)
    basis = _free_basis(problem, found.body)

    def estimate_at(moved: Float[Array, " c"]) -> _Estimate:
        return found.moved(product(basis, moved), free)

    def pull_at(moved: Float[Array, " c"], problem: Problem) -> Float[Array, " c"]:
        at, off = estimate_at(moved)
        problem = problem.with_poses(off)

        def told_by(view: View) -> Float[Array, "k k"]:
            own = view.own(at)
            pixels = view.pixels
            readings = reading_terms(
                pixels, own, view.noise, pixel=view.pixel, is_image=view.is_image
            )
            terms = readings.terms
            scale = _scale(problem, terms.residual[-BLOCK:], terms.weight[-BLOCK:])
            told = _products(problem, terms, scale)
            told += _of_edge(problem, view, own, stage, scale)
            told += scatter_products(
                view, problem.nominal, pixels, own, readings, scale
            )
            return view.products_told(told, at)

        total = sum(problem.of_each(told_by), _of_beliefs(problem, at))
        return product(basis.T, total[:-1, -1])

    still = jnp.zeros(len(basis), problem.unit.dtype)
    slope = jax.jacfwd(lambda moved: pull_at(moved, problem))(still)
    # Of what is held nothing pulls.
    is_held = jnp.where(jnp.all(slope == 0, axis=0), 1, 0).astype(slope.dtype)
    _, d_pull = jax.jvp(lambda p: pull_at(still, p), (problem,), (d_problem,))
    d_moved = -jnp.linalg.solve(slope + jnp.diag(is_held), d_pull)
    _, d_found = jax.jvp(estimate_at, (still,), (d_moved,))
    nothing = jax.tree.map(jax.custom_derivatives.zero_from_primal, solution)
    return solution, eqx.tree_at(
        lambda s: (s.body, s.off), nothing, tuple(d_found), is_leaf=lambda x: x is None
    )


def _through_stages(problem: Problem, start: AbstractBody) -> Solution:
    settings = problem.settings
    coarseness = jnp.asarray(settings.tolerance) / STAGE_TOLERANCE

    def led(estimate: _Estimate, stage: Stage):
        told = _told(problem.with_poses(estimate.off), estimate.body, stage)
        tangent = product(told.basis, told.step())
        return estimate.moved(tangent, settings.free), told

    begin = _Estimate(start, problem.off)
    limits = np.array([stage.limit for stage in STAGES])
    found = optx.fixed_point(
        led,
        _Staged(
            limits=jnp.asarray(limits, coarseness.dtype) * coarseness,
            max_steps=settings.max_steps,
            free=settings.free,
        ),
        begin,
        _stage_at(0, coarseness.dtype),
        has_aux=True,
        max_steps=None,
        throw=False,
    )
    finite = all_finite(found.value)
    body, off = jax.tree.map(partial(jnp.where, finite), found.value, begin)
    return Solution(
        body=body,
        finite=finite,
        converged=finite & (found.state.left < UNSETTLED),
        # Weakly typed, it would be no argument of the assessment that was prepared.
        num_steps=jnp.asarray(found.stats["num_steps"], jnp.int32),
        off=off,
    )


def _stage_at(number: int | Int[Array, ""], dtype: DTypeLike) -> Stage:
    """A stage whose numbers have one type."""
    soft, place, widening, limit, takes_all = map(np.array, zip(*STAGES, strict=True))
    return Stage(
        *(jnp.asarray(x, dtype)[number] for x in (soft, place, widening, limit)),
        takes_all=jnp.asarray(takes_all)[number],
    )


def _told(problem: Problem, body: AbstractBody, stage: Stage) -> _Pass:
    """Read the images at an estimate."""
    basis = _free_basis(problem, body)

    def told_by(view: View) -> tuple[Float[Array, "k k"], Float[Array, ""]]:
        own = view.own(body)
        of_readings, scale = _of_readings(problem, view, own, stage)
        told = of_readings + _of_edge(problem, view, own, stage, scale)
        return view.products_told(told, body), of_readings[-1, -1]

    products, losses = zip(*problem.of_each(told_by), strict=True)
    total = sum(products, _of_beliefs(problem, body))
    loss = sum(losses, jnp.zeros_like(problem.unit))
    total = in_coordinates(total, basis.T)
    return _Pass(total[:-1, :-1], total[:-1, -1], basis, loss)


def _free_basis(problem: Problem, body: AbstractBody) -> Float[Array, "c c"]:
    """Tangent coordinates that one unit of each free one moves, those of poses last."""
    own = body.free_basis(problem.settings.free, problem.unit, problem.end_unit)
    off = problem.off
    if off is None:
        return own
    return jax.scipy.linalg.block_diag(own, jnp.eye(off.size, dtype=own.dtype))


def _of_readings(
    problem: Problem, view: View, body: AbstractBody, stage: Stage
) -> tuple[Float[Array, "k k"], Float[Array, ""]]:
    """Products of a view's terms of [gradient, residual], in tangent coordinates.

    The thousands of terms enter a step only so, and are taken block by block. The first
    of these tells what the width of the robust loss is multiplied by, too. The body is
    in the view's frame.
    """
    size = view.row.shape[0]

    def with_block(
        number: Int[Array, ""], carry: tuple[Float[Array, "k k"], Float[Array, ""]]
    ) -> tuple[Float[Array, "k k"], Float[Array, ""]]:
        total, scale = carry
        # From the end, where the readings are that speak for all.
        first = size - BLOCK * (number + 1)
        cut = partial(jax.lax.dynamic_slice_in_dim, start_index=first, slice_size=BLOCK)
        pixels = jax.tree.map(cut, view.pixels)
        readings = reading_terms(
            pixels, body, view.noise, stage.soft, view.pixel, view.is_image
        )
        terms = readings.terms
        scale = jax.lax.cond(
            number == 0,
            lambda: stage.widening * _scale(problem, terms.residual, terms.weight),
            lambda: scale,
        )
        total = total + _products(problem, terms, scale)
        scatter = scatter_products(view, problem.nominal, pixels, body, readings, scale)
        return total + jnp.where(stage.takes_all, scatter, 0), scale

    num_blocks = jnp.where(stage.takes_all, view.num_blocks, 1)
    one = jnp.ones_like(problem.unit)
    blank = jnp.zeros((problem.settings.free.shape[0] + 1,) * 2, one.dtype)
    return jax.lax.fori_loop(0, num_blocks, with_block, (blank, one))


def _of_edge(
    problem: Problem,
    view: View,
    body: AbstractBody,
    stage: Stage,
    scale: Float[Array, ""],
) -> Float[Array, "k k"]:
    """The same products of the edge of the object in a view, of a body in its frame."""
    edge = crossing_terms(
        view.edge,
        body,
        view.noise,
        problem.settings.is_outline,
        stage.place,
        stage.soft > 0,
    )
    return _products(problem, edge, scale)


def _of_beliefs(problem: Problem, body: AbstractBody) -> Float[Array, "k k"]:
    """The same products of what is expected beforehand."""
    free, dtype = problem.settings.free, problem.unit.dtype

    def known(tangent: Float[Array, " c"]) -> Float[Array, " n"]:
        moved = body.retracted(tangent, free)
        return prior_residuals(problem.prior, moved, problem.bias)

    poses = problem.poses
    num_others = sum(pose.off.size for pose in poses)

    def products() -> Float[Array, "k k"]:
        still = jnp.zeros(free.shape[0], dtype)
        none = jnp.zeros((num_others, len(known(still))), dtype)
        slopes = jax.jacfwd(known)(still).T
        beliefs = jnp.concatenate([slopes, none, known(still)[None]])
        return product(beliefs, beliefs.T)

    blank = jnp.zeros((free.shape[0] + num_others + 1,) * 2, dtype)
    # Of most fits nothing is: a tenth of the time of a step.
    told = jax.lax.cond(problem.prior.tells, products, lambda: blank)
    return sum((pose.belief(free.shape[0]) for pose in poses), told)


def _products(
    problem: Problem, terms: Terms, scale: Float[Array, ""]
) -> Float[Array, "k k"]:
    """The same products of some terms, as a robust loss weighs them."""
    _, width = KERNELS[problem.kernel]
    robust, slope = jax.jvp(
        lambda r: robust_residual(r, width * scale * terms.widening, problem.kernel),
        (terms.residual,),
        (jnp.ones_like(terms.residual),),
    )
    is_last = np.arange(len(terms.augmented)) == len(terms.augmented) - 1
    weighed = jnp.where(is_last[:, None], robust[None], terms.augmented * slope[None])
    return product(weighed, weighed.T)


def _scale(
    problem: Problem, residual: Float[Array, " n"], weight: Float[Array, " n"]
) -> Float[Array, ""]:
    """What the width of the robust loss is multiplied by."""
    spread = spread_of(residual, weight > 0)
    return jnp.where(problem.settings.estimate_scale, spread, 1)


def spread_of(
    residual: Float[Array, " n"], used: Bool[Array, " n"]
) -> Float[Array, ""]:
    """Robust standard deviation of whitened residuals, at least 1; no derivative.

    Their median is looked for in ever smaller intervals: sorting 6144 values takes
    4 ms, and these sums 0.1 ms.
    """
    values = jax.lax.stop_gradient(jnp.where(used, jnp.abs(residual), 0))
    # Counted in floating point: XLA does not vectorize sums of whole numbers.
    ones = jnp.where(used, 1, 0).astype(values.dtype)
    half = jnp.sum(ones) / 2
    low = jnp.zeros_like(half)
    # No more than half of the values can be twice their mean.
    width = jnp.sum(values) / jnp.maximum(half, 1)
    places = jnp.arange(1, SEARCHED + 1, dtype=values.dtype)
    for _ in range(3):
        width = width / SEARCHED
        is_below = values[None] <= (low + width * places)[:, None]
        enough = jnp.sum(jnp.where(is_below, ones[None], 0), axis=1) >= half
        low = low + width * jnp.sum(jnp.where(enough, 0, 1)).astype(values.dtype)
    return jnp.maximum(1.4826 * (low + width), 1)
