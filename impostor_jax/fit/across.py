"""What readings say of their errors across the rays, by the residuals that they leave.

Along a ray that meets the wall steeply a reading errs by what the sensor errs along it;
where it grazes, by what it errs across. So the squares of the residuals, regressed on
the two parts of their variance, tell both apart: on a round wall the incidence runs
through all angles.
"""

__all__ = ["AcrossRays", "across_found", "exact_rays"]

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.evidence import Readings
from impostor_jax.fit.moved_rays import parts_of_variance
from impostor_jax.fit.problem import Problem, View, sigma_of
from impostor_jax.numerics import product, safe_divide, safe_sqrt
from impostor_jax.text import described, text_or_repr

WITHIN = 4.0
"""Standard deviations within which readings tell; others may be outliers. Of these some
are within, too: as many as are beyond it, up to twice as far, and their squares are
taken off. Ten percent of outliers within 0.1 m were else taken for errors across the
rays, since more of them are within where a ray grazes, and 47 of 1000 random cylinders
came out wrong by 5 to 24 standard deviations."""

LEAST_ASSUMED = 0.1
"""Error across the ray, in errors along it, with which readings are weighed at least:
a few that graze most would tell all."""

LEAST_SCALE = 0.3
"""Of the errors along the rays, over what was given, by which the score is told: noise
may be told three times too large. Of depth that was drawn without any the rounding of
its numbers was else found at 880 deviations, and learned for 15 s the first time."""


class AcrossRays(eqx.Module):
    """Errors of readings across their rays, in meters.

    Attributes:
        deviation: Standard deviation that the fit took for them, along each of two
            directions; where it grows with the range, that of the middle reading.
        found: What the residuals say that it is, whatever the noise along the rays.
        score: Standard deviations by which its square is found larger than 0, with
            `LEAST_SCALE` of the errors along the rays at least.
        doubt: Standard deviation of that square, in square meters.
        scale: Standard deviation along the rays that is found, over what was given.
        misfit: Minus twice the logarithm of the density of readings, in 1/m, on the
            mean; at the scale that they tell, and outliers anywhere in a diameter.
        spread: That diameter, in meters.
        readings: How many they are; those too near a rim to tell count as the others.
    """

    deviation: Float[Array, "*batch"]
    found: Float[Array, "*batch"]
    score: Float[Array, "*batch"]
    doubt: Float[Array, "*batch"]
    scale: Float[Array, "*batch"]
    misfit: Float[Array, "*batch"]
    spread: Float[Array, "*batch"]
    readings: Float[Array, "*batch"]

    def __str__(self) -> str:
        units = {"score": "", "doubt": "m^2", "scale": "", "misfit": "", "readings": ""}
        return text_or_repr(self, lambda: described(self, units))


def exact_rays(dtype: DTypeLike) -> AcrossRays:
    """Of a fit that says nothing of them."""
    zero = jnp.zeros((), dtype)
    one = jnp.ones((), dtype)
    return AcrossRays(zero, zero, zero, zero, one, zero, one, zero)


