"""Robust losses of a whitened residual, in the form that least squares needs.

Each is the loss rho(r) of a named M-estimator, written as a residual whose square is
rho: a factor of r that is smooth at 0, where the square root of the loss itself has no
derivative. All equal r^2 for residuals well below the width.

References:
    Hartley and Zisserman (2004), appendix 6.8; Barron (2019), "A General and Adaptive
    Robust Loss Function".
"""

__all__ = ["KERNELS", "robust_residual"]

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def _pseudo_huber(x: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """2 (sqrt(1 + x) - 1) / x: linear in |r| beyond the width."""
    return 2 / (1 + jnp.sqrt(1 + x))


def _cauchy(x: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """log(1 + x) / x: grows like a logarithm."""
    small = x < 1e-3
    return jnp.where(small, 1 - x / 2, jnp.log1p(x) / jnp.where(small, 1, x))


def _geman_mcclure(x: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """1 / (1 + x): bounded, so that a gross error has no pull at all."""
    return 1 / (1 + x)


def _squares(x: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """1: least squares, for readings without gross errors."""
    return jnp.ones_like(x)


KERNELS: dict[str, tuple[Callable[..., Array], float]] = {
    "pseudo_huber": (_pseudo_huber, 2.0),
    "cauchy": (_cauchy, 4.0),
    "geman_mcclure": (_geman_mcclure, 7.0),
    "squares": (_squares, 1.0),
}
"""By name: the loss over r^2 as a function of (r / width)^2, and the width in standard
deviations, at which about 3 percent of the efficiency on normal noise is lost."""


def robust_residual(
    residual: Float[Array, "*batch"],
    width: float | Float[Array, "*#batch"],
    kernel: str,
) -> Float[Array, "*batch"]:
    """Residual whose square is the kernel's loss.

    Args:
        residual: In standard deviations.
        width: Where the loss leaves the square, in standard deviations.
        kernel: Name in `KERNELS`.
    """
    factor, _ = KERNELS[kernel]
    return residual * jax.lax.sqrt(factor((residual / width) ** 2))
