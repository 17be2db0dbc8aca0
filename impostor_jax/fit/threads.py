"""Work in threads."""

__all__ = ["in_background", "side_by_side"]

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from impostor_jax.device import asked

Given = TypeVar("Given")
Values = TypeVar("Values")


def side_by_side(
    fit: Callable[[Given], Values], which: Iterable[Given]
) -> list[Values]:
    """Fits of several things, in their order, in as many threads as cores."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return [*pool.map(_as_the_caller(fit), which)]


def in_background(function: Callable[[], Values]) -> Callable[[], Values]:
    """What waits for the value of a function that runs in a thread of its own."""
    pool = ThreadPoolExecutor(1)
    value = pool.submit(_as_the_caller(function))
    pool.shutdown(wait=False)
    return value.result


def _as_the_caller(function: Callable[..., Values]) -> Callable[..., Values]:
    """A function for other threads, to which JAX's settings of this one are unknown."""
    is_double = jnp.result_type(float) == np.float64
    device = asked()

    def as_the_caller(*args: Any) -> Values:
        with jax.enable_x64(is_double), jax.default_device(device):
            return function(*args)

    return as_the_caller
