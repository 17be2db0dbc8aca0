"""What the scatter of readings tells of a body: how steeply their rays meet it.

The standard deviation of a sensor may grow with incidence, and weights that follow the
estimate then follow its error: a rod that is too thick looks less grazed, so the
readings beside its outline weigh more, and their scatter is taken for thickness. The
likelihood of a reading has log sigma beside z^2 / 2, whose gradient (1 - z^2) d log
sigma pulls the other way; it has the information 2 (d log sigma)^2. Where noise is
small beside the radius the depths tell far more, and this is left out.
"""

__all__ = ["scatter_products"]

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.fit.agreement import WITHIN_THREE
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.evidence import Readings
from impostor_jax.fit.problem import Pixels, View, sigma_of
from impostor_jax.numerics import product, safe_divide
from impostor_jax.sensor.gaussian import ConstantNoise

DEEP = 0.05
"""Noise in radii from which scatter counts, and then ever more. With less, two of three
fits of a rod with 3 % and a tenth of outliers were led astray."""

MOST_SHARE = 0.3
"""Most of what it says that counts. That is enough to hold the weights, and outliers
within three standard deviations, which scatter more, too, widen a rod less."""


def scatter_products(
    view: View,
    nominal: Float[Array, ""],
    pixels: Pixels,
    body: AbstractBody,
    readings: Readings,
    scale: Float[Array, ""],
) -> Float[Array, "k k"]:
    """Products of terms of [gradient, residual], in tangent coordinates.

    Readings beyond three standard deviations, which outliers may be, say nothing, and
    no more do caps: rays meet them at nearly one angle.

    Args:
        view: Whose readings they are.
        nominal: Typical standard deviation of a reading, in meters.
        pixels: Some of the readings.
        body: The estimate, in the view's frame.
        readings: As they are compared with it.
        scale: Spread of the readings, in standard deviations of the sensor.
    """
    size = readings.terms.augmented.shape[0]
    blank = jnp.zeros((size, size), scale.dtype)
    if isinstance(view.noise, ConstantNoise):
        return blank
    share = jnp.clip(nominal / (DEEP * body.radius) - 1, 0, MOST_SHARE)

    def products() -> Float[Array, "k k"]:
        seen, used = readings.passing, readings.used
        counts = used & ~seen.on_cap & (seen.square > 0)
        near = jnp.clip(seen.depth, pixels.depth / 2, 2 * pixels.depth)
        near = jnp.where(counts, near, 1)
        cosine = seen.cos_incidence
        sigma, slope = jax.jvp(
            lambda c: sigma_of(view.noise, pixels, near, c),
            (cosine,),
            (jnp.ones_like(cosine),),
        )
        squared = ((seen.depth - pixels.depth) / (scale * sigma)) ** 2
        weight = jnp.where(counts & (squared < 9), jnp.sqrt(2 * share), 0)
        # The cosine is the half-chord over the radius, but for what is across the axis.
        # That the radius divides it counts for little where rays graze.
        in_square = slope / sigma * cosine * safe_divide(seen.half_slope, seen.half)
        in_square = jnp.where(counts, in_square, 0)
        zero = jnp.zeros_like(in_square)
        gradient = body.of_reading(seen, zero, in_square, jnp.zeros(zero.shape, bool))
        residual = (WITHIN_THREE - squared) / 2
        terms = jnp.stack([*gradient, residual]) * weight[None]
        return product(terms, terms.T)

    return jax.lax.cond(share > 0, products, lambda: blank)
