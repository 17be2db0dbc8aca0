"""The best of several solutions of an image, and how probable the others are.

Starts that end within each other's standard deviations are one solution. What the
others weigh widens the standard deviations of the best, so that they cover all.
"""

__all__ = ["AMBIGUOUS_FROM", "best_of", "likeliest"]

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.alternatives import MOST_ALTERNATIVES, Alternatives
from impostor_jax.fit.assess import Assessment
from impostor_jax.fit.body import AbstractBody, Readout
from impostor_jax.fit.budget import Deviations, Values
from impostor_jax.fit.result import Fit
from impostor_jax.fit.status import STATUSES, FitStatus

AMBIGUOUS_FROM = 0.05
"""Weight of all other solutions from which a fit is ambiguous."""

LEAST_WEIGHT = 1e-3
"""Weight of a solution from which it counts."""

SAME = 5.0
"""Standard deviations up to which two solutions are one. Each is off by up to one, by
the tolerance of its fit."""


def likeliest(found: Sequence[Assessment]) -> Assessment:
    """The one that explains the image best."""
    return found[int(np.argmin([float(one.cost) for one in found]))]


class Rival(NamedTuple):
    """A solution beside the best.

    Attributes:
        found: What is said of it.
        away: What is read of it, less the same of the best.
    """

    found: Assessment
    away: dict[str, Float[np.ndarray, "..."]]


def best_of(found: Sequence[Assessment], num_starts: int | None = None) -> Fit:
    """The fit that explains the image best, and what the others say of it.

    Args:
        found: What starts led to.
        num_starts: How many were tried; as many as were found if None.
    """
    ranked = sorted(found, key=lambda one: float(one.cost))
    best, rivals = ranked[0], []
    num_agreeing = int(best.num_ended)
    for one in ranked[1:]:
        if one.fit.status is FitStatus.NOT_FINITE:
            continue
        rival = Rival(one, _apart(best, one))
        if _is_same(best, rival.away):
            num_agreeing += int(one.num_ended)
        elif _is_solution(one) and not any(
            _is_same(other.found, _apart(other.found, one)) for other in rivals
        ):
            rivals.append(rival)
    fit = best.fit.having(
        num_steps=jnp.array(sum(int(one.fit.num_steps) for one in found)),
        num_starts=jnp.array(num_starts or len(found)),
        num_agreeing=jnp.array(num_agreeing),
    )
    rivals = rivals[:MOST_ALTERNATIVES]
    weights = _weights(best, rivals)
    count = int(np.sum(weights[1:] >= LEAST_WEIGHT))
    if not count:
        return fit
    weights = weights[: count + 1] / np.sum(weights[: count + 1])
    return _with_rivals(fit, rivals[:count], weights)


def _is_solution(found: Assessment) -> bool:
    """Whether what a start led to may stand beside the best.

    What has no size, or none that the readings tell, is an end of the solver's and no
    other object: a wall as thin as a line, or as flat as a plane.
    """
    is_minimum = found.fit.status is not FitStatus.STEP_LIMIT
    return is_minimum and bool(found.is_possible)


def _weights(best: Assessment, rivals: Sequence[Rival]) -> Float[np.ndarray, " r"]:
    """Posterior weights of the best and the others.

    Readings whose errors are shared, or larger than their noise says, tell less.
    """
    costs = np.array([float(one.cost) for one in (best, *(r.found for r in rivals))])
    if not np.isfinite(costs[0]):
        # None of them is a solution.
        return np.eye(len(costs))[0]
    weights = np.exp((costs[0] - costs) / float(best.repeats))
    return weights / np.sum(weights)


def _apart(best: Assessment, other: Assessment) -> dict[str, Float[np.ndarray, "..."]]:
    """What is read of a solution less the same of another, by name."""
    kind = type(best.body)
    shapes = kind.of(best.fit.shape), kind.of(other.fit.shape)
    return jax.tree.map(np.asarray, dict(_difference(*shapes, best.fit.ends_seen)))


@jax.jit
def _difference(
    best: AbstractBody, other: AbstractBody, ends_seen: Bool[Array, " e"]
) -> Readout:
    own = best.readout(best, ends_seen)

    def less_own(other: AbstractBody) -> tuple[Readout, Float[Array, ""]]:
        read = jax.tree.map(jnp.subtract, other.readout(best, ends_seen), own)
        squares = [jnp.sum(part**2) for part in read.values()]
        return read, jnp.sum(jnp.stack(squares))

    # The ends of one may be the other's in reverse.
    (as_it_is, size), (turned, other_size) = map(
        less_own, (other, other.reversed(-jnp.ones_like(other.radius)))
    )
    return jax.tree.map(partial(jnp.where, size <= other_size), as_it_is, turned)


