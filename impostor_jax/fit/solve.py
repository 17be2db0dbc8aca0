"""The compiled fit: from starts to a body with its covariance.

All of it runs in the camera's frame. Several starts are solved on a part of the
readings, in one vmapped call, and where noise hides the tilt their mirror images, too.
The best, or there the best few, goes on with all readings, in stages: evaluate the
image against the estimate, which weighs each row, then minimize with the rows held.
"""

__all__ = [
    "LAST_STAGES",
    "NUM_KEPT",
    "STAGE_TOLERANCE",
    "always_true",
    "best_start",
    "evaluate",
    "solve",
    "step_units",
]

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.assess import Solution, Start, assess
from impostor_jax.fit.body import AbstractBody, SurfaceSeen
from impostor_jax.fit.evidence import (
    MAX_CROSSINGS,
    Pixels,
    crossing_rows,
    deviation,
    gather_edge,
    gather_pixels,
    joined,
    reading_rows,
)
from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.prior import Prior
from impostor_jax.fit.request import Request
from impostor_jax.fit.residuals import held, is_missed, surface_seen
from impostor_jax.fit.result import AbstractFit
from impostor_jax.fit.robust import KERNELS
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.rows import BLOCK, Kind, Rows
from impostor_jax.numerics import safe_divide
from impostor_jax.primitives.base import in_camera_frame, in_world_frame
from impostor_jax.sensor.base import AbstractDepthNoise

# Each stage: half-chord in radii up to which the outline is blunted; step at which it
# ends, in tens of deviations at `STAGE_TOLERANCE`; factor on the width of the robust
# loss; softness of the outline's place, in pixels; whether it takes all rows, or the
# block of them that speaks for all.
FIRST_STAGES = (
    (0.3, 0.5, 1.0, 1.0, 0.0),
    (0.1, 0.3, 1.0, 1.0, 0.0),
    (0.1, np.inf, 1.0, 1.0, 0.0),
)
LAST_STAGES = (
    (0.1, 0.2, 2.0, 0.5, 0.0),
    (0.0, 0.2, 1.0, 0.1, 1.0),
    (0.0, 0.02, 1.0, 0.02, 1.0),
    (0.0, np.inf, 1.0, 0.02, 1.0),
)
"""A stage without a limit on the step takes none: it only evaluates. The one before it
is repeated until that no longer moves the estimate."""

MOST_REPEATS = 40
"""Of that stage: through the weights it converges but linearly."""

MOST_TRACED_REPEATS = 6
"""The same where a fit is differentiated, which holds all of them in memory."""

SETTLED = 0.02
"""Root mean square of the coordinates that counts as no motion, as a step."""

UNSETTLED = 10.0
"""The same, in `SETTLED`, from which a fit that ends has not converged."""

MOST_RATIO = 0.95
"""Ratio of two steps up to which they are taken for a series that has a sum."""

STAGE_TOLERANCE = 0.2
"""Tolerance of an `Effort`, in deviations, for which the stages' steps are given; the
starts take it, and traced fits and frusta take no larger one."""

MISSED_LOSS = 3.0
"""Loss of a pixel that the body should cover and does not, or the reverse."""

HIDES_TILT = 0.03
"""Noise in radii from which the depth of a short object does not tell its tilt."""

SHORT = 2.0
"""Height in radii up to which an object is short."""

EXPLAINED = 1.05
"""Robust deviation of the whitened residuals that leaves no doubt of a solution."""

MOST_OUTLYING = 0.25
"""Share of the readings that may lie elsewhere without a doubt of it, if the others
scatter as they should: of 300 random scenes with 10 % of outliers, wrong ends left a
variance of 1.18 or more of the whitened residuals, right ones 1.05 in 95 of 100."""

MOST_VARIANCE = 1.1
"""Their variance up to which they do."""

MOST_MISSED = 0.01
"""Share of them whose rays may miss the body: a wall that is too thin continues, past
its outline, in a surface that noisy readings may lie on."""

MOST_HIDDEN = 0.02
"""Share, in readings, of the pixels around that may see through the body."""

