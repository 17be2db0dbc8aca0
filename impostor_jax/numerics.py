"""Elementary functions that are finite in value and in every derivative.

`jnp.where(ok, sqrt(x), 0)` still differentiates the square root where it is not taken,
and 0 * inf is NaN. These functions replace the operand first, so the branch that is not
taken has a finite derivative too.
"""

__all__ = [
    "Numbers",
    "Scalar",
    "all_finite",
    "eps",
    "first_largest",
    "has_square",
    "kept_from_zero",
    "nan_where",
    "one_of_three",
    "product",
    "safe_divide",
    "safe_norm",
    "safe_normalize",
    "safe_sqrt",
    "smallest_slope",
]

import functools
from collections.abc import Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int, PyTree

Values = TypeVar("Values")

Numbers = Float[Array, "*batch"]
"""One number of each of a batch, of any shape: of rays, points or pixels."""

Scalar = float | Float[Array, ""]
"""A number; it may be traced."""


def eps(dtype: DTypeLike, count: int = 1) -> float:
    """Return `count` times the spacing of the numbers next to 1."""
    return count * float(np.finfo(dtype).eps)


def has_square(length: Float[Array, "*batch"]) -> Bool[Array, "*batch"]:
    """Tell whether a length is positive and its square a normal number.

    From 1.1e-19 to 1.8e19 in single precision, from 1.5e-154 to 1.3e154 in double.
    """
    limits = np.finfo(length.dtype)
    return (length > float(limits.tiny) ** 0.5) & (length < float(limits.max) ** 0.5)


def all_finite(tree: PyTree) -> Bool[Array, ""]:
    """Whether all numbers of a tree are finite."""
    return jnp.stack([jnp.all(jnp.isfinite(x)) for x in jax.tree.leaves(tree)]).all()


def nan_where(
    unknown: Bool[Array, "*batch"], values: Float[Array, "*batch"]
) -> Float[Array, "*batch"]:
    """Numbers, and NaN where they are not known.

    For what a user reads. NaN is placed by NumPy where values are concrete: under
    `jax_debug_nans` JAX refuses any that it computes.
    """
    if any(isinstance(x, Tracer) for x in (unknown, values)):
        return jnp.where(unknown, jnp.nan, values)
    return jax.device_put(np.where(unknown, np.nan, np.asarray(values)))


def smallest_slope(dtype: DTypeLike) -> float:
    """Return the smallest direction cosine that counts as different from zero.

    The fourth root of the smallest normal number: its reciprocal can be cubed, as the
    second derivative of a quotient does, and a length of kilometers still multiplied by
    it. It lies far below the rounding of a unit vector (3e-10 in single precision).
    """
    return float(np.finfo(dtype).tiny) ** 0.25


def kept_from_zero(slope: Numbers, least: float) -> Numbers:
    """A slope to divide by; `least`, not 1, where its size is smaller.

    A compiler may round a slope in two ways where it is used twice, and tell a ray that
    is parallel by the one and divide by the other: what it crosses is then far off all
    the same, and not as far as the shape is wide.
    """
    return jnp.where(jnp.abs(slope) < least, least, slope)


def first_largest(values: Sequence[Numbers]) -> Int[Array, "*batch"]:
    """Which of three numbers is largest, 0 to 2; of equal ones the first."""
    x, y, z = values
    return jnp.where(x >= jnp.maximum(y, z), 0, jnp.where(y >= z, 1, 2))


def one_of_three(which: Int[Array, "*batch"], values: Sequence[Values]) -> Values:
    """Take the first, second or third of some trees."""
    return jax.tree.map(
        lambda x, y, z: jnp.where(which == 0, x, jnp.where(which == 1, y, z)), *values
    )


def safe_sqrt(x: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Square root; 0 with derivative 0 where `x` is not positive (or NaN)."""
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1)), 0)


def product(*factors: Float[Array, "..."]) -> Float[Array, "..."]:
    """Matrix product, from left to right, in full precision on every device.

    An accelerator otherwise rounds the factors of a product to fewer digits.
    """
    return functools.reduce(functools.partial(jnp.matmul, precision="highest"), factors)


def safe_divide(
    numerator: Float[Array, "*batch"], denominator: Float[Array, "*batch"]
) -> Float[Array, "*batch"]:
    """Quotient; 0 with derivative 0 where the denominator is 0."""
    nonzero = denominator != 0
    return jnp.where(nonzero, numerator / jnp.where(nonzero, denominator, 1), 0)


def safe_norm(vectors: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
    """Length along the last axis; derivative 0 for the zero vector."""
    return safe_sqrt(jnp.sum(vectors * vectors, axis=-1))


@jax.jit
def safe_normalize(vectors: Float[Array, "*batch n"]) -> Float[Array, "*batch n"]:
    """Scale vectors of any length to length 1; a zero vector stays, derivative 0."""
    # Divided by the largest component first, so that no square under- or overflows.
    largest = jax.lax.stop_gradient(jnp.max(jnp.abs(vectors), axis=-1, keepdims=True))
    scaled = vectors / jnp.where(largest > 0, largest, 1)
    length = safe_norm(scaled)[..., None]
    return scaled / jnp.where(length > 0, length, 1)
