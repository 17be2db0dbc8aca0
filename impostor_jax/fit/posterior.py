"""How probable a solution is: what readings, missing ones and priors say of it."""

__all__ = ["cost_of", "explains", "hidden_pixels"]

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.body import AbstractBody, Passing
from impostor_jax.fit.evidence import Readings
from impostor_jax.fit.prior import prior_residuals
from impostor_jax.fit.problem import Problem, View, sigma_of
from impostor_jax.numerics import Numbers, all_finite

MISSED_LOSS = 3.0
"""Loss of a pixel that the body should cover and does not, or the reverse, in nats."""

OUTLYING = 0.1
"""Share of outliers that is expected."""

OUTLYING_RANGE = 100.0
"""Nominal standard deviations over which they are spread. An outlier then costs what a
reading does that is 3.3 standard deviations off, whatever its size."""

MOST_OUTLYING = 0.25
"""Share of the readings that may lie elsewhere without a doubt of it, if the others
scatter as they should: of 300 random scenes with 10 % of outliers, wrong ends left a
variance of 1.18 or more of the whitened residuals, right ones 1.05 in 95 of 100."""

MOST_VARIANCE = 1.1
"""Their variance up to which they do."""

MOST_MISSED = 0.01
"""Share of them whose rays may miss the body: a wall that is too thin continues, past
its outline, in a surface that noisy readings may lie on."""

BESIDE = 1.0
"""Pixels within a body's outline that may see through it."""


def cost_of(
    problem: Problem,
    body: AbstractBody,
    readings: Sequence[Readings],
    hidden: Float[Array, ""],
) -> Float[Array, ""]:
    """Negative logarithm of a body's posterior probability, up to what all share.

    A reading is normal about the surface, or an outlier. Its standard deviation, in
    units of the nominal one, is a part of that: a plane that all rays graze would
    otherwise excuse any reading. Readings that the body leaves out cost what the
    others do on average: it could choose them otherwise.

    Args:
        problem: What was given.
        body: The estimate, in the first view's frame.
        readings: Of each view, as they are compared with it.
        hidden: Pixels off the object that see what it would hide.
    """

    def loss(view: View, told: Readings) -> Float[Array, ""]:
        return _loss_of(problem, view, view.own(body), told)

    cost = MISSED_LOSS * hidden + sum(problem.of_each(loss, readings))
    known = prior_residuals(problem.prior, body, problem.bias)
    cost += jnp.sum(known**2) / 2
    cost += sum(jnp.sum((pose.known + pose.off) ** 2) for pose in problem.poses) / 2
    # Readings without weight would let a body pass that is made of no numbers.
    return jnp.where(all_finite(body) & jnp.isfinite(cost), cost, jnp.inf)


def _loss_of(
    problem: Problem, view: View, body: AbstractBody, readings: Readings
) -> Float[Array, ""]:
    """The part of a view's readings, of a body in its frame."""
    terms, seen, used = readings.terms, readings.passing, readings.used
    depth = view.pixels.depth
    whitened = readings.off * terms.weight
    density = terms.weight * problem.nominal / np.sqrt(2 * np.pi)
    density = (1 - OUTLYING) * density * jnp.exp(-(whitened**2) / 2)
    # A pixel of the object that the body does not cover is as wrong as can be.
    missed = _is_far_off(problem, view, body, seen)
    outlying = OUTLYING / OUTLYING_RANGE
    loss = -jnp.log(jnp.where(missed, 0, density) + outlying)
    loss = loss + jnp.where(missed, MISSED_LOSS, 0)
    count, total = (
        jnp.maximum(jnp.sum(some, dtype=loss.dtype), 1) for some in (used, depth > 0)
    )
    return jnp.sum(jnp.where(used, loss, 0)) * (total / count)


def _beside(problem: Problem, view: View, seen: Passing) -> Numbers:
    """Distance from a body's outline within which a pixel may be of either side."""
    return BESIDE * (seen.nearest + seen.foot) * view.pixel + problem.unit


def _is_far_off(
    problem: Problem, view: View, body: AbstractBody, seen: Passing
) -> Bool[Array, " n"]:
    """Which rays miss a body by more than a pixel.

    A radius that is a little too small makes all along the outline miss, and larger
    bodies than the true one would always be preferred.
    """
    margin = _beside(problem, view, seen)
    off_wall = seen.square < seen.square_at(-margin, body.radius)
    off_cap = seen.is_past_rim & (seen.rim > seen.cap_radius + margin)
    return jnp.where(seen.on_cap, off_cap, off_wall)


def explains(readings: Readings, spread: Float[Array, ""]) -> Bool[Array, ""]:
    """Whether the readings scatter around the body as the sensor says."""
    terms, seen, used = readings.terms, readings.passing, readings.used
    squares = (readings.off * terms.weight) ** 2
    is_near = used & (squares < (3 * spread) ** 2)
    # What grazes an exact ray is compared otherwise.
    compared = used & ~(readings.is_square & readings.is_exact)
    near = compared & is_near & ~seen.is_past_rim
    num_near = jnp.sum(near, dtype=squares.dtype)
    variance = jnp.sum(jnp.where(near, squares, 0)) / jnp.maximum(num_near, 1)
    many = num_near >= (1 - MOST_OUTLYING) * jnp.sum(compared, dtype=squares.dtype)
    num_missed = jnp.sum(is_near & seen.is_missed, dtype=squares.dtype)
    return many & (variance <= MOST_VARIANCE) & (num_missed <= MOST_MISSED * num_near)


def hidden_pixels(problem: Problem, body: AbstractBody) -> Float[Array, ""]:
    """How many pixels off the object see what the body would hide.

    Not those beside its outline, which are the object's where a mask is too small or
    the radius a little too large: one of the few that are looked at stands for many.
    """
    hidden = problem.of_each(lambda view: _hidden_in(problem, view, view.own(body)))
    return sum(hidden[1:], hidden[0])


def _hidden_in(problem: Problem, view: View, body: AbstractBody) -> Float[Array, ""]:
    around = view.around
    seen = body.passing(around.rays, body.radius / 100)
    sigma = sigma_of(view.noise, around, seen.depth, seen.cos_incidence)
    margin = jnp.minimum(_beside(problem, view, seen), body.radius)
    is_within = seen.square > seen.square_at(margin, body.radius)
    inside = body.far_side(seen)
    behind = jnp.where(seen.on_cap, inside + seen.foot, seen.depth)
    hides = body.covers(seen) & is_within & (around.depth > behind + 5 * sigma)
    return jnp.sum(hides, dtype=sigma.dtype) * view.each
