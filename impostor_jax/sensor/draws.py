"""Random numbers for the pixels of an image.

`jax.random` folds 64 bits into each number of 32, so that values do not depend on how
an array is split over devices. Here all are used, of the same generator, Threefry-2x32.
And where an array is joined of parts within a larger expression, XLA does not
vectorize that; here each strip of rows is written to its place, one after the other.
"""

__all__ = ["chances", "normal_draws"]

import math
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
from jax.extend.random import threefry2x32_p
from jax.typing import DTypeLike
from jaxtyping import Array, Float, PRNGKeyArray, UInt32

STRIP = 32
"""Rows that are drawn at a time: few enough to stay in a processor's cache."""

Words = UInt32[Array, "h w"]


def normal_draws(
    key: PRNGKeyArray, shape: tuple[int, ...], dtype: DTypeLike
) -> Float[Array, "h w"]:
    """Independent standard normal numbers.

    They have 23 bits, symmetric about 0, and reach 5.3 standard deviations.
    """

    def normal(words: Words) -> Float[Array, "h w"]:
        # The middles of 2^23 equal parts of (-1, 1), which single precision holds.
        middle = ((words >> 9).astype(jnp.float32) + 0.5) * 2.0**-22 - 1
        return math.sqrt(2) * jax.lax.erf_inv(middle)

    return _strips(key, shape, dtype, lambda a, b: [normal(a), normal(b)], 2)


def chances(
    key: PRNGKeyArray, shape: tuple[int, ...], dtype: DTypeLike
) -> Float[Array, "h w"]:
    """Independent uniform numbers in [0, 1).

    Multiples of 2^-16: enough to decide with a probability.
    """

    def chance(half: Words) -> Float[Array, "h w"]:
        return half.astype(jnp.float32) * 2.0**-16

    def four(a: Words, b: Words) -> list[Float[Array, "h w"]]:
        return [chance(half) for word in (a, b) for half in (word >> 16, word & 0xFFFF)]

    return _strips(key, shape, dtype, four, 4)


def _strips(
    key: PRNGKeyArray,
    shape: tuple[int, ...],
    dtype: DTypeLike,
    values: Callable[[Words, Words], Sequence[Float[Array, "h w"]]],
    parts: int,
) -> Float[Array, "h w"]:
    """An image of numbers, of which two words each give `parts`."""
    height, width = shape
    num_strips, rows = -(-height // STRIP), STRIP // parts
    row, col = (
        jax.lax.broadcasted_iota(jnp.uint32, (rows, width), axis) for axis in (0, 1)
    )
    # Of keys of every kind.
    words = jax.random.bits(key, (2,), jnp.uint32)
    first, second = (jnp.broadcast_to(word, row.shape) for word in words)

    def draw(k: Array, image: Float[Array, "h w"]) -> Float[Array, "h w"]:
        counter = row + k.astype(jnp.uint32) * rows
        drawn = threefry2x32_p.bind(first, second, counter, col)
        for part, value in enumerate(values(*drawn)):
            place = (k * STRIP + part * rows, jnp.zeros_like(k))
            image = jax.lax.dynamic_update_slice(image, value, place)
        return image

    image = jnp.zeros((num_strips * STRIP, width), jnp.float32)
    image = jax.lax.fori_loop(0, num_strips, draw, image)
    return image[:height].astype(dtype)
