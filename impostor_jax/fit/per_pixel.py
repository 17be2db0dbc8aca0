"""A standard deviation for each pixel of an image, as some cameras tell it.

What is compiled holds no image. So the noise of a fit's programs is that of the middle
reading, and its table tells of each reading how far it spreads beside that one.
"""

__all__ = ["PerPixelNoise", "law_of", "noise_of_pixels", "read_with", "spread_of"]

from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import is_concrete
from impostor_jax.camera.base import AbstractCamera, AbstractRays
from impostor_jax.numerics import Numbers
from impostor_jax.sensor.base import AbstractDepthNoise, Depths, Normals, scattered
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.gaussian import ConstantNoise

Image = Float[Array, "h w"] | Float[np.ndarray, "h w"]


class PerPixelNoise(AbstractDepthNoise):
    """Independent normal noise, of one standard deviation a pixel.

    Attributes:
        middle: Noise of the middle reading.
        image: Standard deviations in meters; 0, NaN or infinite where none is known.
    """

    middle: ConstantNoise
    image: Image

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        return self.middle.sigma(depth, cos_incidence)

    @property
    @override
    def bias(self) -> Bias:
        return Bias()

    @override
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        return scattered(key, depth, jnp.asarray(self.image, depth.dtype))


def noise_of_pixels(sigma: Any, camera: AbstractRays) -> PerPixelNoise:
    """Noise of an image that tells of each pixel how much it errs.

    Args:
        sigma: Standard deviations in meters.
        camera: That took the image.

    Raises:
        ValueError: It has not the camera's shape, is no array of floating-point
            numbers, or a deviation is negative, or none is known.
    """
    shape = (camera.height, camera.width)
    if not isinstance(sigma, jax.Array):
        sigma = np.asarray(sigma)
    if sigma.shape != shape or not jnp.issubdtype(sigma.dtype, np.floating):
        raise ValueError(
            "sigma must be a number, a noise model, or floating-point meters of the "
            f"camera's shape {shape}, got {sigma.dtype} of shape {sigma.shape}"
        )
    dtype = jax.dtypes.canonicalize_dtype(float)
    sigma = sigma.astype(dtype)
    if not is_concrete(sigma):
        middle = jnp.nanmedian(jnp.where(_is_known(sigma, jnp), sigma, jnp.nan))
        return PerPixelNoise(ConstantNoise(middle), sigma)
    values = np.asarray(sigma)
    known = values[_is_known(values, np)]
    if np.any(values < 0):
        raise ValueError(f"sigma must not be negative, got {np.nanmin(values)} meters")
    if not known.size:
        raise ValueError("sigma must be positive at some pixel, got none that is")
    return PerPixelNoise(ConstantNoise(jnp.asarray(np.median(known), dtype)), values)


def _is_known(sigma: Any, xp: ModuleType) -> Any:
    return xp.isfinite(sigma) & (sigma > 0)


def read_with(noise: PerPixelNoise, depth: Image) -> Image:
    """Depths without those whose deviation is not known."""
    xp = np if is_concrete((noise, depth)) else jnp
    return xp.where(_is_known(xp.asarray(noise.image), xp), depth, 0)


def _is_map(noise: Any) -> bool:
    return isinstance(noise, PerPixelNoise)


def _maps_in(noise: AbstractDepthNoise) -> list[PerPixelNoise]:
    return [part for part in jax.tree.leaves(noise, is_leaf=_is_map) if _is_map(part)]


def law_of(noise: AbstractDepthNoise) -> AbstractDepthNoise:
    """The same without images: what compiled programs are given."""
    if not _maps_in(noise):
        # It is asked several times a fit, and making a module anew takes longer.
        return noise
    return jax.tree.map(
        lambda part: part.middle if _is_map(part) else part, noise, is_leaf=_is_map
    )


def spread_of(
    noise: AbstractDepthNoise, row: Any, col: Any, xp: ModuleType
) -> Float[np.ndarray, " n"] | Float[Array, " n"] | None:
    """Deviations of readings over those of `law_of`; None where they are the same.

    Args:
        noise: Of the readings.
        row: Rows of their pixels, within the image.
        col: Columns of their pixels.
        xp: NumPy, or `jax.numpy` of what is traced.
    """
    for part in _maps_in(noise):
        own = xp.asarray(part.image)[row, col]
        middle = xp.asarray(part.middle.deviation)
        return xp.where(_is_known(own, xp), own / middle, 1).astype(own.dtype)
    return None
