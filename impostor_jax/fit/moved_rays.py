"""Readings that err across their rays, compared with a round wall without a bias.

A reading errs by s along its ray and by a across it. With its place y along the ray,
from the nearest approach to the wall's axis, and the squared half-chord q of the ray,
its squared distance from that axis less the squared radius is F = y^2 - q. It varies
by 4 (h s^2 + c^2 a^2) + 2 s^4 + 2 a^4, where the point that was read lies the root of h
along the ray and c across it from the axis. How F is distributed depends on what chose
the readings.

Pixels of an image are chosen by their rays, as a mask does: the true ray lies beside
the one that is known, and meets the wall. Its distance u from the axis is normal about
that of the known ray, c, and at most the radius R, so that with b = (R - c) / a and
m = pdf(b) / cdf(b) the mean of u^2 is c^2 - 2 a c m + a^2 (1 - b m), and F is s^2 more
than c^2 less that. It is so for each ray, wherever a mask ends.

Points are chosen by where they lie, however dense: the expectation of F is s^2 + a^2,
given the true point. Nobody knows that. Taken from the ray alone, h follows the error
across it, and from the reading alone the error along it; both bias a radius. The
likeliest point, which shares F in the ratio of the parts of its variance, is not
correlated with F, to first order. An error across the ray in its plane with the axis
moves a reading along both: the first as one along the ray does, and the second against
that, so that the likeliest point lies off the ray, along the axis.

With a = 0 both are the comparison of exact rays; with a = s the latter is of orthogonal
distances, without its bias of second order. The former, of points, is wrong where they
are evenly spread over a wall and not over rays; the latter, of images, where a mask
cuts the wall's outline off: by 8 a^2 / R where it is the true one, 30 a^2 / R two
pixels inside of that.

References:
    Fuller, Measurement error models (1987), section 3.2, of implicit functions; the
    likeliest point is that of Sampson (1982), iterated. Berkson, Are there two
    regressions? (1950), of errors beside what is controlled.
"""

__all__ = ["GRAZING", "OUTLIER", "MovedRays", "moved_rays", "parts_of_variance"]

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.scipy.stats import norm
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.body import AbstractBody, Passing
from impostor_jax.fit.problem import Pixels
from impostor_jax.numerics import Numbers, safe_divide, safe_sqrt
from impostor_jax.sensor.bias import Bias

ROUNDS = 3
"""Times that the likeliest point is shared out anew; of readings within four standard
deviations it then moves by less than a hundredth of one."""

OUTLIER = 4.0
"""Standard deviations beyond which a reading is not squared, which would make it a
lever: squares of outliers only ever widen a wall. With 10, ten percent of them within
0.1 m took up to 14 standard deviations off the radii of thin rods."""

GRAZING = 4.0
"""Half-chord, in standard deviations of a reading, below which its square is skewed,
and is what is compared where rays are exact.

From there on the bend of the square root moves a reading's expectation by less than
1/32 of its standard deviation.
"""

STEEPEST_CAP = 0.02
"""Least cosine of the incidence at which a cap's readings are weighed."""

MOST_INSIDE = 12.0
"""Errors across the ray by which it passes inside the outline, beyond which that is as
if the wall had none: the density there is 1e-32."""

LEAST_ACROSS = 1e-3
"""Error across the ray, in errors along it, that rays have which are said to be exact:
of none the laws here divide 0 by 0 in places, and 3 of 80 fits with outliers failed."""


class MovedRays(NamedTuple):
    """Rays to likely points of a wall, and what is compared there.

    All are in units of the ray parameter, in which a reading is a depth.

    Attributes:
        passing: How they pass the body.
        squares: Squared radius less squared distance of a reading, each over A, as they
            are on average 0.
        weight: Inverse of the standard deviation of a depth there.
        steadiness: By how much the mean of `squares` falls as the half-chord's square
            of the known ray does.
        is_skewed: Whether they are distributed so.
    """

    passing: Passing
    squares: Float[Array, " n"]
    weight: Float[Array, " n"]
    steadiness: Float[Array, " n"]
    is_skewed: Bool[Array, " n"]


