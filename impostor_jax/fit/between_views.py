"""Whether several views agree on an object: poses that err look like much else.

A pose that is off by a few millimeters bends what all views say by many deviations. It
leaves residuals that pixels beside each other share, as those of real sensors do, and
what looks like an oval wall. So what counts is how far each view moves the estimate
away from the others, over what the errors within a view, once it has an estimate of its
own, let it.
"""

__all__ = [
    "DOUBTED",
    "BetweenViews",
    "between_views",
    "disagreement",
    "moved_by_views",
]

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.problem import Problem, in_coordinates
from impostor_jax.numerics import product

DOUBTED = 14.0
"""Disagreement from which poses may err, and deviations allow for that: of 23 pairs of
views with exact poses none had it, of 21 in which one was 0.1 mm and 0.01 degrees off
12, and at 0.3 mm estimates were up to 13 deviations off. A pose that errs where the
other view hardly tells does not show."""

LEAST_ALONE = 1e-2
"""Part of a direction's information that a view has to have to move along it alone."""


class BetweenViews(NamedTuple):
    """What views say of an estimate, each against the others.

    Attributes:
        spread: Of the estimates that each would have alone about that of all, in
            coordinates in which independent errors have a variance of 1.
        chi2: As of `disagreement`.
        chi2_of_form: The same if the wall departs from its shape by what was found.
        residual: What of the readings' residuals each view's own estimate would leave.
    """

    spread: Float[Array, "c c"]
    chi2: Float[Array, ""]
    chi2_of_form: Float[Array, ""]
    residual: Float[Array, " n"]


def between_views(
    problem: Problem,
    augmented: Float[Array, "k n"],
    unexplained: Float[Array, " n"],
    tells: Bool[Array, " n"],
    into: Float[Array, "c t"],
    root: Float[Array, "c c"],
    others: Float[Array, " c"],
    variance: Float[Array, ""],
) -> BetweenViews:
    """Compare the views of a problem with each other.

    Args:
        problem: Of more than one view.
        augmented: Gradient in tangent coordinates and residual of each reading, as of
            `Terms`.
        unexplained: What a wall that departs from its shape leaves of the residuals.
        tells: Which readings count.
        into: Tangent coordinates that each free coordinate moves, one a row.
        root: Of the covariance of the free coordinates, as of `covariance_root`.
        others: Pull on them of all else but what is believed of poses.
        variance: Of the whitened residuals.
    """
    told = jnp.where(tells[None], augmented, 0)
    departed = told.at[-1].set(jnp.where(tells, unexplained, 0))

    poses = problem.poses
    num_seen = len(into) - sum(pose.off.size for pose in poses)
    # A view says what it does at a pose that it may have.
    beliefs = [variance * pose.belief(num_seen) for pose in poses]

    def parts_of(rows: Float[Array, "k n"]) -> list[Float[Array, "m m"]]:
        told = [in_coordinates(product(x, x.T), into) for x in problem.apart(rows)]
        return (
            [x + own for x, own in zip(told, beliefs, strict=True)] if poses else told
        )

    parts, of_form = parts_of(told), parts_of(departed)
    chi2, chi2_of_form = (
        disagreement(moved_by_views(each, others, variance, root))
        for each in (parts, of_form)
    )
    steps = jnp.stack([_step_alone(part, root, variance) for part in parts])
    gradients = problem.apart(departed[:-1])
    changes = [
        product(-product(root, _step_alone(part, root, variance)), into, gradient)
        for part, gradient in zip(of_form, gradients, strict=True)
    ]
    return BetweenViews(
        spread=product(steps.T, steps) / len(steps),
        chi2=chi2,
        chi2_of_form=chi2_of_form,
        residual=unexplained + jnp.concatenate(changes),
    )


def moved_by_views(
    parts: Sequence[Float[Array, "m m"]],
    others: Float[Array, " c"],
    variance: Float[Array, ""],
    root: Float[Array, "c c"],
) -> Float[Array, "v c"]:
    """How far each view moves an estimate away from what the others say.

    Args:
        parts: Products of each view's terms of Jacobian and residual, whitened, in free
            coordinates.
        others: As of `between_views`, like the next two.
        variance: Of the whitened residuals.
        root: Of the covariance.

    Returns:
        In coordinates in which independent errors have a variance of 1.
    """
    pull = others + sum(part[:-1, -1] for part in parts) / variance
    # What the estimate leaves of all pulls, within its tolerance, is taken to 0.
    left = product(root, root.T, pull)
    own = [part[:-1, -1] - product(part[:-1, :-1], left) for part in parts]
    return product(jnp.stack(own) / variance, root)


def disagreement(moves: Float[Array, "v c"]) -> Float[Array, ""]:
    """Chi-squared of the view that moves an estimate farthest.

    Of a view with the part x of the information the squared move varies by x (1 - x), a
    quarter at most.

    Args:
        moves: As `moved_by_views` returns them.

    Returns:
        Four times the squared move, of as many degrees of freedom as there are
        coordinates, or less.
    """
    return 4 * jnp.max(jnp.sum(moves**2, axis=1))


def _step_alone(
    part: Float[Array, "m m"], root: Float[Array, "c c"], variance: Float[Array, ""]
) -> Float[Array, " c"]:
    """Step by which a view alone would move the estimate to its own, whitened.

    Hardly any where it hardly tells.
    """
    information = product(root.T, part[:-1, :-1], root) / variance
    pull = product(root.T, part[:-1, -1]) / variance
    ridge = LEAST_ALONE * jnp.eye(len(pull), dtype=pull.dtype)
    return jax.scipy.linalg.solve(information + ridge, pull, assume_a="pos")
