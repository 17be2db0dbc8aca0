"""Depths that are all off alike: a focal length or a baseline that is not quite right.

No image shows it: a scene that is larger, and as much farther away, looks the same.
"""

__all__ = ["LAWS", "ScaleError", "corrected"]

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import bounded_number, one_of, real_number
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.compiling import compiled
from impostor_jax.numerics import Numbers, Scalar
from impostor_jax.sensor.base import AbstractDepthNoise, Depths, Normals, noise_model
from impostor_jax.sensor.bias import Bias, ScaleLaw

LAWS = ("scale", "disparity")


class ScaleError(AbstractDepthNoise):
    """A sensor whose depths are off by an error that all readings of an image share.

    With the error e, normal from image to image, a depth z reads

        z (1 + e)           by the law "scale": of a focal length or a baseline,
        1 / (1 / z + e)     by the law "disparity": of an offset of the disparity.

    A fit corrects readings by `mean`, and counts `deviation` in: sizes and distances
    are no surer than that, unless a length in the image is known (`prior`).

    Args:
        sensor: The noise model that makes the readings.
        deviation: Standard deviation of e: a fraction, or 1/meters.
        mean: Of e.
        law: "scale" or "disparity".

    References:
        A chessboard before a camera of the first Kinect's kind read 3 to 4 % short near
        0.9 m: a disparity offset of 0.039 +- 0.009 per meter.
    """

    sensor: AbstractDepthNoise
    deviation: Scalar
    mean: Scalar
    law: str = eqx.field(static=True)

    def __init__(
        self,
        sensor: Any,
        deviation: Any = 0.02,
        mean: Any = 0.0,
        law: str = "scale",
    ):
        self.sensor = noise_model(sensor)
        one_of("law", law, LAWS)
        self.law = law
        self.deviation = bounded_number("deviation", deviation, "0 or positive")
        self.mean = real_number("mean", mean)

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        return self.sensor.sigma(depth, cos_incidence)

    @property
    @override
    def bias(self) -> Bias:
        bias = self.sensor.bias
        return dataclasses.replace(bias, scales=(*bias.scales, self._of_all))

    @override
    @compiled
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        scale_key, sensor_key = jax.random.split(key)
        mean, deviation = (
            jnp.asarray(x, depth.dtype) for x in (self.mean, self.deviation)
        )
        error = mean + deviation * jax.random.normal(scale_key, (), depth.dtype)
        scene = self._of_all.read(depth, error)
        return self.sensor.sample(sensor_key, scene, normal, camera)

    @property
    def _of_all(self) -> ScaleLaw:
        return ScaleLaw(self.deviation, self.mean, self.law)


def corrected(
    depth: Float[np.ndarray, "h w"] | Float[Array, "h w"], sensor: AbstractDepthNoise
) -> tuple[Float[np.ndarray, "h w"] | Float[Array, "h w"], AbstractDepthNoise]:
    """Depths without the mean errors that a sensor knows, and the sensor without them.

    Args:
        depth: Readings in meters; 0 where there is none.
        sensor: That made them.
    """
    # The innermost part reads last.
    for law in sensor.bias.scales:
        depth = law.corrected(depth)
    return depth, _centered(sensor)


def _centered(sensor: AbstractDepthNoise) -> AbstractDepthNoise:
    def of_mean_zero(part: Any) -> Any:
        if not isinstance(part, ScaleError):
            return part
        return eqx.tree_at(
            lambda p: (p.sensor, p.mean), part, (_centered(part.sensor), 0.0)
        )

    return jax.tree.map(
        of_mean_zero, sensor, is_leaf=lambda part: isinstance(part, ScaleError)
    )
