"""Work in threads."""

__all__ = ["in_background", "side_by_side"]

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

Values = TypeVar("Values")


def side_by_side(fit: Callable[[int], Values], which: Sequence[int]) -> list[Values]:
    """Fits of several numbers, in their order, in as many threads as cores."""
    in_precision = _in_own_precision(fit)
    # The first alone, which compiles for all.
    first = in_precision(which[0])
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return [first, *pool.map(in_precision, which[1:])]


def in_background(function: Callable[[], Values]) -> Callable[[], Values]:
    """What waits for the value of a function that runs in a thread of its own."""
    pool = ThreadPoolExecutor(1)
    value = pool.submit(_in_own_precision(function))
    pool.shutdown(wait=False)
    return value.result


def _in_own_precision(function: Callable[..., Values]) -> Callable[..., Values]:
    """A function for other threads, which do not have the precision of the caller's."""
    is_double = jnp.result_type(float) == np.float64

    def in_precision(*args: Any) -> Values:
        with jax.enable_x64(is_double):
            return function(*args)

    return in_precision
