"""The compiled fit: from starts to a cylinder with its covariance.

All of it runs in the camera's frame. Several starts are solved on a part of the
readings, in one vmapped call, and where noise hides the tilt their mirror images, too.
The best, or there the best few, goes on with all readings, in stages: evaluate the
image against the estimate, which weighs each row, then minimize with the rows held.
"""

__all__ = ["NUM_KEPT", "best_start", "solve"]

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.assess import Solution, Start, assess
from impostor_jax.fit.evidence import (
    Pixels,
    crossing_rows,
    gather_edge,
    gather_pixels,
    joined,
    reading_rows,
)
from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.prior import Prior, prior_residuals
from impostor_jax.fit.request import Request
from impostor_jax.fit.residuals import Kind, Rows, residuals, surface_seen
from impostor_jax.fit.result import FitResult
from impostor_jax.fit.robust import KERNELS, robust_residual
from impostor_jax.numerics import eps
from impostor_jax.primitives.base import in_camera_frame, in_world_frame
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.sensor.base import AbstractDepthNoise

START_READINGS = 512
"""Readings that the starts are solved on, evenly spread over the object."""

# Each stage: half-chord in radii up to which the outline is blunted; step at which it
# ends, in tens of deviations; factor on the width of the robust loss; softness of the
# outline's place, in pixels.
FIRST_STAGES = ((0.3, 0.5, 1.0, 1.0), (0.1, 0.3, 1.0, 1.0), (0.1, np.inf, 1.0, 1.0))
LAST_STAGES = (
    (0.1, 0.2, 2.0, 0.5),
    (0.0, 0.2, 1.0, 0.1),
    *((0.0, 0.02, 1.0, 0.02),) * 6,
    (0.0, np.inf, 1.0, 0.02),
)
"""A stage without a limit on the step takes none: it only evaluates. One that repeats
another is left out once that no longer moves the estimate."""

SETTLED = 0.02
"""Root mean square of the coordinates that counts as no motion: a fifth of a
deviation."""

SQUARE_WIDTH = 4.0
"""Factor on the width of the robust loss where readings are compared in squares."""

FIRST_END_WIDTH = 20.0
"""The same for ends that may still be pixels off."""

RIDGE = 3e-3
"""Inverse width of the prior that keeps free coordinates in place, in scaled units."""

MISSED_LOSS = 3.0
"""Loss of a pixel that the cylinder should cover and does not, or the reverse."""

HIDES_TILT = 0.03
"""Noise in radii from which the depth of a short object does not tell its tilt."""

EXPLAINED = 1.05
"""Robust deviation of the whitened residuals that leaves no doubt of a solution."""

NUM_KEPT = 4
"""Solutions of the starts that noise may hide the best among."""

SPREAD = 64
"""Pixels along each side of the image that tell what a solution would hide."""

MAX_STEPS = 50
"""Step limit of the solver in a stage."""

MAX_FIRST_STEPS = 12
"""The same for the starts: all of them wait for the slowest, and a good one is done."""


_Tried = tuple[Cylinder, Float[Array, "*k"], Int[Array, "*k"]]
"""Where a start leads, its cost and its steps."""

_Best = tuple[Float[Array, ""], Start, Solution]
"""Cost of a solution, where it began, and the solution."""


