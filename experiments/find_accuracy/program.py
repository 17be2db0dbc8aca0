"""What a program that finds cylinders is given, and what it returns."""

__all__ = ["MissingProgramError", "Program"]

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from impostor_jax.matching import Detection

Program = Callable[
    [Float[np.ndarray, "h w"], ij.PinholeCamera, ij.AbstractDepthNoise],
    list[Detection],
]
"""Of readings (float32, meters, 0 for none), their camera and the sensor's noise."""


class MissingProgramError(Exception):
    """A program that is not installed; it is left out, and the sentence printed."""
