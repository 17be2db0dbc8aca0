"""Fits side by side, in threads."""

__all__ = ["side_by_side"]

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

Values = TypeVar("Values")


def side_by_side(fit: Callable[[int], Values], which: Sequence[int]) -> list[Values]:
    """Fits of several numbers, in their order, in as many threads as cores."""
    # A precision that the caller's thread has set is not that of another one.
    is_double = jnp.result_type(float) == np.float64

    def in_its_precision(number: int) -> Values:
        with jax.enable_x64(is_double):
            return fit(number)

    # The first alone, which compiles for all.
    first = in_its_precision(which[0])
    with ThreadPoolExecutor() as pool:
        return [first, *pool.map(in_its_precision, which[1:])]