@partial(jax.jit, static_argnames="request")
def best_start(
    depth: Float[Array, "h w"],
    row: Int[Array, " n"],
    col: Int[Array, " n"],
    beside_row: Int[Array, " m"],
    beside_col: Int[Array, " m"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    starts: Cylinder,
    prior: Prior,
    request: Request,
) -> Start:
    """Solve from several starts on a part of the readings, and keep the best few.

    Args:
        depth: In meters; 0 where there is no reading.
        row: Rows of the object's pixels; those beyond the image come last.
        col: Columns of the object's pixels.
        beside_row: Rows of pixels around the object.
        beside_col: Columns of pixels around the object.
        camera: The camera.
        noise: Of its readings.
        starts: (k,), in the world frame.
        prior: In the world frame.
        request: What is asked for.
    """
    depth = depth.astype(starts.radius.dtype)
    size = min(START_READINGS, row.shape[0])
    count = jnp.sum(row < camera.height)
    some = jnp.arange(size) * jnp.maximum(count, size) // size
    pixels = gather_pixels(depth, camera, row[some], col[some])
    nominal, unit = _units(pixels, noise)
    beside = gather_pixels(depth, camera, beside_row, beside_col)
    in_camera = in_camera_frame(starts, camera)
    prior = prior.in_camera_frame(camera)
    always = _always(camera)

    def tried(start: Cylinder) -> _Tried:
        solution = _refine(
            pixels,
            None,
            start,
            FIRST_STAGES,
            "pseudo_huber",
            noise,
            unit,
            prior,
            request,
            always,
        )
        cost = _cost(pixels, solution, nominal)
        hidden = _hides(beside, noise, solution.cylinder)
        cost = cost + MISSED_LOSS * jnp.mean(hidden.astype(cost.dtype))
        return solution.cylinder, cost, solution.num_steps

    def left_out(start: Cylinder) -> _Tried:
        return start, jnp.full_like(start.radius, jnp.inf), jnp.zeros((), int)

    def group(given: tuple[Bool[Array, ""], Cylinder]) -> _Tried:
        return jax.lax.cond(given[0], jax.vmap(tried), jax.vmap(left_out), given[1])

    # The mirrored guesses only where noise hides the tilt; compiled once for both.
    is_noisy = nominal > HIDES_TILT * jnp.median(starts.radius)
    groups = jax.tree.map(lambda *a: jnp.stack(a), in_camera, _mirrored(in_camera))
    ends = jax.lax.map(group, (jnp.stack([jnp.array(True), is_noisy]), groups))
    cylinders, costs, steps = jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), ends)
    copies = jnp.all(starts.center == starts.center[:1], axis=1).at[0].set(False)
    counts = jnp.concatenate([~copies, ~copies & is_noisy])

    def keep(costs: Float[Array, " k"], _):
        best = jnp.argmin(costs)
        cylinder = jax.tree.map(lambda field: field[best], cylinders)
        apart = _distance(cylinders, cylinder)
        agreeing = counts & (apart < jnp.maximum(nominal, cylinder.radius / 50))
        start = Start(
            cylinder=in_world_frame(cylinder, camera),
            is_worth=is_noisy & jnp.isfinite(costs[best]),
            num_steps=steps[best],
            num_tried=jnp.sum(counts),
            num_agreeing=jnp.maximum(jnp.sum(agreeing), 1),
        )
        return jnp.where(apart < 3 * nominal, jnp.inf, costs), start

    _, kept = jax.lax.scan(keep, costs, length=NUM_KEPT)
    return eqx.tree_at(lambda k: k.is_worth, kept, kept.is_worth.at[0].set(True))


@partial(jax.jit, static_argnames=("request", "is_far"))
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
    is_far: bool,
) -> FitResult:
    """Fit to the given pixels; the others only show where the object stops.

    Args:
        depth: In meters; 0 where there is no reading.
        mask: Pixels of the object.
        row: Rows of the object's pixels; one beyond the image only fills up.
        col: Columns of the object's pixels.
        camera: The camera.
        noise: Of its readings.
        start: Where to begin, (k,); the end that explains the readings best is kept.
        prior: In the world frame.
        request: What is asked for.
        is_far: Whether the start is a guess and not the best of several solutions.
    """
    depth = depth.astype(start.cylinder.radius.dtype)
    pixels = gather_pixels(depth, camera, row, col)
    edge = gather_edge(depth, mask, camera, row, col)
    nominal, unit = _units(pixels, noise)
    prior = prior.in_camera_frame(camera)
    always = _always(camera)

    def solution_from(cylinder: Cylinder) -> Solution:
        return _refine(
            pixels,
            edge,
            in_camera_frame(cylinder, camera),
            (*FIRST_STAGES[:-1], *LAST_STAGES) if is_far else LAST_STAGES,
            request.kernel,
            noise,
            unit,
            prior,
            request,
            always,
        )

    around, each = _spread_pixels(depth, mask, camera)
    count = jnp.maximum(jnp.sum(pixels.depth > 0), 1).astype(unit.dtype)
    share = MISSED_LOSS * each / count

    def try_from(best: _Best, begin: Start) -> _Best:
        solution = solution_from(begin.cylinder)
        cost = _cost(pixels, solution, nominal)
        hidden = _hides(around, noise, solution.cylinder)
        cost = cost + share * jnp.sum(hidden.astype(cost.dtype))
        found = cost, begin, solution
        return jax.tree.map(partial(jnp.where, cost <= best[0]), found, best)

    def unless_explained(best: _Best, begin: Start):
        # A failed solution, whose scale is no number, explains nothing.
        needed = begin.is_worth & ~(best[2].scale <= EXPLAINED)
        return jax.lax.cond(needed, try_from, lambda b, _: b, best, begin), None

    first = jax.tree.map(lambda field: field[0], start)
    blank = _zeros_like_result(solution_from, first.cylinder)
    infinite = jnp.full_like(unit, jnp.inf)
    blank = eqx.tree_at(lambda s: s.scale, blank, infinite)
    worst = infinite, first, blank
    (_, start, solution), _ = jax.lax.scan(unless_explained, worst, start)
    return assess(
        start, solution, pixels, row, col, camera, unit, prior, request, always
    )