def across_found(
    problem: Problem,
    bodies: Sequence[AbstractBody],
    readings: Sequence[Readings],
    repeats: Float[Array, ""],
) -> AcrossRays:
    """What the readings of some views say at an estimate.

    Args:
        problem: Of the views.
        bodies: The estimate, in the frame of each.
        readings: What each says, as it is compared with the estimate.
        repeats: Readings that tell as much as one whose error is its own.
    """

    def told_by(view: View, body: AbstractBody, told: Readings) -> tuple[Array, ...]:
        seen, pixels, bias = told.passing, view.pixels, view.noise.bias
        d = seen.local.direction
        length = d.dot(d)
        inverse = jnp.abs(seen.inverse)
        near = jnp.where(told.used, pixels.depth, 1)
        along = sigma_of(view.noise, pixels, near, seen.cos_incidence) ** 2
        h = jnp.maximum(seen.square, 0)
        steep = body.wall_square(seen) * inverse * inverse
        own, other = parts_of_variance(h, along, steep, 1 / length)
        across = bias.across_at(near * jnp.sqrt(length)) ** 2
        variance = own + across * other
        assumed = own + jnp.maximum(across, LEAST_ASSUMED**2 * along) * other
        z = jnp.abs(told.terms.residual)
        is_wall = told.used & ~seen.on_cap
        counts = is_wall & (z < WITHIN)
        rows = jnp.stack([own, other, z * z * variance]) / assumed[None]
        rows = jnp.where(counts[None], rows, 0)
        # Of rays that are taken for exact, and are not, many are beyond that are none.
        outlies = is_wall & (z >= WITHIN) & (z < 2 * WITHIN) & (across > 0)
        square = jnp.where(outlies, WITHIN**2 / 3 * variance, 0)
        parts = jnp.stack([own, other]) / assumed[None]
        ones = jnp.where(counts, 1, 0).astype(repeats.dtype)
        is_inlier = told.used & (z < WITHIN)
        is_outlier = told.used & ~is_inlier
        width = jnp.where(is_inlier, 1 / told.terms.weight, 2 * body.radius)
        likelihood = [
            jnp.where(pixels.depth > 0, 1, 0).astype(repeats.dtype),
            jnp.where(is_inlier, 1, 0).astype(repeats.dtype),
            jnp.where(is_outlier, 1, 0).astype(repeats.dtype),
            jnp.where(is_inlier, z * z, 0),
            2 * jnp.log(jnp.where(told.used, width, 1)),
        ]
        return (
            product(rows, rows.T),
            product(parts, square / assumed),
            jnp.sum(ones * jnp.sqrt(across)),
            jnp.sum(ones),
            jnp.stack([jnp.sum(part) for part in likelihood]),
        )

    told = problem.of_each(told_by, bodies, readings)
    moments, outliers, taken, weight, likelihood = map(
        jnp.stack, zip(*told, strict=True)
    )
    taken, weight = jnp.sum(taken), jnp.sum(weight)
    # Normal equations whose first unknown, the scale along the rays, is of each view: a
    # view whose noise is told too large would else leave more to the second, of all.
    first, mixed, second = moments[:, 0, 0], moments[:, 0, 1], moments[:, 1, 1]
    share = safe_divide(mixed, first)
    left = jnp.sum(second - share * mixed)
    # Where the incidence hardly changes the two are not told apart.
    is_told = left > 1e-3 * jnp.sum(second)
    inverse = jnp.where(is_told, 1 / jnp.where(is_told, left, 1), 0)
    other = jnp.sum(moments[:, 1, 2] - share * moments[:, 0, 2]) * inverse
    own = safe_divide(jnp.sum(moments[:, 0, 2] - mixed * other), jnp.sum(first))
    of_first, of_second = outliers.T
    sure = other - jnp.sum(of_second - share * of_first) * inverse
    # Squares of normal residuals vary by twice their square.
    deviation = safe_sqrt(2 * inverse * repeats)
    scale = jnp.where(is_told & (own > 0), safe_sqrt(own), 1)
    count, inliers, outliers, squares, widths = jnp.sum(likelihood, axis=0)
    tiny = jnp.finfo(squares.dtype).tiny
    variance = jnp.maximum(safe_divide(squares, inliers), tiny)
    misfit = inliers * (jnp.log(2 * jnp.pi * variance) + 1) + widths
    return AcrossRays(
        deviation=safe_divide(taken, weight),
        found=safe_sqrt(other),
        score=safe_divide(sure, deviation * jnp.maximum(scale, LEAST_SCALE) ** 2),
        doubt=deviation,
        scale=scale,
        misfit=misfit / jnp.maximum(inliers + outliers, 1),
        spread=2 * bodies[0].radius,
        readings=count,
    )