def _is_same(best: Assessment, away: dict[str, Float[np.ndarray, "..."]]) -> bool:
    """Whether a solution lies within the standard deviations of another."""
    variance = np.diagonal(np.asarray(best.fit.covariance))
    off = _in_coordinates(best, away)
    return bool(np.all((off**2 <= SAME**2 * variance) | ~np.isfinite(variance)))


def _in_coordinates(
    best: Assessment, away: dict[str, Float[np.ndarray, "..."]]
) -> Float[np.ndarray, " m"]:
    """The same as one vector, of the covariance's coordinates."""
    return np.concatenate([np.atleast_1d(away[name]) for name in best.body.coordinates])


def _with_rivals(
    fit: Fit, rivals: Sequence[Rival], weights: Float[np.ndarray, " r"]
) -> Fit:
    """The best fit, which tells of the others and is as unsure as all of them are.

    What another leaves open counts as the fit has it.
    """
    told = _told(fit, rivals, weights[1:])
    fit = fit.having(alternatives=told)
    if not bool(fit.success):
        return fit
    is_ambiguous = np.sum(weights[1:]) > AMBIGUOUS_FROM
    status = FitStatus.AMBIGUOUS if is_ambiguous else FitStatus.CONVERGED
    offs = [_in_coordinates(rival.found, rival.away) for rival in rivals]
    covariance = _mixed(
        fit.covariance,
        [rival.found.fit.covariance for rival in rivals],
        [np.outer(off, off) for off in offs],
        weights,
    )
    offs = [
        np.concatenate([np.atleast_1d(rival.away[name]) for name in fit.std.values])
        for rival in rivals
    ]
    variance = _mixed(
        fit.std.vector**2,
        [rival.found.fit.std.vector**2 for rival in rivals],
        [off**2 for off in offs],
        weights,
    )
    std = Deviations(jnp.sqrt(variance), fit.std.names)
    more = _root_of_difference(np.asarray(std.vector), np.asarray(fit.std.vector))
    return fit.having(
        std=std,
        std_budget=fit.std_budget.having("alternatives", more),
        covariance=covariance,
        success=jnp.array(not is_ambiguous),
        status_code=jnp.array(STATUSES.index(status)),
    )


def _root_of_difference(
    full: Float[np.ndarray, " n"], part: Float[np.ndarray, " n"]
) -> Float[Array, " n"]:
    """Deviation that makes `full` of `part`; infinite where that is."""
    known = np.isfinite(part)
    squares = np.where(known, full, 0) ** 2 - np.where(known, part, 0) ** 2
    return jnp.asarray(np.where(known, np.sqrt(np.maximum(squares, 0)), part))


def _mixed(
    own: Values,
    others: Sequence[Values],
    squares: Sequence[Float[np.ndarray, "..."]],
    weights: Float[np.ndarray, " r"],
) -> Array:
    """Mean of (co)variances about an estimate, over it and others.

    Each of these is about itself, and away from the estimate by the root of `squares`.
    What the estimate leaves open stays so.
    """
    own_values = np.asarray(own)
    total = weights[0] * own_values
    for other, square, weight in zip(others, squares, weights[1:], strict=True):
        values = np.asarray(other)
        values = np.where(np.isfinite(values), values, own_values)
        total = total + weight * (values + square)
    if own_values.ndim == 2:
        is_open = ~np.isfinite(np.diagonal(own_values))
        beside = is_open[:, None] | is_open[None]
        total = np.where(beside, own_values, total)
    return jnp.asarray(total, own.dtype)


def _told(
    fit: Fit, rivals: Sequence[Rival], weights: Float[np.ndarray, " r"]
) -> Alternatives:
    """The others, filled up with none."""
    none = fit.alternatives
    shapes = [rival.found.fit.shape for rival in rivals]

    def stacked(blank: Array, *parts: Array) -> Array:
        return jnp.concatenate([jnp.stack(parts), blank[len(parts) :]])

    return Alternatives(
        shape=jax.tree.map(stacked, none.shape, *shapes),
        weight=none.weight.at[: len(weights)].set(weights),
    )
