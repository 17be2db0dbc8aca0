"""Whether readings agree with an estimate: their scatter, and those at a border.

The noise that is given tells how readings scatter about the right shape. And readings
beside the border of a region pull the estimate where the others do, unless they are of
something else: of a table that touches the object, say, or mixed at its edge.
"""

__all__ = ["contradiction", "reduced_chi2", "strays", "tail"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.numerics import product

MOST_STRAY = 0.05
"""Share of the border's readings that may lie elsewhere, beside twice that of the other
readings: the outermost pixels of a mask are a quarter of its border."""

WITHIN_THREE = 0.9733
"""Variance of normal errors within three standard deviations, in that of all."""

FEWEST_WITHIN = 50
"""Readings away from the border with which it is compared."""

LEAST_TESTED = 1e-2
"""Part of a direction's information, in what a part of the terms tells of it, that must
come from the others for the two to be compared."""


def reduced_chi2(
    squares: Float[Array, ""], count: Float[Array, ""]
) -> Float[Array, ""]:
    """Mean square of whitened residuals, of those within three; 1 if normal."""
    return squares / (count * WITHIN_THREE)


def tail(chi2: Float[Array, ""], freedom: Float[Array, ""]) -> Float[Array, ""]:
    """Probability of a larger reduced chi-squared, of hundreds of degrees of freedom.

    References:
        Wilson and Hilferty, The distribution of chi-square, PNAS 1931: its cube root is
        normal.
    """
    variance = 2 / (9 * jnp.maximum(freedom, 1))
    normal = (jnp.cbrt(chi2) - 1 + variance) * jax.lax.rsqrt(variance)
    return jax.scipy.special.erfc(normal * np.sqrt(0.5)) / 2


def contradiction(
    part: Float[Array, "m m"],
    pull_of_all: Float[Array, " k"],
    covariance: Float[Array, "k k"],
) -> Float[Array, ""]:
    """Chi-squared by which a part of the terms pulls away from what all agree on.

    At the minimum the pulls of all terms, gradient times residual, add up to 0; what an
    estimate leaves of that, within its tolerance, is taken to there. The pulls of a
    part with the information P vary about 0 by P - P C P, with the covariance C of all:
    its own error less what the estimate took of it.

    Args:
        part: Products of the part's terms of Jacobian and residual, whitened to a
            variance of 1, in free coordinates.
        pull_of_all: Of all terms, priors included.
        covariance: Of the coordinates.

    Returns:
        The statistic, of as many degrees of freedom as there are coordinates, or less.
    """
    information, pull = part[:-1, :-1], part[:-1, -1]
    pull = pull - product(information, product(covariance, pull_of_all))
    taken = product(information, covariance, information)
    diagonal = jnp.diagonal(information)
    size = jnp.where(
        diagonal > 0, jax.lax.rsqrt(jnp.where(diagonal > 0, diagonal, 1)), 0
    )
    values, vectors = jnp.linalg.eigh(
        (information - taken) * size[:, None] * size[None, :]
    )
    # What the part alone tells leaves no residual to test.
    tested = values > LEAST_TESTED
    along = product(vectors.T, pull * size)
    squares = along**2 / jnp.where(tested, values, 1)
    return jnp.sum(jnp.where(tested, squares, 0))


def strays(
    inlier: Bool[Array, " n"], used: Bool[Array, " n"], beside: Float[Array, " n"]
) -> Bool[Array, ""]:
    """Whether readings at the border lie elsewhere far more often than within.

    Args:
        inlier: Readings on the shape.
        used: All readings.
        beside: How many readings of the border each stands for; 0 for the others.
    """

    def share(weight: Float[Array, " n"]) -> tuple[Array, Array]:
        total = jnp.maximum(jnp.sum(weight), 1)
        return jnp.sum(jnp.where(inlier, 0, weight)) / total, total

    (border, _), (stray, inner) = map(
        share, (jnp.where(used, beside, 0), jnp.where(used & (beside == 0), 1.0, 0.0))
    )
    return (border > MOST_STRAY + 2 * stray) & (inner >= FEWEST_WITHIN)