NUM_KEPT = 4
"""Solutions of the starts that noise may hide the best among."""

SPREAD = 64
"""Pixels along each side of the image that tell what a solution would hide."""

MAX_FIRST_STEPS = 12
"""Step limit for the starts: all wait for the slowest, and a good one is done."""


_Tried = tuple[AbstractBody, Float[Array, "*k"], Int[Array, "*k"]]
"""Where a start leads, its cost and its steps."""

_Units = tuple[Float[Array, ""], Float[Array, ""]]
"""Sizes of a step in meters: of wall and axis, and of the ends."""

_Best = tuple[Float[Array, ""], Float[Array, ""], Start, Solution]
"""Cost of a solution, the share of the pixels around that see through it, where it
began, and the solution."""


@partial(jax.jit, static_argnames="estimate_scale")
def best_start(
    depth: Float[Array, "h w"],
    row: Int[Array, " n"],
    col: Int[Array, " n"],
    beside_row: Int[Array, " m"],
    beside_col: Int[Array, " m"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    starts: AbstractBody,
    prior: Prior,
    estimate_scale: bool,
) -> Start:
    """Solve from several starts on a part of the readings, and keep the best few.

    It takes no more of what decides what is compiled than it needs: it is the same for
    objects of all sizes, and for most of what a `Request` holds.

    Args:
        depth: In meters; 0 where there is no reading.
        row: Rows of some of the object's pixels, at most `BLOCK`; one beyond the image
            only fills up.
        col: Columns of these pixels.
        beside_row: Rows of pixels around the object.
        beside_col: Columns of pixels around the object.
        camera: The camera.
        noise: Of its readings.
        starts: (k,), in the world frame.
        prior: In the world frame.
        estimate_scale: As in `Request`.
    """
    depth = depth.astype(starts.radius.dtype)
    pixels = gather_pixels(depth, camera, row, col)
    nominal, units = step_units(pixels, noise, camera)
    beside = gather_pixels(depth, camera, beside_row, beside_col)
    in_camera = in_camera_frame(starts, camera)
    prior = prior.in_camera_frame(camera)
    always = always_true(camera)
    request = Request(
        estimate_scale=estimate_scale, kernel="pseudo_huber", max_steps=MAX_FIRST_STEPS
    )
    tolerance = jnp.asarray(STAGE_TOLERANCE, nominal.dtype)

    def tried(start: AbstractBody) -> _Tried:
        solution = _refine(
            pixels,
            None,
            start,
            FIRST_STAGES,
            jnp.zeros((), int),
            noise,
            units,
            prior,
            request,
            tolerance,
            always,
            None,
        )
        cost = _cost(pixels, solution, nominal)
        hidden = _hides(beside, noise, solution.body)
        cost = cost + MISSED_LOSS * jnp.mean(hidden.astype(cost.dtype))
        return solution.body, cost, solution.num_steps

    def left_out(start: AbstractBody) -> _Tried:
        return start, jnp.full_like(start.radius, jnp.inf), jnp.zeros((), int)

    def group(given: tuple[Bool[Array, ""], AbstractBody]) -> _Tried:
        return jax.lax.cond(given[0], jax.vmap(tried), jax.vmap(left_out), given[1])

    # The mirrored guesses only where noise hides the tilt; compiled once for both.
    is_noisy = nominal > HIDES_TILT * jnp.median(starts.radius)
    groups = jax.tree.map(lambda *a: jnp.stack(a), in_camera, in_camera.mirrored())
    ends = jax.lax.map(group, (jnp.stack([jnp.array(True), is_noisy]), groups))
    bodies, costs, steps = jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), ends)
    copies = jnp.all(starts.center == starts.center[:1], axis=1).at[0].set(False)
    counts = jnp.concatenate([~copies, ~copies & is_noisy])

    def keep(costs: Float[Array, " k"], _):
        best = jnp.argmin(costs)
        body = jax.tree.map(lambda field: field[best], bodies)
        apart = body.distance(bodies)
        agreeing = counts & (apart < jnp.maximum(nominal, body.radius / 50))
        start = Start(
            body=in_world_frame(body, camera),
            is_worth=is_noisy & jnp.isfinite(costs[best]),
            num_steps=steps[best],
            num_tried=jnp.sum(counts),
            num_agreeing=jnp.maximum(jnp.sum(agreeing), 1),
        )
        return jnp.where(apart < 3 * nominal, jnp.inf, costs), start

    _, kept = jax.lax.scan(keep, costs, length=NUM_KEPT)
    return eqx.tree_at(lambda k: k.is_worth, kept, kept.is_worth.at[0].set(True))


