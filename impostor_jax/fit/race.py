"""Which of several starts are worth a fit to all readings.

All of them run together on the few readings that speak for all, in one small program.
Most end where another does, or explain these so much worse that the others cannot make
up for it: on real images nine of ten starts end at costs three times as large as the
best, after as many steps as they are given.
"""

__all__ = ["MOST_STARTS", "Ends", "coarse", "ends_of", "worth_a_fit"]

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from impostor_jax.compiling import quickly_compiled
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.evidence import joined_readings, readings_of
from impostor_jax.fit.posterior import cost_of, hidden_pixels
from impostor_jax.fit.problem import BLOCK, Inputs, Table, posed
from impostor_jax.fit.solve import solve

MOST_STARTS = 20
"""That are run together; fewer take less time, but no other program."""

HOPELESS = 200.0
"""Nats on the readings that speak for all by which a start is worse than the best and
is dropped. Two ends that explain other halves of them equally well differ by 23, as
often as not more."""

HOPELESS_RATIO = 10.0
"""The same for all readings, over those that tell as much as one whose error is its
own: such an end weighs less than a ten-thousandth of the best."""

MOST_STEPS = 20
"""Of the solver: whatever ends well does so after five to fifteen, and others would
take as many as they are given."""

MOST_AT_EDGE = 128
"""Pixels at the edge that are looked at beside few readings."""

SAME = 5.0
"""Standard deviations, in what all readings tell, up to which two ends are one."""

SETTLED = 1.0
"""Those in what the few tell, within which ends are one in any case: so far off may
each be, by the tolerance of the solver; and nats by which they may differ."""


class Ends(NamedTuple):
    """Where starts lead on a few readings.

    Attributes:
        body: One for each.
        cost: As of `cost_of`, for these readings.
        residual: What each leaves of them, in standard deviations.
    """

    body: AbstractBody
    cost: Float[Array, " k"]
    residual: Float[Array, "k n"]


def coarse(table: Table) -> Table:
    """The readings that speak for all."""
    count, at_edge = len(table.row), table.inside.shape[1]
    own = np.count_nonzero(table.rays.exists[:count])
    few = np.arange(min(MOST_AT_EDGE, at_edge))
    kept = [np.arange(count - BLOCK, count)]
    kept += [count + k * at_edge + few for k in range(5)]
    kept += [np.arange(count + table.inside.size, len(table.rays.x))]
    chosen = np.concatenate(kept)
    return table._replace(
        rays=jax.tree.map(lambda values: values[chosen], table.rays),
        inside=table.inside[:, : len(few)],
        mixed=table.mixed[:, : len(few)],
        foot=table.foot[: len(few)],
        row=table.row[-BLOCK:],
        col=table.col[-BLOCK:],
        beside=table.beside[-BLOCK:],
        lattice=None,
        num_blocks=np.ones((), np.int32),
        # Beside few readings those all over the image stand for fewer, too.
        each=table.each * table.each.dtype.type(min(1, BLOCK / max(own, 1))),
    )


def ends_of(inputs: Inputs, starts: Sequence[AbstractBody]) -> Ends:
    """Where starts lead.

    Args:
        inputs: Of tables as of `coarse`.
        starts: At most `MOST_STARTS`, in the first view's frame.
    """
    filled = [*starts, *[starts[-1]] * (MOST_STARTS - len(starts))]
    stacked = jax.tree.map(lambda *parts: np.stack(parts), *filled)
    count = np.array(len(starts), np.int32)
    ends = quickly_compiled(_run_all)(inputs, stacked, count)
    return jax.tree.map(lambda values: np.asarray(values)[: len(starts)], ends)


def _run_all(inputs: Inputs, starts: AbstractBody, count: Int[Array, ""]) -> Ends:
    settings = dataclasses.replace(inputs.settings, max_steps=MOST_STEPS)
    problem = posed(dataclasses.replace(inputs, settings=settings))

    def led(start: AbstractBody) -> Ends:
        found = solve(problem, start)
        at_poses, body = problem.with_poses(found.off), found.body
        views = at_poses.views
        bodies = [view.own(body) for view in views]
        told = readings_of(at_poses, bodies, [view.noise for view in views])
        cost = cost_of(at_poses, body, told, hidden_pixels(at_poses, body))
        joined = joined_readings(told, views, body)
        residual = jnp.where(joined.used, joined.terms.residual, 0)
        return Ends(body, cost, residual)

    def step(k: Int[Array, ""], ends: Ends) -> Ends:
        found = led(jax.tree.map(lambda values: values[k], starts))
        return jax.tree.map(lambda full, own: full.at[k].set(own), ends, found)

    shapes = jax.eval_shape(led, jax.tree.map(lambda values: values[0], starts))
    blank = jax.tree.map(lambda x: jnp.zeros((MOST_STARTS, *x.shape), x.dtype), shapes)
    return jax.lax.fori_loop(0, count, step, blank)


def worth_a_fit(ends: Ends, readings: int, repeats: float) -> dict[int, int]:
    """Ends that may be the best, the likeliest first, and how many starts led there.

    Args:
        ends: Where starts lead.
        readings: How many there are in all.
        repeats: Of these as many as tell what one whose error is its own does.
    """
    cost = np.where(np.isfinite(ends.cost), ends.cost, np.inf)
    residual = np.asarray(ends.residual)
    share = min(residual.shape[1] / max(readings, 1), 1.0)
    most = HOPELESS_RATIO * repeats * share
    same = max(SAME**2 * share, SETTLED**2)
    limit = cost.min() + max(HOPELESS, most)
    kept: dict[int, int] = {}
    if not np.isfinite(limit):
        return {0: len(cost)}
    for k in np.argsort(cost, kind="stable"):
        if not cost[k] <= limit:
            break
        for other in kept:
            apart = float(np.sum((residual[k] - residual[other]) ** 2))
            if apart <= same and cost[k] - cost[other] <= SETTLED:
                kept[other] += 1
                break
        else:
            kept[int(k)] = 1
    return kept