def _always(camera: PinholeCamera) -> Bool[Array, ""]:
    """True, as `residuals` needs it: known to the run alone, and mapped by no fit."""
    return jnp.asarray(camera.fx) > 0


def _zeros_like_result(function: Callable[..., Any], *arguments: Any) -> Any:
    """Zeros of the shapes that a function returns, to begin a loop with."""
    shapes = jax.eval_shape(function, *arguments)
    return jax.tree.map(lambda field: jnp.zeros(field.shape, field.dtype), shapes)


def _units(
    pixels: Pixels, noise: AbstractDepthNoise
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Typical deviation of a reading, and ten of a position that all readings share."""
    used = pixels.depth > 0
    count = jnp.maximum(jnp.sum(used), 1).astype(pixels.depth.dtype)
    sigma = noise.sigma(pixels.depth, jnp.ones_like(pixels.depth))
    nominal = count / jnp.maximum(jnp.sum(jnp.where(used, 1 / sigma, 0)), 1e-6)
    return nominal, 10 * nominal / jnp.sqrt(count)


def _refine(
    pixels: Pixels,
    edge: tuple[Pixels, Bool[Array, "5 m"]] | None,
    start: Cylinder,
    stages: tuple[tuple[float, ...], ...],
    kernel: str,
    noise: AbstractDepthNoise,
    unit: Float[Array, ""],
    prior: Prior,
    request: Request,
    always: Bool[Array, ""],
) -> Solution:
    """Go through the stages from one start."""
    dtype = unit.dtype
    used = pixels.depth > 0
    _, width = KERNELS[kernel]
    max_steps = MAX_FIRST_STEPS if edge is None else MAX_STEPS

    def evaluate(cylinder: Cylinder, soft: Float[Array, ""], place: Float[Array, ""]):
        seen = surface_seen(pixels.direction, cylinder, cylinder.radius / 100)
        rows = reading_rows(pixels, seen, noise, soft * cylinder.radius)
        whitened = jnp.abs(seen.depth - pixels.depth) * rows.weight
        scale = jnp.maximum(1.4826 * _median(whitened, used), 1)
        if edge is not None:
            crossings = crossing_rows(edge, cylinder, noise, request.is_outline, place)
            rows = joined(rows, crossings)
        return rows, seen, scale

    def stage(carry: Solution, effort: Float[Array, "4"]) -> Solution:
        soft, tolerance, widening, place = effort
        only = jnp.isinf(tolerance)
        rows, seen, scale = evaluate(carry.cylinder, soft, place)
        chart = Chart.around(carry.cylinder, unit, request.fixed)
        kernel_width = width * widening
        if request.estimate_scale:
            kernel_width = kernel_width * scale
        vector, converged, steps = _minimize(
            chart,
            rows,
            prior,
            kernel_width,
            kernel,
            tolerance,
            soft > 0,
            max_steps,
            always,
        )
        return Solution(
            cylinder=chart.cylinder(jnp.where(only, 0, vector)),
            rows=rows,
            seen=seen,
            scale=scale,
            converged=jnp.where(only, carry.converged, converged),
            num_steps=carry.num_steps + steps,
            moved=jnp.where(only, 0, jnp.sqrt(jnp.mean(vector**2))),
        )

    def unless_settled(carry: Solution, given: tuple[Float[Array, "4"], Array]):
        effort, repeats = given
        settled = repeats & (carry.moved < SETTLED)
        return jax.lax.cond(settled, lambda c, _: c, stage, carry, effort), None

    rows, seen, scale = _zeros_like_result(evaluate, start, unit, unit)
    begin = Solution(
        cylinder=start,
        rows=rows,
        seen=seen,
        scale=scale,
        converged=jnp.zeros((), bool),
        num_steps=jnp.zeros((), int),
        moved=jnp.full_like(scale, jnp.inf),
    )
    repeats = np.array([stage == last for last, stage in pairwise((None, *stages))])
    given = (jnp.array(stages, dtype), jnp.asarray(repeats))
    refined, _ = jax.lax.scan(unless_settled, begin, given)
    return refined


def _median(values: Float[Array, " n"], used: Bool[Array, " n"]) -> Float[Array, ""]:
    """Median of the nonnegative values that are used, by bisection.

    Sorting 6144 values takes 4 ms, and these sums 0.1 ms. It carries no derivative.
    """
    values = jax.lax.stop_gradient(jnp.where(used, values, 0))
    half = (jnp.sum(used) + 1) // 2
    highest = jnp.max(values)

    def halve(_, bounds: tuple[Float[Array, ""], Float[Array, ""]]):
        low, high = bounds
        middle = (low + high) / 2
        enough = jnp.sum(used & (values <= middle)) >= half
        return jnp.where(enough, low, middle), jnp.where(enough, middle, high)

    _, high = jax.lax.fori_loop(0, 30, halve, (jnp.zeros_like(highest), highest))
    return high


class _Problem(eqx.Module):
    """A robust least-squares problem in a chart's coordinates."""

    chart: Chart
    rows: Rows
    prior: Prior
    width: Float[Array, " n"]
    always: Bool[Array, ""]
    kernel: str = eqx.field(static=True)


def _triangle(
    vector: Float[Array, " n"], problem: _Problem
) -> tuple[Float[Array, " m"], Float[Array, "m n"]]:
    """Residual and Jacobian, reduced to the triangle of their QR decomposition.

    The thousands of rows enter a solver only through J^T J, J^T r and r^T r. Any
    residual with the same products has the same loss, gradient and steps, and the last
    column of the triangle R of [J r] = Q R is the shortest. So the solver carries
    vectors of eight numbers.
    """
    cylinder = problem.chart.cylinder(vector)
    change = jax.jacfwd(lambda v: _parameters(problem.chart.cylinder(v)))(vector)
    whitened, gradient = residuals(problem.rows, cylinder, problem.always)
    robust, slope = jax.jvp(
        lambda r: robust_residual(r, problem.width, problem.kernel),
        (whitened,),
        (jnp.ones_like(whitened),),
    )
    jacobian = jnp.matmul(change.T, gradient, precision="highest") * slope[None]
    known = prior_residuals(problem.prior, cylinder)
    of_known = jax.jacfwd(
        lambda v: prior_residuals(problem.prior, problem.chart.cylinder(v))
    )(vector)
    # A prior three thousand deviations wide keeps the triangle regular where the image
    # leaves a coordinate free.
    ridge = RIDGE * jnp.eye(vector.shape[0], dtype=vector.dtype)
    full = jnp.concatenate(
        [
            jnp.concatenate([jacobian, of_known.T, ridge], axis=1),
            jnp.concatenate([robust, known, RIDGE * vector])[None],
        ]
    )
    products = jnp.matmul(full, full.T, precision="highest")
    # Rounding must not make a pivot negative. As rows without a residual these damp a
    # step, by a millionth, and move no minimum.
    diagonal = jnp.diagonal(products) * eps(vector.dtype, 16)
    products = products + jnp.diag(diagonal.at[-1].add(RIDGE**2))
    lower = jnp.linalg.cholesky(products)
    return lower[-1], lower[:-1].T


def _parameters(cylinder: Cylinder) -> Float[Array, "8"]:
    sizes = jnp.stack([cylinder.radius, cylinder.height])
    return jnp.concatenate([cylinder.center, cylinder.axis, sizes])


@jax.custom_jvp
def _reduced(vector: Float[Array, " n"], problem: _Problem) -> Float[Array, " m"]:
    """Residual of `_triangle`, whose Jacobian in the vector is that of `_triangle`."""
    return _triangle(vector, problem)[0]


@partial(_reduced.defjvp, symbolic_zeros=True)
def _reduced_jvp(primals, tangents):
    (vector, problem), (d_vector, d_problem) = primals, tangents
    residual, jacobian = _triangle(vector, problem)
    # The solver is differentiated by the implicit function theorem, through the
    # gradient J^T r, whose own derivatives pass through `_triangle`.
    assert all(isinstance(t, SymbolicZero) for t in jax.tree.leaves(d_problem))
    change = jnp.zeros_like(residual)
    if not isinstance(d_vector, SymbolicZero):
        change = jnp.matmul(jacobian, d_vector, precision="highest")
    return residual, change


def _minimize(
    chart: Chart,
    rows: Rows,
    prior: Prior,
    width: Float[Array, ""],
    kernel: str,
    tolerance: Float[Array, ""],
    is_first: Bool[Array, ""],
    max_steps: int,
    always: Bool[Array, ""],
) -> tuple[Float[Array, " n"], Bool[Array, ""], Int[Array, ""]]:
    """Levenberg-Marquardt in the chart's coordinates, from its reference."""
    # The error of a square is skewed, and a loss that bends early would be biased.
    # The first height may be pixels off.
    end_width = jnp.where(is_first, FIRST_END_WIDTH, 1.0)
    row_width = width * jnp.where(
        rows.kind == Kind.SQUARE,
        SQUARE_WIDTH,
        jnp.where(rows.kind == Kind.END, end_width, 1.0),
    )
    problem = _Problem(chart, rows, prior, row_width, always, kernel)
    solver = optx.LevenbergMarquardt(
        rtol=1e-5,
        # Only compared with: it may be traced.
        atol=tolerance,  # pyright: ignore[reportArgumentType]
        norm=optx.rms_norm,
        linear_solver=lx.Normal(lx.Cholesky()),
    )
    # On a GPU the default precision of a product is that of 10-bit mantissas.
    with jax.default_matmul_precision("highest"):
        solution = optx.least_squares(
            _reduced,
            solver,
            jnp.zeros(chart.size, width.dtype),
            args=problem,
            max_steps=max_steps,
            throw=False,
        )
    converged = solution.result == optx.RESULTS.successful
    return solution.value, converged, solution.stats["num_steps"]


def _cost(
    pixels: Pixels, tried: Solution, nominal: Float[Array, ""]
) -> Float[Array, ""]:
    """How badly a cylinder explains the readings: mean log loss of their residuals.

    Its logarithm compares good with better and counts a gross error like any other. As
    in a likelihood the logarithm of each deviation, in units of the `nominal` one, is a
    part of it: a plane that all rays graze would otherwise excuse any reading.
    """
    seen, weight = tried.seen, tried.rows.weight[: pixels.depth.shape[0]]
    whitened = (seen.depth - pixels.depth) * weight
    # A pixel of the object that the cylinder does not cover is as wrong as can be.
    missed = (~seen.on_cap & (seen.square < 0)) | (
        seen.on_cap & (seen.cap_distance > 1.05)
    )
    loss = jnp.log1p((whitened / 2) ** 2) + jnp.where(missed, MISSED_LOSS, 0)
    # A reading without weight costs as much as a pixel that is missed.
    loss = loss - jnp.log(jnp.maximum(weight * nominal, np.exp(-MISSED_LOSS)))
    used = pixels.depth > 0
    count = jnp.maximum(jnp.sum(used), 1).astype(loss.dtype)
    cost = jnp.sum(jnp.where(used, loss, 0)) / count
    # Readings without weight would let a cylinder pass that is made of no numbers.
    leaves = jax.tree.leaves(tried.cylinder)
    numbers = jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in leaves]).all()
    return jnp.where(numbers & jnp.isfinite(cost), cost, jnp.inf)


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
    beside: Pixels, noise: AbstractDepthNoise, cylinder: Cylinder
) -> Bool[Array, " n"]:
    """Which pixels beside the object see what the cylinder would hide."""
    seen = surface_seen(beside.direction, cylinder, cylinder.radius / 100)
    half = cylinder.height / 2
    enters = jnp.minimum(seen.enter_along, seen.leave_along) < half
    leaves = jnp.maximum(seen.enter_along, seen.leave_along) > -half
    covers = (seen.square > 0) & seen.outside & enters & leaves
    sigma = noise.sigma(seen.depth, seen.cos_incidence)
    return covers & (beside.depth > seen.depth + 5 * sigma)


def _mirrored(cylinder: Cylinder) -> Cylinder:
    """Tilt the other way, which looks the same from afar but for its depth."""
    axis, center = cylinder.axis, cylinder.center
    along = jnp.sum(axis * center, axis=-1) / jnp.sum(center**2, axis=-1)
    mirrored = axis - 2 * along[..., None] * center
    return eqx.tree_at(lambda c: c.axis, cylinder, mirrored)


def _distance(tried: Cylinder, best: Cylinder) -> Float[Array, " k"]:
    """How far the wall of each cylinder lies from the best one's, in meters."""
    a = best.axis
    turned = jnp.cross(tried.axis, a[None]) * ((best.height + best.radius) / 2)
    moved = jnp.cross(tried.center - best.center[None], a[None])
    grown = tried.radius - best.radius
    return jnp.sqrt(jnp.sum(turned**2 + moved**2, axis=1) + grown**2)