@partial(jax.jit, static_argnames="request")
def solve(
    depth: Float[Array, "h w"],
    mask: Bool[Array, "h w"],
    row: Int[Array, " n"],
    col: Int[Array, " n"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    start: Start,
    prior: Prior,
    request: Request,
    tolerance: Float[Array, ""],
    is_far: Bool[Array, ""],
) -> tuple[AbstractFit, Bool[Array, ""]]:
    """Fit to the given pixels; the others only show where the object stops.

    Args:
        depth: In meters; 0 where there is no reading.
        mask: Pixels of the object.
        row: Rows of the object's pixels, as `pixel_indices` orders them; one beyond the
            image only fills up.
        col: Columns of the object's pixels.
        camera: The camera.
        noise: Of its readings.
        start: Where to begin, (k,); the end that explains the readings best is kept.
        prior: In the world frame.
        request: What is asked for.
        tolerance: Of an `Effort`, in deviations.
        is_far: Whether the start is a guess and not the best of several solutions.

    Returns:
        The fit, and whether it explains the image so well that no other start could do
        better.
    """
    depth = depth.astype(start.body.radius.dtype)
    pixels = gather_pixels(depth, camera, row, col)
    edge = gather_edge(depth, mask, camera, row, col)
    nominal, units = step_units(pixels, noise, camera)
    prior = prior.in_camera_frame(camera)
    always = always_true(camera)
    num_blocks = None
    if not request.is_traced:
        num_pixels = jnp.sum(row < depth.shape[0], dtype=jnp.int32)
        num_blocks = -(-(num_pixels + MAX_CROSSINGS) // BLOCK)

    most = MOST_TRACED_REPEATS if request.is_traced else MOST_REPEATS
    repeated = (LAST_STAGES[-2],) * most

    @jax.jit
    def solution_from(body: AbstractBody) -> Solution:
        return _refine(
            pixels,
            edge,
            in_camera_frame(body, camera),
            (*FIRST_STAGES[:-1], *LAST_STAGES[:-2], *repeated, LAST_STAGES[-1]),
            # An array: a fit is compiled once for both.
            jnp.where(is_far, 0, len(FIRST_STAGES) - 1),
            noise,
            units,
            prior,
            request,
            tolerance,
            always,
            num_blocks,
        )

    around, each = _spread_pixels(depth, mask, camera)
    count = jnp.maximum(jnp.sum(pixels.depth > 0), 1).astype(nominal.dtype)
    share = MISSED_LOSS * each / count

    def try_from(best: _Best, begin: Start) -> _Best:
        solution = solution_from(begin.body)
        cost = _cost(pixels, solution, nominal)
        hidden = _hides(around, noise, solution.body)
        num_hidden = jnp.sum(hidden.astype(cost.dtype))
        cost = cost + share * num_hidden
        found = cost, num_hidden * each / count, begin, solution
        return jax.tree.map(partial(jnp.where, cost <= best[0]), found, best)

    def unless_explained(best: _Best, begin: Start):
        # A failed solution, whose scale is no number, explains nothing.
        needed = begin.is_worth & ~(best[-1].scale <= EXPLAINED)
        return jax.lax.cond(needed, try_from, lambda b, _: b, best, begin), None

    first = jax.tree.map(lambda field: field[0], start)
    blank = _zeros_like_result(solution_from, first.body)
    infinite = jnp.full_like(nominal, jnp.inf)
    blank = eqx.tree_at(lambda s: s.scale, blank, infinite)
    worst = infinite, infinite, first, blank
    best, _ = jax.lax.scan(unless_explained, worst, start)
    _, hidden, start, solution = best
    fit = assess(
        start,
        solution,
        pixels,
        row,
        col,
        camera,
        units[0],
        prior,
        request,
        always,
        mask,
    )
    # Noise may hide which of two tilts is the true one.
    body = solution.body
    is_clear = nominal <= HIDES_TILT * body.radius
    if isinstance(body, RoundBody):
        is_clear |= body.height > SHORT * body.radius
    is_clear &= fit.success & (hidden <= MOST_HIDDEN)
    return fit, is_clear & _explains(pixels, solution)


def always_true(camera: PinholeCamera) -> Bool[Array, ""]:
    """True, as `residuals` needs it: known to the run alone, and mapped by no fit."""
    return jnp.asarray(camera.fx) > 0


def _zeros_like_result(function: Callable[..., Any], *arguments: Any) -> Any:
    """Zeros of the shapes that a function returns, to begin a loop with."""
    shapes = jax.eval_shape(function, *arguments)
    return jax.tree.map(lambda field: jnp.zeros(field.shape, field.dtype), shapes)


def step_units(
    pixels: Pixels, noise: AbstractDepthNoise, camera: PinholeCamera
) -> tuple[Float[Array, ""], _Units]:
    """Typical deviation of a reading, and ten of positions that all readings share.

    The ends are known to part of a pixel if not by the readings of a cap.
    """
    used = pixels.depth > 0
    count = jnp.maximum(jnp.sum(used), 1).astype(pixels.depth.dtype)
    sigma = deviation(noise, pixels.depth, jnp.ones_like(pixels.depth))
    nominal = count / jnp.maximum(jnp.sum(jnp.where(used, 1 / sigma, 0)), 1e-6)
    unit = 10 * nominal / jnp.sqrt(count)
    footprint = jnp.sum(pixels.depth) / count / jnp.minimum(camera.fx, camera.fy)
    return nominal, (unit, jnp.maximum(unit, footprint / 20))


def _refine(
    pixels: Pixels,
    edge: tuple[Pixels, Bool[Array, "5 m"]] | None,
    start: AbstractBody,
    stages: tuple[tuple[float, ...], ...],
    first_stage: Int[Array, ""],
    noise: AbstractDepthNoise,
    units: _Units,
    prior: Prior,
    request: Request,
    tolerance: Float[Array, ""],
    always: Bool[Array, ""],
    num_blocks: Int[Array, ""] | None,
) -> Solution:
    """Go through the stages, from the first one, beginning at one start."""
    # Here, since optimistix takes 0.1 s to import, and a loaded program does without.
    from impostor_jax.fit.minimize import minimize

    unit = units[0]
    dtype = unit.dtype
    _, width = KERNELS[request.kernel]
    step = tolerance / STAGE_TOLERANCE
    # Traced once, for its shapes and for its value.
    evaluated = jax.jit(partial(evaluate, pixels, edge, noise, request.is_outline))

    def stage(carry: Solution, given: Float[Array, "5"]) -> Solution:
        soft, limit, widening, place, takes_all = given
        only = jnp.isinf(limit)
        rows, seen, scale = evaluated(carry.body, soft, place, always)
        chart = Chart.around(carry.body, *units, request.fixed)
        blocks = None
        if num_blocks is not None:
            blocks = jnp.where(only, 0, jnp.where(takes_all > 0, num_blocks, 1))
        kernel_width = width * widening
        if request.estimate_scale:
            kernel_width = kernel_width * scale
        vector, converged, steps = minimize(
            chart,
            rows,
            prior,
            kernel_width,
            request,
            limit * step,
            soft > 0,
            always,
            blocks,
        )
        # Steps that shrink by a ratio add up to more than the last of them; those that
        # go to and fro do not.
        along = jnp.sum(vector * carry.moved)
        ratio = safe_divide(along, jnp.sum(carry.moved**2))
        ratio = jnp.clip(ratio, 0, MOST_RATIO)
        left = jnp.sqrt(jnp.mean(vector**2)) * jnp.maximum(ratio / (1 - ratio), 1)
        has_settled = carry.left < UNSETTLED * SETTLED * step
        return Solution(
            body=chart.body(jnp.where(only, 0, vector)),
            rows=rows,
            seen=seen,
            scale=scale,
            converged=jnp.where(only, carry.converged & has_settled, converged),
            num_steps=carry.num_steps + steps,
            moved=vector,
            left=jnp.where(only, 0, left),
        )

    def unless_settled(carry: Solution, given: tuple[Float[Array, "5"], Array, Array]):
        its, repeats, is_before = given
        left_out = is_before | (repeats & (carry.left < SETTLED * step))
        return jax.lax.cond(left_out, lambda c, _: c, stage, carry, its), None

    rows, seen, scale = _zeros_like_result(evaluated, start, unit, unit, always)
    begin = Solution(
        body=start,
        rows=rows,
        seen=seen,
        scale=scale,
        converged=jnp.zeros((), bool),
        num_steps=jnp.zeros((), int),
        moved=jnp.zeros(Chart.around(start, *units, request.fixed).size, dtype),
        left=jnp.full_like(scale, jnp.inf),
    )
    repeats = np.array([stage == last for last, stage in pairwise((None, *stages))])
    is_before = jnp.arange(len(stages)) < first_stage
    given = (jnp.array(stages, dtype), jnp.asarray(repeats), is_before)
    refined, _ = jax.lax.scan(unless_settled, begin, given)
    return refined


def evaluate(
    pixels: Pixels,
    edge: tuple[Pixels, Bool[Array, "5 m"]] | None,
    noise: AbstractDepthNoise,
    is_outline: bool,
    body: AbstractBody,
    soft: Float[Array, ""],
    place: Float[Array, ""],
    always: bool | Bool[Array, ""] = True,
) -> tuple[Rows, SurfaceSeen, Float[Array, ""]]:
    """What an image says, evaluated at an estimate.

    Args:
        pixels: Pixels of the object.
        edge: As `gather_edge` returns it; None to leave it out.
        noise: Of the readings.
        is_outline: Whether the mask's edge is the silhouette.
        body: The estimate, in the camera frame.
        soft: Half-chord in radii up to which the outline is blunted.
        place: Softness of the outline's place, in pixels.
        always: As in `held`.

    Returns:
        Rows, readings first; what the readings' rays see; and the robust deviation of
        the whitened residuals, at least 1.
    """

    def read() -> tuple[SurfaceSeen, Rows]:
        seen = surface_seen(pixels.direction, body, body.radius / 100)
        return seen, reading_rows(pixels, seen, noise, soft * body.radius)

    seen, rows = held(always, read)
    whitened = jnp.abs(seen.depth - pixels.depth) * rows.weight
    scale = jnp.maximum(1.4826 * _median(whitened, pixels.depth > 0), 1)
    if edge is not None:
        crossings = held(
            always,
            partial(crossing_rows, edge, body, noise, is_outline, place, always),
        )
        rows = joined(rows, crossings)
    return rows, seen, scale


def _median(values: Float[Array, " n"], used: Bool[Array, " n"]) -> Float[Array, ""]:
    """Median of the nonnegative values that are used, by bisection.

    Sorting 6144 values takes 4 ms, and these sums 0.1 ms. It carries no derivative.
    """
    values = jax.lax.stop_gradient(jnp.where(used, values, 0))
    # Counted in floating point: XLA does not vectorize sums of whole numbers.
    ones = jnp.where(used, 1, 0).astype(values.dtype)
    half = jnp.sum(ones) / 2
    # No more than half of the values can be twice their mean.
    highest = jnp.sum(values) / jnp.maximum(half, 1)

    def halve(_, bounds: tuple[Float[Array, ""], Float[Array, ""]]):
        low, high = bounds
        middle = (low + high) / 2
        enough = jnp.sum(jnp.where(values <= middle, ones, 0)) >= half
        return jnp.where(enough, low, middle), jnp.where(enough, middle, high)

    _, high = jax.lax.fori_loop(0, 20, halve, (jnp.zeros_like(highest), highest))
    return high


def _cost(
    pixels: Pixels, tried: Solution, nominal: Float[Array, ""]
) -> Float[Array, ""]:
    """How badly a body explains the readings: mean log loss of their residuals.

    Its logarithm compares good with better and counts a gross error like any other. As
    in a likelihood the logarithm of each deviation, in units of the `nominal` one, is a
    part of it: a plane that all rays graze would otherwise excuse any reading.
    """
    seen, weight = tried.seen, tried.rows.weight[: pixels.depth.shape[0]]
    whitened = (seen.depth - pixels.depth) * weight
    # A pixel of the object that the body does not cover is as wrong as can be.
    missed_loss = jnp.where(is_missed(seen), MISSED_LOSS, 0)
    loss = jnp.log1p((whitened / 2) ** 2) + missed_loss
    # A reading without weight costs as much as a pixel that is missed.
    loss = loss - jnp.log(jnp.maximum(weight * nominal, np.exp(-MISSED_LOSS)))
    used = pixels.depth > 0
    count = jnp.maximum(jnp.sum(used), 1).astype(loss.dtype)
    cost = jnp.sum(jnp.where(used, loss, 0)) / count
    # Readings without weight would let a body pass that is made of no numbers.
    leaves = jax.tree.leaves(tried.body)
    numbers = jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in leaves]).all()
    return jnp.where(numbers & jnp.isfinite(cost), cost, jnp.inf)


