"""Least squares on thousands of rows, reduced to a small triangle.

The rows are held, with their weights; what changes is the vector of a chart.
"""

__all__ = ["lowest_loss", "minimize"]

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.prior import Prior, prior_residuals
from impostor_jax.fit.request import Request
from impostor_jax.fit.residuals import held, residuals
from impostor_jax.fit.robust import robust_residual
from impostor_jax.fit.rows import BLOCK, Kind, Rows
from impostor_jax.numerics import eps

SQUARE_WIDTH = 4.0
"""Factor on the width of the robust loss where readings are compared in squares."""

FIRST_END_WIDTH = 20.0
"""The same for ends that may still be pixels off."""

LAST_REACH = 1e3
"""Steps that are next to undamped, in scaled units, once the end is near."""

RIDGE = 3e-3
"""Inverse width of the prior that keeps free coordinates in place, in scaled units."""


_SOLVERS = {
    "LevenbergMarquardt": optx.LevenbergMarquardt,
    "Dogleg": optx.Dogleg,
    "GaussNewton": optx.GaussNewton,
}
"""By the names of `Effort`."""


class _Problem(eqx.Module):
    """A robust least-squares problem in a chart's coordinates."""

    chart: Chart
    rows: Rows
    prior: Prior
    width: Float[Array, " n"]
    always: Bool[Array, ""]
    num_blocks: Int[Array, ""] | None
    request: Request = eqx.field(static=True)


def _triangle(
    vector: Float[Array, " n"], problem: _Problem
) -> tuple[Float[Array, " m"], Float[Array, "m n"]]:
    """Residual and Jacobian, reduced to the triangle of their QR decomposition.

    The thousands of rows enter a solver only through J^T J, J^T r and r^T r. Any
    residual with the same products has the same loss, gradient and steps, and the last
    column of the triangle R of [J r] = Q R is the shortest. So the solver carries
    vectors of a few numbers, and the rows are taken block by block: no Jacobian of all
    of them is ever held.
    """
    chart = problem.chart
    body = chart.body(vector)
    change = jax.jacfwd(lambda v: chart.moving_numbers(chart.body(v)))(vector)
    by_qr = problem.request.linear_solver == "qr"

    def of_rows(
        rows: Rows, width: Float[Array, " k"]
    ) -> tuple[Float[Array, "n k"], Float[Array, " k"]]:
        whitened, gradient = residuals(rows, body, problem.always, chart.fixed)
        robust, slope = jax.jvp(
            lambda r: robust_residual(r, width, problem.request.kernel),
            (whitened,),
            (jnp.ones_like(whitened),),
        )
        jacobian = jnp.matmul(change.T, gradient, precision="highest") * slope[None]
        return jacobian, robust

    def with_part(
        total: Float[Array, "m m"], jacobian: Float[Array, "n k"], residual: Array
    ) -> Float[Array, "m m"]:
        """The products, or the triangle, of the rows so far and some more."""
        full = jnp.concatenate([jacobian, residual[None]])
        if by_qr:
            return jnp.linalg.qr(jnp.concatenate([total, full.T]), mode="r")
        return total + jnp.matmul(full, full.T, precision="highest")

    known = prior_residuals(problem.prior, body)
    of_known = jax.jacfwd(lambda v: prior_residuals(problem.prior, chart.body(v)))(
        vector
    )
    # A prior three thousand deviations wide keeps the triangle regular where the image
    # leaves a coordinate free.
    ridge = RIDGE * jnp.eye(vector.shape[0], dtype=vector.dtype)
    total = with_part(
        jnp.zeros((vector.shape[0] + 1,) * 2, vector.dtype),
        jnp.concatenate([of_known.T, ridge], axis=1),
        jnp.concatenate([known, RIDGE * vector]),
    )
    weighed = problem.rows, problem.width
    count = problem.width.shape[0]
    if count <= BLOCK:
        total = with_part(total, *of_rows(*weighed))
    else:
        assert count % BLOCK == 0

        def with_block(
            number: Int[Array, ""], total: Float[Array, "m m"]
        ) -> Float[Array, "m m"]:
            # From the end, where the rows are that speak for all.
            first = count - BLOCK * (number + 1)
            cut = partial(
                jax.lax.dynamic_slice_in_dim, start_index=first, slice_size=BLOCK
            )
            # What is cut out within a large loop keeps that from being vectorized.
            part = held(problem.always, lambda: jax.tree.map(cut, weighed))
            return with_part(total, *of_rows(*part))

        num_blocks = problem.num_blocks
        num_blocks = count // BLOCK if num_blocks is None else num_blocks
        total = jax.lax.fori_loop(0, num_blocks, with_block, total)
    if by_qr:
        return total[:, -1], total[:, :-1]
    # Rounding must not make a pivot negative. As rows without a residual these damp a
    # step, by a millionth, and move no minimum.
    diagonal = jnp.diagonal(total) * eps(vector.dtype, 16)
    lower = jnp.linalg.cholesky(total + jnp.diag(diagonal.at[-1].add(RIDGE**2)))
    return lower[-1], lower[:-1].T


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


