"""The two compiled programs of a fit: the solver and the assessment.

The solver leads from a start to the estimate; the assessment says how sure that is.
Two threads compile them at the same time. The solver needs neither the model of
correlated errors nor the places of neighboring pixels, so one program serves fits with
and without.
"""

__all__ = ["Program", "fit_from"]

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp

from impostor_jax.compiling import quickly_compiled
from impostor_jax.fit.assess import Assessment, assess
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.problem import Inputs, posed
from impostor_jax.fit.race import Ends, coarse, ends_of
from impostor_jax.fit.solve import Solution, solve
from impostor_jax.fit.threads import in_background


@dataclasses.dataclass(frozen=True)
class Program:
    """A fit of one object in some images, from any start.

    Attributes:
        inputs: What they show, and what is known and asked.
        correlated: Whether the covariance allows for correlated residuals.
    """

    inputs: Inputs
    correlated: bool

    def prepare(self, body: AbstractBody) -> None:
        """Load or compile both programs at the same time.

        Args:
            body: Any of the kind that is fitted.
        """
        no = jnp.zeros((), bool)
        poses = [table.pose for table in self.inputs.tables if table.pose is not None]
        off = (
            jnp.zeros_like(jnp.stack([pose.known for pose in poses])) if poses else None
        )
        ended = Solution(body, no, no, jnp.zeros((), jnp.int32), off)
        waited_for = in_background(
            lambda: _assessed().prepare(self.inputs, ended, self.correlated)
        )
        _solved().prepare(self._of_solver, body)
        waited_for()

    def fit(self, start: AbstractBody) -> Assessment:
        """The assessed estimate from a start in the first view's frame."""
        solved = _solved().ready(self._of_solver, start)
        if solved is None:
            self.prepare(start)
        found = _solved()(self._of_solver, start) if solved is None else solved()
        return _assessed()(self.inputs, found, self.correlated)

    def race(self, starts: Sequence[AbstractBody]) -> Ends:
        """The estimates from several starts, on a few readings."""
        few = tuple(map(coarse, self.inputs.tables))
        return ends_of(dataclasses.replace(self.inputs, tables=few), starts)

    @functools.cached_property
    def _of_solver(self) -> Inputs:
        """What the solver is given."""
        tables = tuple(table._replace(lattice=None) for table in self.inputs.tables)
        return dataclasses.replace(self.inputs, tables=tables)


def fit_from(inputs: Inputs, start: AbstractBody, correlated: bool) -> Assessment:
    """Solver and assessment inside a caller's program; arguments as of `Program`."""
    problem = posed(inputs)
    return assess(problem, solve(problem, start), correlated)


def _solution_of(inputs: Inputs, start: AbstractBody) -> Solution:
    return solve(posed(inputs), start)


def _assessment_of(inputs: Inputs, found: Solution, correlated: bool) -> Assessment:
    return assess(posed(inputs), found, correlated)


def _solved() -> Any:
    return quickly_compiled(_solution_of)


def _assessed() -> Any:
    return quickly_compiled(_assessment_of, static_argnames="correlated")
