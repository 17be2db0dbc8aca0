"""Levenberg-Marquardt on thousands of rows, reduced to a small triangle.

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
from impostor_jax.fit.residuals import residuals
from impostor_jax.fit.robust import robust_residual
from impostor_jax.fit.rows import Kind, Rows
from impostor_jax.numerics import eps

SQUARE_WIDTH = 4.0
"""Factor on the width of the robust loss where readings are compared in squares."""

FIRST_END_WIDTH = 20.0
"""The same for ends that may still be pixels off."""

RIDGE = 3e-3
"""Inverse width of the prior that keeps free coordinates in place, in scaled units."""


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
    vectors of a few numbers.
    """
    chart = problem.chart
    body = chart.body(vector)
    change = jax.jacfwd(lambda v: chart.moving_numbers(chart.body(v)))(vector)
    whitened, gradient = residuals(problem.rows, body, problem.always, chart.fixed)
    robust, slope = jax.jvp(
        lambda r: robust_residual(r, problem.width, problem.kernel),
        (whitened,),
        (jnp.ones_like(whitened),),
    )
    jacobian = jnp.matmul(change.T, gradient, precision="highest") * slope[None]
    known = prior_residuals(problem.prior, body)
    of_known = jax.jacfwd(lambda v: prior_residuals(problem.prior, chart.body(v)))(
        vector
    )
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
    """

    region: optx.ClassicalTrustRegion
    tolerance: Float[Array, ""]

    @override
    def init(self, y: Any, f_info_struct: Any) -> Any:
        return self.region.init(y, f_info_struct)

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
    kernel: str,
    tolerance: Float[Array, ""],
    is_first: Bool[Array, ""],
    max_steps: int,
    always: Bool[Array, ""],
) -> tuple[Float[Array, " n"], Bool[Array, ""], Int[Array, ""]]:
    """Levenberg-Marquardt in the chart's coordinates, from its reference."""
    problem = _problem(chart, rows, prior, width, kernel, is_first, always)
    solver = optx.LevenbergMarquardt(
        rtol=1e-5,
        # Only compared with: it may be traced.
        atol=tolerance,  # pyright: ignore[reportArgumentType]
        norm=optx.rms_norm,
        linear_solver=lx.Normal(lx.Cholesky()),
    )
    solver = eqx.tree_at(lambda s: s.search, solver, _Search(solver.search, tolerance))
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


def lowest_loss(
    chart: Chart,
    rows: Rows,
    prior: Prior,
    width: Float[Array, ""],
    kernel: str,
    max_steps: int,
    always: Bool[Array, ""],
) -> Float[Array, ""]:
    """Sum of the robust losses at their minimum, in squared deviations.

    It is found to a hundredth of a deviation of each coordinate, which lifts it by 1e-4
    each.
    """
    is_first = jnp.zeros((), bool)
    tolerance = jnp.full_like(width, 1e-3)
    vector, _, _ = minimize(
        chart, rows, prior, width, kernel, tolerance, is_first, max_steps, always
    )
    problem = _problem(chart, rows, prior, width, kernel, is_first, always)
    residual, _ = _triangle(vector, problem)
    return jnp.sum(residual**2)


def _problem(
    chart: Chart,
    rows: Rows,
    prior: Prior,
    width: Float[Array, ""],
    kernel: str,
    is_first: Bool[Array, ""],
    always: Bool[Array, ""],
) -> _Problem:
    # The error of a square is skewed, and a loss that bends early would be biased.
    # The first height may be pixels off.
    end_width = jnp.where(is_first, FIRST_END_WIDTH, 1.0)
    row_width = width * jnp.where(
        rows.kind == Kind.SQUARE,
        SQUARE_WIDTH,
        jnp.where(rows.kind == Kind.END, end_width, 1.0),
    )
    return _Problem(chart, rows, prior, row_width, always, kernel)