class _Search(optx.AbstractSearch):
    """A trust region that takes a last step even if rounding raises its loss.

    At the minimum, steps change the loss by less than the rounding of its sum. If one
    happens to be rounded low, every other looks worse: all steps were refused, and one
    fit in some hundred ran into its step limit with the right answer.

    Attributes:
        region: Decides on all steps but those that end the search.
        tolerance: Step, and change of the residuals, in root mean square, that end it.
        reach: Size of the region to begin with. Damped to one, the step along what a
            prior alone tells is smaller than a tolerance, and the search ends there.
    """

    region: optx.ClassicalTrustRegion
    tolerance: Float[Array, ""]
    reach: Float[Array, ""]

    @override
    def init(self, y: Any, f_info_struct: Any) -> Any:
        state = self.region.init(y, f_info_struct)
        return jax.tree.map(lambda size: size * self.reach, state)

    @override
    def step(
        self, first_step: Any, y: Any, y_eval: Any, f_info: Any, f_eval_info: Any, state
    ) -> Any:
        residual = f_eval_info.residual
        lowered = residual * (1 - eps(residual.dtype, 16))
        is_last = optx.rms_norm(y_eval - y) < self.tolerance
        is_last &= optx.rms_norm(residual - f_info.residual) < self.tolerance
        f_eval_info = eqx.tree_at(
            lambda f: f.residual, f_eval_info, jnp.where(is_last, lowered, residual)
        )
        return self.region.step(first_step, y, y_eval, f_info, f_eval_info, state)


def minimize(
    chart: Chart,
    rows: Rows,
    prior: Prior,
    width: Float[Array, ""],
    request: Request,
    tolerance: Float[Array, ""],
    is_first: Bool[Array, ""],
    always: Bool[Array, ""],
    num_blocks: Int[Array, ""] | None = None,
) -> tuple[Float[Array, " n"], Bool[Array, ""], Int[Array, ""]]:
    """Least squares in the chart's coordinates, from its reference.

    Args:
        chart: Map from the coordinates to a body.
        rows: What the image says; those at the end speak for all.
        prior: In the camera frame.
        width: Of the robust loss, in deviations.
        request: Which loss and solver, and how many steps at most.
        tolerance: Step at which it ends.
        is_first: Whether ends may still be pixels off.
        always: As in `residuals`.
        num_blocks: Blocks of rows that are used, counted from the end; all if None,
            and then it can be differentiated in reverse mode.

    Returns:
        The coordinates, whether it converged, and its number of steps.
    """
    problem = _problem(chart, rows, prior, width, request, is_first, always, num_blocks)
    solver = _SOLVERS[request.solver](
        rtol=1e-5,
        # Only compared with: it may be traced.
        atol=tolerance,  # pyright: ignore[reportArgumentType]
        norm=optx.rms_norm,
        linear_solver=(
            lx.QR() if request.linear_solver == "qr" else lx.Normal(lx.Cholesky())
        ),
    )
    if isinstance(solver.search, optx.ClassicalTrustRegion):
        reach = jnp.where(is_first, 1, LAST_REACH).astype(width.dtype)
        search = _Search(solver.search, tolerance, reach)
        solver = eqx.tree_at(lambda s: s.search, solver, search)
    # On a GPU the default precision of a product is that of 10-bit mantissas.
    with jax.default_matmul_precision("highest"):
        solution = optx.least_squares(
            _reduced,
            solver,
            jnp.zeros(chart.size, width.dtype),
            args=problem,
            max_steps=request.max_steps,
            throw=False,
        )
    converged = solution.result == optx.RESULTS.successful
    return solution.value, converged, solution.stats["num_steps"]


def lowest_loss(
    chart: Chart,
    rows: Rows,
    prior: Prior,
    width: Float[Array, ""],
    request: Request,
    always: Bool[Array, ""],
) -> Float[Array, ""]:
    """Sum of the robust losses at their minimum, in squared deviations.

    It is found to a hundredth of a deviation of each coordinate, which lifts it by 1e-4
    each.
    """
    is_first = jnp.zeros((), bool)
    tolerance = jnp.full_like(width, 1e-3)
    vector, _, _ = minimize(
        chart, rows, prior, width, request, tolerance, is_first, always
    )
    problem = _problem(chart, rows, prior, width, request, is_first, always, None)
    residual, _ = _triangle(vector, problem)
    return jnp.sum(residual**2)


def _problem(
    chart: Chart,
    rows: Rows,
    prior: Prior,
    width: Float[Array, ""],
    request: Request,
    is_first: Bool[Array, ""],
    always: Bool[Array, ""],
    num_blocks: Int[Array, ""] | None,
) -> _Problem:
    # The error of a square is skewed, and a loss that bends early would be biased.
    # The first height may be pixels off.
    end_width = jnp.where(is_first, FIRST_END_WIDTH, 1.0)
    row_width = width * jnp.where(
        rows.kind == Kind.SQUARE,
        SQUARE_WIDTH,
        jnp.where(rows.kind == Kind.END, end_width, 1.0),
    )
    return _Problem(chart, rows, prior, row_width, always, num_blocks, request)
