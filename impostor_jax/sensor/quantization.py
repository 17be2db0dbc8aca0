"""Stereo noise: what errs, and is rounded, is the disparity.

Two cameras a baseline B apart see a point at depth z with the disparity d = f B / z.
Its error is the same at all depths, and the chip that matches the images rounds it to a
fraction of a pixel; so depths lie on steps that grow with the square of the depth.
"""

__all__ = ["StereoDisparity"]

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import bounded_number, real_number
from impostor_jax.camera.base import AbstractCamera, check_depth_along_z
from impostor_jax.compiling import compiled
from impostor_jax.numerics import Numbers, Scalar
from impostor_jax.sensor.across import errors_across, moved_across
from impostor_jax.sensor.base import NO_READING, AbstractDepthNoise, Depths, Normals
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.draws import normal_draws
from impostor_jax.sensor.matching import matching_sensor
from impostor_jax.sensor.surface import has_surface


class StereoDisparity(AbstractDepthNoise):
    """Normal noise of the disparity, which is then rounded to steps.

    A disparity that comes out as 0 or less gives no reading: 0.

    `sigma` is of first order in the error of the disparity: sqrt(deviation^2 +
    step^2 / 12) z^2 / (f B). That takes the rounding for a uniform error of its own,
    which holds where `deviation` is half a step or more, or over many depths; on one
    surface with less noise, readings keep to a step and their error is a bias.
    `interval` serves a likelihood that knows the steps. The second order makes readings
    too large by z (deviation / d)^2 on average.

    Args:
        focal_length: In pixels of the image in which disparities are found.
        baseline: Distance of the two cameras in meters.
        deviation: Standard deviation of the disparity before rounding, in pixels.
        step: Step of the disparity in pixels; 0 for none.
        across: Standard deviation of a reading's place across its ray, along each of
            two directions, in meters; None where nobody knows: a fit learns it.
        angle: The same of the direction of the ray, in radians.

    References:
        The defaults are of the order of an active stereo camera (RealSense D4xx): 0.05
        to 0.1 px, steps of 1/32 px, 50 mm.
    """

    focal_length: Scalar
    baseline: Scalar
    deviation: Scalar
    step: Scalar
    across: Scalar | None
    angle: Scalar | None

    def __init__(
        self,
        focal_length: Any,
        baseline: Any = 0.05,
        deviation: Any = 0.08,
        step: Any = 1 / 32,
        across: Any = None,
        angle: Any = None,
    ):
        self.focal_length = real_number(
            "focal_length", focal_length, positive=True, unit="pixels"
        )
        self.baseline = real_number("baseline", baseline, positive=True, unit="meters")
        self.deviation = real_number(
            "deviation", deviation, positive=True, unit="pixels"
        )
        self.step = bounded_number("step", step, "0 or positive, in pixels")
        self.across, self.angle = errors_across(across, angle)

    @staticmethod
    def sensor(
        focal_length: Any, baseline: Any = 0.05, native_scale: Any = 1.0
    ) -> AbstractDepthNoise:
        """The whole camera: it leans at edges, and neither scale nor bands are known.

        Args:
            focal_length: In pixels of the image in which disparities are found.
            baseline: Distance of the two cameras in meters.
            native_scale: Pixels of the image for one of those, of an image that was
                warped or enlarged.
        """
        return matching_sensor(StereoDisparity(focal_length, baseline), native_scale)

    def interval(self, depth: Numbers) -> tuple[Numbers, Numbers]:
        """Nearest and farthest depth whose disparity is rounded to that of a reading.

        Args:
            depth: Readings, in meters.

        Returns:
            Bounds in meters. Both are the reading if there are no steps. The farthest
            step ends at `+inf`; a reading of 0 or less is none, and may be anything:
            (0, `+inf`).

        Derivatives:
            0, since the bounds do not move within a step.
        """
        scale, step = self._scale(depth), jnp.asarray(self.step, depth.dtype)
        reads = depth > 0
        z = jnp.where(reads, depth, 1)
        is_stepped = step > 0
        width = jnp.where(is_stepped, step, 1)
        count = jnp.round(scale / z / width)
        nearest = scale / ((count + 0.5) * width)
        ends = count > 0
        farthest = scale / (jnp.where(ends, count - 0.5, 1) * width)
        farthest = jnp.where(ends, farthest, jnp.inf)
        lower = jnp.where(is_stepped, nearest, z)
        upper = jnp.where(is_stepped, farthest, z)
        return jnp.where(reads, lower, 0), jnp.where(reads, upper, jnp.inf)

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        deviation = jnp.asarray(self.deviation, depth.dtype)
        step = jnp.asarray(self.step, depth.dtype)
        error = jnp.sqrt(deviation * deviation + step * step / 12)
        seen = has_surface(depth)
        z = jnp.where(seen, depth, 1)
        return jnp.where(seen, error * z * (z / self._scale(depth)), jnp.inf)

    @property
    @override
    def bias(self) -> Bias:
        return Bias.of_rays(self.across, self.angle)

    @override
    @compiled
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        check_depth_along_z(camera)
        key, depth = moved_across(key, depth, normal, camera, self.bias)
        scale, step = self._scale(depth), jnp.asarray(self.step, depth.dtype)
        seen = has_surface(depth)
        draw = normal_draws(key, depth.shape, depth.dtype)
        disparity = scale / jnp.where(seen, depth, 1)
        disparity += jnp.asarray(self.deviation, depth.dtype) * draw
        is_stepped = step > 0
        width = jnp.where(is_stepped, step, 1)
        steps = jnp.round(disparity / width) * width
        disparity = jnp.where(is_stepped, steps, disparity)
        matched = disparity > 0
        reading = scale / jnp.where(matched, disparity, 1)
        reading = jnp.where(matched, reading, NO_READING)
        return jnp.where(seen, reading, jnp.where(depth > 0, depth, NO_READING))

    def _scale(self, depth: Numbers) -> Float[Array, ""]:
        """Disparity times depth, in pixel meters, in the precision of `depth`."""
        focal_length = jnp.asarray(self.focal_length, depth.dtype)
        return focal_length * jnp.asarray(self.baseline, depth.dtype)
