"""Fits side by side, of which each fails alone."""

__all__ = ["fit_or_failure", "side_by_side"]

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from impostor_jax.arguments import working_precision
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.fittable import Fittable, no_guess
from impostor_jax.fit.options import Options
from impostor_jax.fit.request import TooFewReadingsError, checked_mask
from impostor_jax.fit.result import Fit
from impostor_jax.fit.shapes import fit_shape
from impostor_jax.primitives.base import AbstractPrimitive

Values = TypeVar("Values")


def fit_or_failure(
    kind: Fittable,
    depth: Any,
    camera: PinholeCamera,
    mask: Any,
    sigma: Any,
    initial: AbstractPrimitive | None,
    options: Options,
) -> Fit:
    """As `fit_shape`, or a failed fit where there are too few readings."""
    try:
        return fit_shape(kind, depth, camera, mask, sigma, initial, options)
    except TooFewReadingsError:
        with working_precision(options.effort.precision, ()):
            region = checked_mask(mask, camera)
            if region is None:
                region = np.zeros(checked_depth(depth, camera).shape, bool)
            return no_guess(kind, np.asarray(region))


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
