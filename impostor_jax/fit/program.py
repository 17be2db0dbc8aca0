"""The two compiled programs of a fit: the solver and the assessment.

The solver leads from a start to the estimate; the assessment says how sure that is.
Two threads compile them at the same time. The solver needs neither the model of
correlated errors nor the places of neighboring pixels, so one program serves fits with
and without.
"""

__all__ = ["Program", "fit_from"]

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from impostor_jax.compiling import quickly_compiled
from impostor_jax.fit.assess import Assessment, assess
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.prior import Prior
from impostor_jax.fit.problem import Settings, Table, posed
from impostor_jax.fit.race import Ends, coarse, ends_of
from impostor_jax.fit.regions import BUCKETS
from impostor_jax.fit.solve import Solution, solve
from impostor_jax.fit.threads import in_background

SOLVER_SIZES = BUCKETS[2::2]
"""Numbers of readings to which tables are padded for the solver. It skips blocks of
padding, so that larger tables cost nothing, and fewer sizes are compiled."""


@dataclass(frozen=True)
class Program:
    """A fit of one object in some images, from any start.

    Attributes:
        shown: What each of them shows.
        prior: In the world frame.
        settings: What is asked for.
        kernel: Name of the robust loss.
        correlated: Whether the covariance allows for correlated residuals.
    """

    shown: tuple[Table, ...]
    prior: Prior
    settings: Settings
    kernel: str
    correlated: bool

    def prepare(self, body: AbstractBody) -> None:
        """Load or compile both programs at the same time.

        Args:
            body: Any of the kind that is fitted.
        """
        no = jnp.zeros((), bool)
        ended = Solution(body, no, no, jnp.zeros((), jnp.int32))
        waited_for = in_background(
            lambda: _assessed().prepare(*self._for_assessment(ended))
        )
        _solved().prepare(*self._for_solver(body))
        waited_for()

    def fit(self, start: AbstractBody) -> Assessment:
        """The assessed estimate from a start in the first view's frame."""
        asked = self._for_solver(start)
        solved = _solved().ready(*asked)
        if solved is None:
            self.prepare(start)
        found = _solved()(*asked) if solved is None else solved()
        return _assessed()(*self._for_assessment(found))

    def race(self, starts: Sequence[AbstractBody]) -> Ends:
        """The estimates from several starts, on a few readings."""
        few = [coarse(table) for table in self.shown]
        return ends_of(few, self.prior, self.settings, starts, self.kernel)

    @functools.cached_property
    def _solver_tables(self) -> tuple[Table, ...]:
        """What the solver is given of each image, from any start."""
        return tuple(_padded(table)._replace(lattice=None) for table in self.shown)

    def _for_solver(self, start: AbstractBody) -> tuple[Any, ...]:
        return self._solver_tables, self.prior, self.settings, start, self.kernel

    def _for_assessment(self, found: Solution) -> tuple[Any, ...]:
        given = self.shown, self.prior, self.settings, found
        return *given, self.kernel, self.correlated


def _padded(table: Table) -> Table:
    """The table with one of `SOLVER_SIZES`; as it is where it has fewer edge pixels."""
    count = len(table.row)
    size = next((size for size in SOLVER_SIZES if size >= count), count)
    if count < BUCKETS[0] or size == count:
        return table

    def padded(values: Any) -> Any:
        return np.concatenate([np.repeat(values[:1], size - count, axis=0), values])

    rays = jax.tree.map(padded, table.rays)
    rays.depth[: size - count], rays.exists[: size - count] = 0, False
    row, col, beside = map(padded, (table.row, table.col, table.beside))
    return table._replace(rays=rays, row=row, col=col, beside=beside)


def fit_from(
    shown: tuple[Table, ...],
    prior: Prior,
    settings: Settings,
    start: AbstractBody,
    kernel: str,
    correlated: bool,
) -> Assessment:
    """Solver and assessment inside a caller's program; arguments as of `Program`."""
    problem = posed(shown, prior, settings, kernel)
    return assess(problem, solve(problem, start), correlated)


def _solution_of(
    shown: tuple[Table, ...],
    prior: Prior,
    settings: Settings,
    start: AbstractBody,
    kernel: str,
) -> Solution:
    return solve(posed(shown, prior, settings, kernel), start)


def _assessment_of(
    shown: tuple[Table, ...],
    prior: Prior,
    settings: Settings,
    found: Solution,
    kernel: str,
    correlated: bool,
) -> Assessment:
    return assess(posed(shown, prior, settings, kernel), found, correlated)


def _solved() -> Any:
    return quickly_compiled(_solution_of, static_argnames="kernel")


def _assessed() -> Any:
    return quickly_compiled(_assessment_of, static_argnames=("kernel", "correlated"))
