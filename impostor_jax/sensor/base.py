"""What every noise model promises: one model makes data and weighs a fit.

Models nest: a part that drops readings or mixes them at edges wraps the model that
reads what is left, and is a noise model itself. A wrapper changes the scene before its
sensor reads it, or the readings after; so parts stack in any order.
"""

__all__ = [
    "NO_READING",
    "AbstractDepthNoise",
    "Depths",
    "Normals",
    "cos_incidence",
    "noise_model",
    "scattered",
]

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.draws import normal_draws

Depths = Float[Array, "h w"]
"""Camera-frame z of each pixel, in meters; of a `SphericalCamera` the range."""

Normals = Float[Array, "h w 3"]
"""Unit normals that face the camera, in its frame."""

NO_READING = 0.0
"""A missing reading, as in depth files.

Not `+inf`, which says that there is no surface; a fit takes both as missing.
"""


class AbstractDepthNoise(eqx.Module):
    """Noise of depth readings along z of the camera frame.

    Of a `SphericalCamera`, whose depth is the range, along its rays.
    """

    @abc.abstractmethod
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        """Standard deviation of a reading, in meters.

        Of a reading that is there and is of its own pixel's surface: what wrappers add
        (missing readings, those mixed at edges) is no spread, and leaves it alone.

        Args:
            depth: Camera-frame z, in meters; `+inf` where nothing is hit.
            cos_incidence: Cosine between surface normal and viewing ray, in (0, 1].

        Returns:
            One sigma a pixel; `+inf` where nothing is hit, and where depth is not
            positive, so its weight is zero.

        Derivatives:
            In depth and incidence, finite everywhere; 0 where sigma is infinite.
        """

    @property
    @abc.abstractmethod
    def bias(self) -> Bias:
        """Errors that readings share, which are no part of `sigma`."""

    @abc.abstractmethod
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        """Readings of a scene, in meters.

        A sensor that matches windows of pixels in a plane, or whose noise is a law of
        z, raises a `ValueError` for a `SphericalCamera`.

        Args:
            key: Random key.
            depth: Camera-frame z, in meters; `+inf` where nothing is hit.
            normal: Unit normals that face the camera, in its frame.
            camera: The camera that sees them.

        Returns:
            `+inf` stays where nothing is hit, unless the class says otherwise; 0 where
            there is a surface and no reading. Never negative.

        Derivatives:
            In depth, with what was drawn held; 0 for readings that are rounded or
            missing.
        """


def cos_incidence(normal: Normals, camera: AbstractCamera) -> Float[Array, "h w"]:
    """Cosine between surface normal and viewing ray; 0 where nothing is hit.

    Args:
        normal: Unit normals that face the camera, in its frame; zero where nothing is
            hit. Their precision is that of the result.
        camera: The camera that sees them.

    Raises:
        ValueError: The normals are not of the size of the camera's image.
    """
    size = (camera.height, camera.width)
    if normal.shape[:2] != size:
        raise ValueError(
            f"normal must have one vector for each of {size} (height, width) pixels "
            f"of the camera, got shape {normal.shape}"
        )
    row, col = camera.frame.pixels()
    view = camera.rays(row, col, normal.dtype).direction.normalize()
    cosine = -view.dot(Vec3.from_array(normal))
    return jnp.clip(cosine, 0, 1)


def scattered(key: PRNGKeyArray, depth: Depths, sigma: Float[Array, "h w"]) -> Depths:
    """Add independent normal noise; depths with an infinite sigma stay as they are.

    What comes out behind the camera is no reading.
    """
    spread = jnp.where(jnp.isfinite(sigma), sigma, 0)
    reading = depth + spread * normal_draws(key, depth.shape, depth.dtype)
    return jnp.where(reading > 0, reading, NO_READING)


def noise_model(sensor: Any) -> AbstractDepthNoise:
    """Return `sensor`; a `ValueError` where it is no noise model."""
    if not isinstance(sensor, AbstractDepthNoise):
        raise ValueError(
            f"sensor must be a noise model such as ConstantNoise, got {sensor!r}"
        )
    return sensor
