"""Whether an image shows the noise of single readings that a caller tells.

Pipelines blur depth, fill its holes, enlarge it. What is left of the noise is less than
the sensor's, and neighbors share it: a bilateral filter of seven pixels leaves a fifth
of the deviation. A fit that takes readings for independent was up to 42 of its
deviations off, with residuals that seemed good.

Careful people tell too much noise. What grazes a wall is compared in squares, from
which the squared noise is taken: told twice, it bent radii by four deviations on the
mean, and where nothing was told they were right. So it did where a model says that
noise grows towards grazing, and that of the images does not: by 1.5.
"""

__all__ = [
    "FEWEST",
    "LESS",
    "OVERSTATED",
    "grows_less",
    "less_noise",
    "shared_errors",
]

import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.gather import passed_by
from impostor_jax.fit.measured import with_measured
from impostor_jax.fit.per_pixel import PerPixelNoise, law_of
from impostor_jax.fit.problem import RayList, sigma_of
from impostor_jax.fit.regions import typical_sigma
from impostor_jax.fit.request import Given
from impostor_jax.fit.result import Fit
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.surface import cropped
from impostor_jax.primitives.base import in_camera_frame
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.gaussian import ConstantNoise

ALIKE = "Neighbors err alike, as in depth that was filtered; sigma is not all. "
"""What a reader is told before what was measured instead."""

LEAST_ALIKE = 0.25
"""Correlation of neighbors' residuals from which they are alike: of white noise it is
within 0.05, of a median over 5 x 5 pixels 0.15 to 0.5, of a bilateral filter or a
Gaussian of one pixel 0.35 to 0.85."""

MOST_OWN = 0.6
"""Variance that is each reading's own, over what was given, at most: a wall that is not
the shape's makes neighbors alike as well, and leaves all of it."""

FEWEST = 200
"""Pairs of neighbors that tell, or readings on the shape."""

OVERSTATED = 0.8
"""Chi-squared up to which the noise that was told is more than the image shows."""

SLANTED = 1.5
"""Deviation that a model says of readings, over that of a surface face on, from which
they tell whether it grows so."""

LESS_SLANTED = 0.5
"""Chi-squared of these up to which it does not: of noise as it says it is 0.7 to 1.1,
of as much at any incidence 0.2 to 0.45."""

LESS = "Readings scatter by {times:.2g} of sigma. "
"""What a reader is told before what was measured instead."""

LESS_THERE = "Readings of slanted surfaces scatter by {times:.2g} of sigma. "
"""The same."""


def shared_errors(
    fit: Fit, views: Sequence[Given], seen: Sequence[Seen]
) -> tuple[Any, str] | None:
    """The noise that images tell instead of the one that was given, and in words.

    None where neighbors err by themselves, or images tell no errors that they share.
    The scale is counted, as where nothing is told: what a filter does to a wall that
    bends is no noise, and without it 4 of 36 fits were 4 to 7 of their deviations off.

    Args:
        fit: To the images with the noise that was given, concrete.
        views: As they were given.
        seen: The object in each of them.
    """
    if not _neighbors_err_alike(fit, seen):
        return None
    sigmas, sigma, told = _measured(views)
    if any(one is None or _is_white(one) for one in sigmas):
        return None
    return sigma, ALIKE + told


def less_noise(
    fit: Fit, kind: type[AbstractBody], views: Sequence[Given], seen: Sequence[Seen]
) -> tuple[Any, str] | None:
    """The same where readings scatter by less than was told.

    All of them, or those of surfaces that are slanted, if each errs by itself. None
    where images do not tell how much that is, as those that were drawn without, and
    where it was told pixel by pixel.

    Args:
        fit: As of `shared_errors`.
        kind: The body that was fitted.
        views: As they were given.
        seen: The object in each of them.
    """
    if not fit.is_shape or not _is_law(seen) or fit.num_inliers < FEWEST:
        return None
    chi2, slanted = fit.chi2.item(), _chi2_of_slanted(fit, kind, seen)
    is_less = chi2 <= OVERSTATED
    # By errors across rays these would scatter more.
    is_less_there = slanted < LESS_SLANTED
    if not (is_less or is_less_there):
        return None
    sigmas, sigma, told = _measured(views)
    if any(one is None for one in sigmas):
        return None
    of_told = [
        _level(one, own) / _level(own.noise, own)
        for one, own in zip(sigmas, seen, strict=True)
    ]
    if is_less and max(of_told) < OVERSTATED**0.5:
        return sigma, LESS.format(times=math.sqrt(chi2)) + told
    is_less_there &= all(map(_is_white, sigmas))
    if is_less_there and max(of_told) < SLANTED:
        return sigma, LESS_THERE.format(times=math.sqrt(slanted)) + told
    return None