def _explains(pixels: Pixels, solution: Solution) -> Bool[Array, ""]:
    """Whether the readings scatter around the body as the sensor says."""
    seen, num = solution.seen, pixels.depth.shape[0]
    squares = ((seen.depth - pixels.depth) * solution.rows.weight[:num]) ** 2
    # What grazes is compared otherwise.
    compared = (pixels.depth > 0) & (solution.rows.kind[:num] == Kind.DEPTH)
    near = compared & (squares < (3 * solution.scale) ** 2)
    near &= ~(seen.on_cap & (seen.cap_distance > 1.05))
    num_near = jnp.sum(near, dtype=squares.dtype)
    variance = jnp.sum(jnp.where(near, squares, 0)) / jnp.maximum(num_near, 1)
    many = num_near >= (1 - MOST_OUTLYING) * jnp.sum(compared, dtype=squares.dtype)
    missed = (pixels.depth > 0) & (squares < (3 * solution.scale) ** 2)
    num_missed = jnp.sum(missed & is_missed(seen), dtype=squares.dtype)
    return many & (variance <= MOST_VARIANCE) & (num_missed <= MOST_MISSED * num_near)


def _spread_pixels(
    depth: Float[Array, "h w"], mask: Bool[Array, "h w"], camera: PinholeCamera
) -> tuple[Pixels, float]:
    """Pixels all over the image off the object, and how many each stands for."""
    row = np.linspace(0, camera.height - 1, SPREAD).astype(int)
    col = np.linspace(0, camera.width - 1, SPREAD).astype(int)
    row, col = map(np.ravel, np.meshgrid(row, col, indexing="ij"))
    pixels = gather_pixels(depth, camera, jnp.asarray(row), jnp.asarray(col))
    off = jnp.where(mask[row, col], 0, pixels.depth)
    each = camera.height * camera.width / SPREAD**2
    return eqx.tree_at(lambda p: p.depth, pixels, off), each


def _hides(
    beside: Pixels, noise: AbstractDepthNoise, body: AbstractBody
) -> Bool[Array, " n"]:
    """Which pixels beside the object see what the body would hide."""
    seen = surface_seen(beside.direction, body, body.radius / 100)
    sigma = noise.sigma(seen.depth, seen.cos_incidence)
    return body.covers(seen) & (beside.depth > seen.depth + 5 * sigma)