class _Rays(NamedTuple):
    """What both laws of F are made of, over A.

    Attributes:
        along: Variance along the ray.
        across: Variance across it, in square meters.
        q: Squared half-chord of the known ray.
        radius: Squared radius.
        inverse: One over A.
        slant: Inverse of A less that of the ray's squared length: how an error in the
            plane of the ray and the axis moves a reading along the ray.
        bends: As of `AbstractBody`.
    """

    along: Numbers
    across: Numbers
    q: Numbers
    radius: Numbers
    inverse: Numbers
    slant: Numbers
    bends: int


class _Law(NamedTuple):
    """How F, over A, is distributed.

    Attributes:
        mean: Its expectation.
        h: Squared place of the point along the ray.
        variance: A quarter of its variance.
        steadiness: As of `MovedRays`.
    """

    mean: Numbers
    h: Numbers
    variance: Numbers
    steadiness: Numbers


def moved_rays(
    pixels: Pixels,
    body: AbstractBody,
    bias: Bias,
    seen: Passing,
    sigma: Float[Array, " n"],
    folded: Float[Array, " n"],
    reach: Float[Array, " n"],
    is_image: bool | Bool[Array, ""],
) -> MovedRays:
    """What readings are compared with, given that their rays err.

    Args:
        pixels: The readings.
        body: The estimate, in the camera frame.
        bias: Of the sensor, whose rays are not exact.
        seen: How the rays pass the body.
        sigma: Standard deviations of the readings along their rays, as depths.
        folded: Squared places of the readings along them, from the nearest approach;
            negative of those far behind it.
        reach: These places.
        is_image: Whether the readings were chosen by their rays.
    """
    d = seen.local.direction
    length, inverse = d.dot(d), jnp.abs(seen.inverse)
    along = sigma * sigma
    across = bias.across_at(pixels.depth * jnp.sqrt(length)) ** 2
    across = jnp.maximum(across, LEAST_ACROSS**2 * along)
    radius = body.wall_square(seen) * inverse
    slant = jnp.maximum(inverse - 1 / length, 0)
    rays = _Rays(along, across, seen.square, radius, inverse, slant, body.bends)
    squares = seen.square - folded

    def by_rays() -> tuple[_Law, Passing]:
        law = _by_rays(rays)
        return law, eqx.tree_at(lambda p: p.square, seen, law.h)

    def by_points() -> tuple[_Law, Passing]:
        law = _by_points(rays, squares)
        share = safe_divide(across * inverse * squares, 2 * law.variance)
        return law, body.moved_across(
            seen, law.h, -seen.sign * safe_sqrt(law.h) * share
        )

    law, passing = jax.lax.cond(is_image, by_rays, by_points)
    squares = squares + law.mean
    # Beyond a few deviations by the distance from the axis, and what that varies by:
    # squares of outliers only ever widen a wall, and a wall of no size has none. What
    # lies behind the axis counts as beyond it, as far as it is: taken for nearer, a
    # tenth of the readings pulled a can's radius 5 deviations off.
    beyond = safe_sqrt(radius - seen.square + reach * reach)
    apart = jnp.where(folded < 0, -beyond, safe_sqrt(radius - squares))
    steepness = safe_divide(law.h, radius)
    of_distance = steepness * along
    of_distance += jnp.maximum(inverse - steepness / length, 0) * across
    tiny = jnp.finfo(law.variance.dtype).tiny
    from_axis = safe_sqrt(radius) - apart
    from_axis *= jnp.sqrt(law.variance / jnp.maximum(of_distance, tiny))
    is_far = jnp.abs(squares) > 2 * OUTLIER * jnp.sqrt(law.variance)
    is_skewed = law.variance < GRAZING**2 * (along**2 + (across * inverse) ** 2)
    on_cap = across * (1 / jnp.maximum(seen.cos_incidence, STEEPEST_CAP) ** 2 - 1)
    of_depth = jnp.where(
        seen.on_cap, along + on_cap / length, law.variance / (law.h + along / 2)
    )
    return MovedRays(
        passing=passing,
        squares=jnp.where(is_far, 2 * from_axis, squares),
        weight=jax.lax.rsqrt(of_depth),
        steadiness=law.steadiness,
        is_skewed=is_skewed & ~is_far,
    )