def grows_less(fit: Fit, kind: type[AbstractBody], seen: Sequence[Seen]) -> bool:
    """Whether noise grows by less towards grazing than a model of it says.

    Args:
        fit: Of the images with that model, concrete.
        kind: The body that was fitted.
        seen: The object in each of them.
    """
    return _is_law(seen) and _chi2_of_slanted(fit, kind, seen) < LESS_SLANTED


def _is_law(seen: Sequence[Seen]) -> bool:
    """Whether all that is told of noise is a law of single readings.

    An error of scale that is told would be lost where noise is measured.
    """
    noises = [one.noise for one in seen]
    return not any(
        isinstance(one, PerPixelNoise) or one.bias.scales or not _is_white(one)
        for one in noises
    )


def _chi2_of_slanted(fit: Fit, kind: type[AbstractBody], seen: Sequence[Seen]) -> float:
    """Of readings whose noise grows with incidence; NaN of too few."""
    squares = []
    for one in seen:
        if isinstance(one.noise, ConstantNoise):
            continue
        _, _, rays = one.rays()
        own = in_camera_frame(kind.of(fit.shape), one.camera)
        off, is_slanted = map(np.asarray, _slanted(rays, own, law_of(one.noise)))
        squares.append(off[is_slanted & (np.abs(off) < 3)].astype(float) ** 2)
    counted = np.concatenate([*squares, np.zeros(0)])
    return float(np.mean(counted)) if len(counted) >= FEWEST / 2 else np.nan


@jax.jit
def _slanted(
    rays: RayList, body: AbstractBody, noise: AbstractDepthNoise
) -> tuple[Float[Array, " n"], Bool[Array, " n"]]:
    """How many deviations readings lie off a body, and which are of slanted walls."""
    pixels, seen, read, sigma = passed_by(rays, body, noise)
    near = jnp.where(read, pixels.depth, 1)
    face_on = sigma_of(noise, pixels, near, jnp.ones_like(near))
    is_slanted = read & ~seen.is_missed & (sigma > SLANTED * face_on)
    return (pixels.depth - seen.depth) / sigma, is_slanted


def _measured(views: Sequence[Given]) -> tuple[list[Any], Any, str]:
    """The noise of each view where nothing is told, that of all, and in words."""
    untold = [view._replace(sigma=None) for view in views]
    found, sigma, told = with_measured(untold, None)
    return [view.sigma for view in found], sigma, told


def _level(noise: AbstractDepthNoise, seen: Seen) -> float:
    return typical_sigma(seen.image, seen.region, noise)


def _neighbors_err_alike(fit: Fit, seen: Sequence[Seen]) -> bool:
    """Whether readings share their errors, whose noise was told as their own."""
    if not fit.is_shape or not all(_is_white(one.noise) for one in seen):
        return False
    count = products = squares = 0.0
    for told in fit.pixelwise:
        is_on = np.asarray(told.inliers)
        box = cropped(is_on)
        is_on, residual = is_on[box], np.asarray(told.residuals)[box].astype(float)
        pairs = (np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])
        for first, second in pairs:
            both = is_on[first] & is_on[second]
            one, other = residual[first][both], residual[second][both]
            count += len(one)
            products += float(one @ other)
            squares += float(one @ one + other @ other) / 2
    if count < FEWEST or not squares > 0:
        return False
    alike = products / squares
    return alike > LEAST_ALIKE and (1 - alike) * fit.chi2.item() < MOST_OWN


def _is_white(noise: AbstractDepthNoise) -> bool:
    """Whether all that is told of a sensor is how far single readings scatter."""
    bias = noise.bias
    return not (bias.errs_at_edges or bias.fields or bias.lean is not None)
