"""Errors across the rays, learned with the fit where nobody said how large they are.

Readings are fitted as if rays were exact, or erred by a guess. The residuals tell by
how much they do, and the fit goes on from its estimate with that, until the two agree.
Then it is made anew, from all starts. The likelier of that fit and the one of exact
rays is taken, unless pixels speak clearly.
"""

__all__ = [
    "CLEARLY",
    "SPEAKS",
    "fit_with_learned_rays",
    "likelier",
    "with_learned_rays",
]

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from impostor_jax.fit.regions import typical_sigma
from impostor_jax.fit.result import Fit
from impostor_jax.fit.seen import Seen
from impostor_jax.sensor.across import AcrossRay

FIRST_GUESS = 1 / 3
"""Error across the ray with which points are fitted first, in errors along it: with any
that is not 0 a fit ends so near the truth that its residuals tell the right one."""

SPEAKS = 1.0
"""Standard deviations from which residuals speak for errors across the rays. Of images
with exact rays and white noise 3 % are taken for more, of random scenes 14 %, which
makes them no worse and three times as slow. With 3.5, errors that did not speak yet
biased a radius by up to 1.4 of its standard deviations."""

MOST_ROUNDS = 8
"""Fits with an error that is learned."""

SETTLED = 0.03
"""Change of that error, over itself, with which it is known."""

SURE = 6.0
"""Standard deviations up to which pixels that speak for errors across the rays may do
so for what these errors let the wall become. Of an arc of 30 degrees they make a wall
of a smaller radius, of which they are found to be larger, and so on, to 4.5."""

CLEARLY = 10.0
"""Twice the nats by which readings have to be likelier by another fit of the same
errors: between ends that noise leads to it differs by less."""

BY_CHANCE = 0.1
"""Part of readings that are outliers each by itself."""

UNCLEAR = 3.5
"""Standard deviations up to which a fit of exact rays stands where one that allows for
errors fails: it is off by at most 1.4 of its own."""

ENOUGH = 0.6
"""Part of the readings that a fit with a larger error keeps, at least: beside a rim it
leaves out what may be of either surface."""


def fit_with_learned_rays(
    fitted: Callable[[Sequence[Seen]], Fit],
    resumed: Callable[[Sequence[Seen], Fit], Fit],
    seen: Sequence[Seen],
    known: float | None,
) -> Fit:
    """The fit of an object whose readings may err across their rays.

    Args:
        fitted: How to fit what is seen of it.
        resumed: How to go on with that from a fit, with no other start.
        seen: The object in each of its images.
        known: Standard deviation that rounding alone makes, in all directions; None for
            images, whose rays are exact until their readings say otherwise.
    """
    if not all(one.noise.bias.has_exact_rays for one in seen):
        # The caller says what the sensor's are; rounding comes to that.
        return fitted(seen if known is None else _erring(seen, _Error(known), known))
    exact, is_image = None, known is None
    if known is None:
        fit = fitted(seen)
        if not (fit.is_shape and fit.across.score.item() > SPEAKS):
            return fit
        exact, across, known = fit, _found(fit, 0.0), 0.0
    else:
        along = [typical_sigma(one.image, one.region, one.noise) for one in seen]
        guess = max(FIRST_GUESS * float(np.median(along)), known)
        fit = fitted(_erring(seen, _Error(guess), known))
        across = _found(fit, known)
    told = fit
    for _ in range(MOST_ROUNDS if fit.is_shape else 0):
        told = resumed(_erring(seen, across, known), fit)
        if not (told.is_shape and told.num_inliers >= ENOUGH * fit.num_inliers):
            # With so much little is known, and what is left would tell of still more.
            break
        fit, found = told, _found(told, known)
        settled = abs(found.size - across.size) <= SETTLED * across.size
        across = found
        if settled:
            break
    if exact is None:
        without = _erring(seen, _Error(known), known)
        exact = fitted(without)
        if fit.is_shape:
            # Nor may errors that are guessed lead to the wall alone.
            exact = likelier(exact, resumed(without, fit))
    # Only now: of a guess that is too large nothing speaks for what is small.
    score = fit.across.score.item()
    if not score > SPEAKS:
        return likelier(exact, fit)
    fit = fitted(_erring(seen, across, known))
    if not fit.status.has_numbers:
        # Of errors as large as the object; what went on from the readings says why.
        fit = told
    if not fit.is_shape:
        return exact if score <= UNCLEAR and exact.is_shape else fit
    if is_image and max(score, fit.across.score.item()) > SURE:
        return fit
    return likelier(fit, exact, by=0.0)


def with_learned_rays(seen: Seen, known: float) -> Seen:
    """What a fit is given first, in kind, of points rounded by so much."""
    (erring,) = _erring([seen], _Error(known), known)
    return erring


class _Error(NamedTuple):
    """An error across the rays.

    Attributes:
        size: Its standard deviation, in meters.
        doubt: Standard deviation of the square of that; 0 if it is known.
    """

    size: float
    doubt: float = 0.0


def likelier(one: Fit, other: Fit, by: float = CLEARLY, by_chance: bool = True) -> Fit:
    """The first of two fits, or the other if readings are likelier by that.

    Whatever lies beside a wall, and is not of it, grazes it: taken for errors across
    the rays it moves the wall, of which more grazes, and so on. As outliers it makes
    the readings likelier, and an oval wall, of which much would be outliers, does not.

    Args:
        one: A fit.
        other: Another of the same readings, or of some of them.
        by: Twice the nats by which they have to be.
        by_chance: Whether a reading is an outlier by itself, and not of another thing.
    """
    if not (one.is_shape and other.is_shape):
        return other if other.is_shape else one
    count = max(fit.across.readings.item() for fit in (one, other))
    gain = _misfit(one, count, by_chance) - _misfit(other, count, by_chance)
    return other if gain > by else one


def _misfit(fit: Fit, count: float, by_chance: bool) -> float:
    """Of so many readings; all that a fit leaves out are outliers."""
    own, inliers = fit.across.readings.item(), fit.num_inliers
    outlying = (count - own) * 2 * math.log(fit.across.spread.item())
    misfit = own * fit.across.misfit.item() + outlying
    if by_chance:
        misfit -= 2 * math.log(BY_CHANCE) * (count - inliers)
    return misfit


def _found(fit: Fit, known: float) -> _Error:
    """What the residuals say, and no less than is known."""
    found = fit.across.found.item()
    return _Error(found, fit.across.doubt.item()) if found > known else _Error(known)


def _erring(seen: Sequence[Seen], across: _Error, along: float) -> list[Seen]:
    """The same with noise across the rays, and more along them."""
    dtype = seen[0].image.dtype
    errors = [jnp.asarray(x, dtype) for x in (across.size, along, across.doubt)]
    return [one._replace(noise=AcrossRay(one.noise, *errors)) for one in seen]
