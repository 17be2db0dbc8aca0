"""Covariance of a fit, from the Jacobian of its whitened residuals.

Independent residuals: the inverse of the information J^T J. Residuals that are
correlated between neighboring pixels, as those of real sensors are: the sandwich
(J^T J)^-1 M (J^T J)^-1, where M sums the products of the gradients of two pixels times
the correlation of residuals at their distance in the image, which is measured on the
fit's own residuals.

Covariances are kept as roots R, so that R R^T is the covariance: a single-precision
product of three matrices, of an image that hardly tells a direction, rounds to a
negative variance.
"""

__all__ = ["covariance_root", "propagated", "sandwich_root", "score_covariance"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.fit.problem import Lattice
from impostor_jax.numerics import eps, product, safe_divide

MAX_LAG = 13
"""Distance in pixels, along rows and columns, at which residuals are taken for
uncorrelated."""

WINDOW = 5.0
"""Standard deviation in pixels of the Gaussian that fades correlations out towards
there. It keeps the covariance positive, as Bartlett's triangle does, but takes less
from short distances: errors whose correlation is 1/e at 3 pixels keep 0.85 of their
variance and not, as with a triangle of eight pixels, 0.62."""

MOST_TAKEN = 0.5
"""Most of the correlation that a fit may have taken from its residuals; on fewer pixels
than that makes, standard deviations are too small."""

MOST_PLACES = 16
"""Places of a lattice, over its pixels, up to which sums over all pairs take less time
by spectra: of 30,000 pixels of a can 0.04 s for 0.4. Pixels that were thinned lie
farther apart."""

LAGS = np.array(
    [
        (down, right)
        for down in range(MAX_LAG)
        for right in range(-MAX_LAG + 1, MAX_LAG)
        if (down, right) > (0, 0)
    ]
)
"""Rows down and columns right between two pixels that may be correlated, of which each
pair is one."""

FADING = np.exp(-np.sum((LAGS / WINDOW) ** 2, axis=1) / 2)
"""The window at these."""

OWN_ROUNDING = 64
"""Spacings of numbers, of the most that any coordinate moves a quantity, up to which
one that is free moves it by rounding: of a pole that leans by 8e-6 a place across it is
known. With a thousandth for all, places of poles that lean by up to 0.1 degrees were
called known, and were 16 to 84 deviations off."""

MIXED = 1e-3
"""The same, as a part of that, of a free direction of several coordinates."""

LEAST_LEFT = 0.25
"""Part of the variance of independent residuals that correlated ones leave at least,
half of a deviation: measured correlations are noisy, and as a whole may be those of no
errors that there are."""


def covariance_root(
    information: Float[Array, "n n"],
) -> tuple[Float[Array, "n n"], Float[Array, "n n"], Bool[Array, " n"]]:
    """Root of the inverse of an information, J^T J of whitened residuals.

    Returns:
        R, where R R^T is the covariance over the directions that the residuals
        determine, and R^T J^T J R the identity there; directions, of unit length, as
        columns; and which of these they leave free.
    """
    diagonal = jnp.diagonal(information)
    depends = diagonal > 0
    size = jnp.where(depends, jax.lax.rsqrt(jnp.where(depends, diagonal, 1)), 1)
    correlation = information * size[:, None] * size[None, :]
    # Coordinates of which nothing tells are directions of their own, with no others.
    order = np.arange(len(size), dtype=size.dtype)
    correlation -= jnp.diag(jnp.where(depends, 0, 1 + order))
    values, vectors = jnp.linalg.eigh(correlation)
    vectors = jnp.where(values < -0.5, jnp.round(vectors), vectors)
    # An eigenvalue within rounding of 0 is a direction that the image leaves free.
    free = values < eps(values.dtype, 4 * values.shape[0])
    directions = size[:, None] * vectors
    root = jnp.where(free, 0, jax.lax.rsqrt(jnp.where(free, 1, values)))
    return (
        directions * root[None, :],
        directions * jax.lax.rsqrt(jnp.sum(directions**2, axis=0))[None, :],
        free,
    )


def sandwich_root(
    root: Float[Array, "n n"], middle: Float[Array, "n n"], least: float = 0.0
) -> Float[Array, "n n"]:
    """Root of a sandwich R M R^T.

    Args:
        root: R, of `covariance_root`.
        middle: M, the identity where residuals are independent.
        least: Smallest eigenvalue that it is taken to have; those below are rounding,
            or of measured correlations that no errors have.
    """
    values, vectors = jnp.linalg.eigh((middle + middle.T) / 2)
    return product(root, vectors) * jnp.sqrt(jnp.maximum(values, least))[None, :]


def propagated(
    change: Float[Array, "m n"],
    root: Float[Array, "n n"],
    directions: Float[Array, "n n"],
    free: Bool[Array, " n"],
) -> tuple[Float[Array, "m m"], Bool[Array, " m"]]:
    """Covariance of quantities, and which of them the image determines.

    Args:
        change: Derivative of the quantities in the coordinates.
        root: Of the covariance of the coordinates.
        directions: As `covariance_root` returns them.
        free: Which of them the image leaves free.
    """
    moved = jnp.where(free[None], jnp.abs(product(change, directions)), 0)
    # A quantity moves along a free direction by more than rounding: little where that
    # is a coordinate's own, and what is nearly free turns the others.
    is_own = jnp.sum(directions != 0, axis=0) == 1
    rounding = jnp.where(is_own, eps(change.dtype, OWN_ROUNDING), MIXED)
    total = jnp.max(jnp.abs(change), axis=1)
    observed = jnp.all(moved <= rounding[None] * total[:, None], axis=1)
    changed = product(change, root)
    of_quantities = product(changed, changed.T)
    both = observed[:, None] & observed[None, :]
    return jnp.where(both, of_quantities, 0), observed


def score_covariance(
    gradient: Float[Array, "n k"],
    residual: Float[Array, "r n"],
    lattice: Lattice,
) -> Float[Array, "r k k"]:
    """Covariance of the sum of gradient times residual, over correlated pixels.

    The correlation at each distance is the mean product of residuals there, times a
    window. A fit takes from its residuals one smooth pattern for each of the k
    coordinates, and so from the sum over a window of W pixels a part k W / n, which is
    given back.

    Args:
        gradient: Of the whitened residuals; 0 for terms that do not count.
        residual: Whitened, of one fit or more; 0 for terms that do not count, which are
            the same in all.
        lattice: Where the pixels lie to each other.

    References:
        Conley (1999), "GMM estimation with cross sectional dependence".
    """
    counts = jnp.where(residual[0] != 0, 1, 0).astype(residual.dtype)
    count = jnp.sum(counts)
    pixels = gradient.shape[1] * (1 + 2 * float(np.sum(FADING)))
    taken = jnp.minimum(pixels / jnp.maximum(count, 1), MOST_TAKEN)
    sums = jnp.sum(residual**2, axis=1)
    variance = safe_divide(sums, jnp.broadcast_to(count, sums.shape))
    is_sparse = len(lattice.pixel_at) > MOST_PLACES * len(counts)
    over_lags = _lag_by_lag if is_sparse else _by_spectra
    return over_lags(gradient, residual, counts, variance, lattice) / (1 - taken)


def _by_spectra(
    gradient: Float[Array, "n k"],
    residual: Float[Array, "r n"],
    counts: Float[Array, " n"],
    variance: Float[Array, " r"],
    lattice: Lattice,
) -> Float[Array, "r k k"]:
    """The sum over all pairs, as one over frequencies."""
    num_places = len(lattice.pixel_at)

    def spectra_of(values: Float[Array, "m n"]) -> Array:
        padded = jnp.concatenate([values, jnp.zeros_like(values[:, :1])], axis=1)
        return jnp.fft.rfft(padded[:, jnp.asarray(lattice.pixel_at)])

    power = jnp.abs(spectra_of(jnp.concatenate([counts[None], residual]))) ** 2
    products = jnp.fft.irfft(power, num_places)
    at = jnp.asarray(LAGS[:, 0]) * lattice.stride + jnp.asarray(LAGS[:, 1])
    pairs, sums = jnp.round(products[:1, at]), products[1:, at]
    means = safe_divide(sums, jnp.broadcast_to(pairs, sums.shape))
    means *= jnp.asarray(FADING, means.dtype)[None]
    kernel = jnp.zeros_like(products[1:]).at[:, 0].set(variance)
    kernel = kernel.at[:, at].set(means).at[:, num_places - at].set(means)
    weight = jnp.fft.rfft(kernel).real
    # Of real values one half of a spectrum tells the other, but for what is its own.
    times = np.where(2 * np.arange(weight.shape[1]) % num_places, 2, 1) / num_places
    weight *= jnp.asarray(times, weight.dtype)[None]
    slopes = spectra_of(gradient.T)
    parts = jnp.concatenate([slopes.real, slopes.imag], axis=1)
    return jnp.stack(
        [product(parts * jnp.tile(one, 2)[None], parts.T) for one in weight]
    )


def _lag_by_lag(
    gradient: Float[Array, "n k"],
    residual: Float[Array, "r n"],
    counts: Float[Array, " n"],
    variance: Float[Array, " r"],
    lattice: Lattice,
) -> Float[Array, "r k k"]:
    """The same of few pixels that lie far from each other."""
    size, pixel_at = len(counts), jnp.asarray(lattice.pixel_at)
    padded = jnp.concatenate([gradient, jnp.zeros_like(gradient[:1])])
    values = jnp.concatenate([counts[None], residual])
    values = jnp.concatenate([values, jnp.zeros_like(values[:, :1])], axis=1)

    def at_lag(
        total: Float[Array, "r k k"], at: tuple[Int[Array, "2"], Float[Array, ""]]
    ):
        lag, window = at
        near = lattice.place + lag[0] * lattice.stride + lag[1]
        other = pixel_at.at[near].get(mode="fill", fill_value=size)
        of_pairs = values[:, other]
        pairs = jnp.sum(counts * of_pairs[0])
        sums = jnp.sum(residual * of_pairs[1:], axis=1)
        mean = safe_divide(sums, jnp.broadcast_to(pairs, sums.shape)) * window
        cross = product(gradient.T, padded[other])
        return total + mean[:, None, None] * (cross + cross.T)[None], None

    start = variance[:, None, None] * product(gradient.T, gradient)[None]
    shown = jnp.asarray(LAGS), jnp.asarray(FADING, start.dtype)
    total, _ = jax.lax.scan(at_lag, start, shown)
    return total
