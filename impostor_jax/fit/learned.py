"""Errors across the rays, learned with the fit where nobody said how large they are.

Readings are fitted as if rays were exact, or erred by a guess. The residuals tell by
how much they do, and the fit goes on from its estimate with that, until the two agree.
Then it is made anew, from all starts.
"""

__all__ = ["fit_with_learned_rays"]

from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np

from impostor_jax.fit.regions import typical_sigma
from impostor_jax.fit.result import Fit, each_of
from impostor_jax.fit.seen import Seen
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.sensor.across import AcrossRay

FIRST_GUESS = 1 / 3
"""Error across the ray with which points are fitted first, in errors along it: with any
that is not 0 a fit ends so near the truth that its residuals tell the right one."""

SPEAKS = 1.0
"""Standard deviations from which the residuals of an image speak for errors across the
rays. Of exact rays one fit in ten is taken for more, as good as the others and three
times as slow; from 3.5 on errors that are left out bias a radius by 1.4 of its standard
deviations before they speak (`experiments/cross_ray_noise`)."""

MOST_ROUNDS = 8
"""Fits with an error that is learned."""

SETTLED = 0.03
"""Change of that error, over itself, with which it is known."""


def fit_with_learned_rays(
    fitted: Callable[[Sequence[Seen]], Fit],
    resumed: Callable[[Sequence[Seen], AbstractPrimitive], Fit],
    seen: Sequence[Seen],
    known: float | None,
) -> Fit:
    """The fit of an object whose readings may err across their rays.

    Args:
        fitted: How to fit what is seen of it.
        resumed: How to go on with that from an estimate, with no other start.
        seen: The object in each of its images.
        known: Standard deviation that rounding alone makes, in all directions; None for
            images, whose rays are exact until their readings say otherwise.
    """
    if not all(one.noise.bias.has_exact_rays for one in seen):
        # The caller says what the sensor's are; rounding comes to that.
        return fitted(seen if known is None else _erring(seen, known, known))
    if known is None:
        fit = fitted(seen)
        if not (fit.is_shape and fit.across.score.item() > SPEAKS):
            return fit
        across, known = fit.across.found.item(), 0.0
    else:
        along = [typical_sigma(one.image, one.region, one.noise) for one in seen]
        guess = max(FIRST_GUESS * float(np.median(along)), known)
        fit = fitted(_erring(seen, guess, known))
        across = _found(fit, known)
    for _ in range(MOST_ROUNDS):
        if not fit.is_shape:
            break
        fit = resumed(_erring(_within(seen, fit), across, known), fit.shape)
        found = _found(fit, known)
        settled = abs(found - across) <= SETTLED * across
        across = found
        if settled:
            break
    return fitted(_erring(seen, across, known))


def _found(fit: Fit, known: float) -> float:
    """What the residuals say, and no less than is known."""
    return max(float(fit.across.found), known)


def _erring(seen: Sequence[Seen], across: float, along: float) -> list[Seen]:
    """The same with noise across the rays, and more along them."""
    dtype = seen[0].image.dtype
    errors = jnp.asarray(across, dtype), jnp.asarray(along, dtype)
    return [one._replace(noise=AcrossRay(one.noise, *errors)) for one in seen]


def _within(seen: Sequence[Seen], fit: Fit) -> list[Seen]:
    """What a fit took for the object's."""
    regions = [np.asarray(region) for region in each_of(fit.region)]
    return [
        one._replace(region=region) for one, region in zip(seen, regions, strict=True)
    ]
