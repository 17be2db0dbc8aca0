"""What cameras that match windows of images have in common, as it was measured."""

__all__ = ["matching_sensor"]

from typing import Any

from impostor_jax.arguments import real_number
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.correlated import CorrelatedNoise
from impostor_jax.sensor.matching_window import MatchingWindow
from impostor_jax.sensor.scale_error import ScaleError

OFFSET = 0.03
"""Standard deviation of the disparity's offset, in 1/meters."""

BANDS = 0.001
"""Standard deviation of smooth errors at 1 m, in meters."""

BAND_LENGTH = 20.0
"""Their correlation length, in pixels of the camera."""


def matching_sensor(noise: AbstractDepthNoise, native_scale: Any) -> AbstractDepthNoise:
    """A camera whose readings have a noise, and the errors of matching.

    Args:
        noise: Of single readings.
        native_scale: Pixels of the image for one of the camera's.

    References:
        Measured on five photographs of cans by cameras of the first Kinect's kind: the
        window on the cans' edges, the offset on a chessboard. The smooth errors are
        those of the bare table of one (0.93 mm over 24 +- 9 pixels); an image tells
        little of what is smoother.
    """
    scale = real_number("native_scale", native_scale, positive=True, unit="pixels")
    windowed = MatchingWindow(noise, native_scale=scale)
    banded = CorrelatedNoise(windowed, BANDS, BAND_LENGTH * scale)
    return ScaleError(banded, OFFSET, law="disparity")