def _by_rays(rays: _Rays) -> _Law:
    """The law of F given the ray that is known, and that the true one meets the wall.

    Moments of a normal distribution cut off above are those of, e.g., Johnson, Kotz and
    Balakrishnan, Continuous univariate distributions (1994), section 13.10.1.
    """
    aside = safe_sqrt(rays.radius - rays.q)
    w = safe_sqrt(rays.across * rays.inverse)
    tiny = jnp.finfo(w.dtype).tiny
    inside = (safe_sqrt(rays.radius) - aside) / jnp.maximum(w, tiny)
    b = jnp.clip(inside, -MOST_INSIDE, MOST_INSIDE)
    m = jnp.exp(norm.logpdf(b) - norm.logcdf(b))
    first, second = -m, 1 - b * m
    third, fourth = 2 * first - b * b * m, 3 * second - b**3 * m
    # Of a ball, an error beside the other moves it away from the center, too.
    beside = (rays.bends - 2) * w * w
    h = rays.q - 2 * aside * w * first - w * w * second - beside
    h = jnp.maximum(h, 0)
    along = rays.along + rays.across * rays.slant
    steadiness = second - first * first
    spread = aside * aside * steadiness + aside * w * (third - first * second)
    spread = spread + w * w * (fourth - second * second) / 4
    variance = w * w * jnp.maximum(spread, 0) + beside * beside / 2
    variance += h * along + along * along / 2
    return _Law(
        mean=along + h - rays.q,
        h=h,
        variance=variance,
        steadiness=steadiness,
    )


def _by_points(rays: _Rays, squares: Numbers) -> _Law:
    """The law of F given the true point, at the one that is likeliest."""
    bends = rays.slant + (rays.bends - 1) * rays.inverse
    straight = rays.inverse - rays.slant
    twice = (rays.across * bends) ** 2 / 2

    def parts(h: Numbers) -> tuple[Numbers, Numbers]:
        """A quarter of the variance that errors along the ray make, and across it."""
        steep = rays.radius * rays.inverse
        own, beside = parts_of_variance(h, rays.along, steep, straight)
        return own, rays.across * beside + twice

    h = jnp.clip(rays.q - squares / 2, 0, rays.radius)
    for _ in range(ROUNDS):
        own, other = parts(h)
        # An error across the ray, in its plane with the axis, moves the place along it.
        aside = other - rays.across * rays.slant * h
        h = jnp.clip(rays.q - squares * safe_divide(aside, own + other), 0, rays.radius)
    own, other = parts(h)
    return _Law(
        mean=rays.along + rays.across * bends,
        h=h,
        variance=own + other,
        steadiness=jnp.ones_like(h),
    )


def parts_of_variance(
    h: Numbers, along: Numbers, steep: Numbers, straight: Numbers
) -> tuple[Numbers, Numbers]:
    """A quarter of the variance of F, over A, that errors of a reading make.

    Args:
        h: Squared place of the point along the ray.
        along: Variance along the ray.
        steep: Squared half gradient of the wall's quadric there, over A^2: its squared
            radius over that.
        straight: One over the squared length of the ray's direction.

    Returns:
        By errors along the ray, of second order, too; and by an error across it of one
        meter.
    """
    return h * along + along * along / 2, jnp.maximum(steep - h * straight, 0)
