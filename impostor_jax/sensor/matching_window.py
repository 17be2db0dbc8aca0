"""Readings that lean at edges: a sensor that matches windows sees over them.

Structured light and stereo look for a window of one image in another, and read the part
of it that lies on one surface. Beside an edge that part is all on one side of the
pixel: of a can that recedes there the readings come out in front of it, and its radius
too large. On photographs of cans that is 1 to 3 mm within half a window, and nothing
beyond.
"""

__all__ = ["STEEPEST", "MatchingWindow"]

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import (
    angle_below_grazing,
    bounded_number,
    is_concrete,
    real_number,
)
from impostor_jax.camera.base import AbstractCamera, check_depth_along_z
from impostor_jax.compiling import compiled
from impostor_jax.numerics import Numbers, Scalar
from impostor_jax.sensor.base import AbstractDepthNoise, Depths, Normals, noise_model
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.surface import has_surface

STEEPEST = math.radians(80)
"""Incidence to which such sensors were measured, in radians."""

MOST = 32
"""Pixels of an image that half a window reaches at most."""


class MatchingWindow(AbstractDepthNoise):
    """A sensor that reads a window, as far as that is of one surface.

    The window is a square. Of its pixels those count that a surface less steep than
    `steepest` may have in common with its middle, and the sensor reads, with its own
    noise, where they are on average: the mean of their differences from the middle, of
    which those to opposite sides cancel. So a whole window reads its middle, however
    the surface bends, as was measured. Where the middle hits nothing, nothing is read.

    A fit leaves out readings within half a window of a jump, a hole or an occluder, and
    takes the errors of neighbors for correlated if it is not told otherwise.

    Args:
        sensor: The noise model that makes the readings.
        half_window: Reach of the window on each side of its middle, in pixels of the
            sensor itself.
        native_scale: Pixels of the image for one of the sensor's: over 1 where the
            image was enlarged, or warped to a color camera of a longer focal length.
        steepest: Incidence in radians beyond which a difference in depth is a jump.

    References:
        The default is a window of 9 pixels. Readings of cans of known size by a camera
        of the first Kinect's kind (f = 567.6, warped to 1066.8) lie off their surface
        by 2 to 3 mm beside an edge and by 0.2 mm or less from 8 of the image's pixels
        on: 4.3 of the sensor's.
    """

    sensor: AbstractDepthNoise
    half_window: float = eqx.field(static=True)
    native_scale: float = eqx.field(static=True)
    steepest: Scalar

    def __init__(
        self,
        sensor: Any,
        half_window: Any = 4.3,
        native_scale: Any = 1.0,
        steepest: Any = STEEPEST,
    ):
        self.sensor = noise_model(sensor)
        own = {"half_window": half_window, "native_scale": native_scale}
        for name, value in own.items():
            if not is_concrete(value):
                raise ValueError(f"{name} must be concrete, got a traced number")
        self.half_window = bounded_number("half_window", half_window, "0 or positive")
        self.native_scale = real_number(
            "native_scale", native_scale, positive=True, unit="pixels"
        )
        if self.half_window * self.native_scale > MOST:
            raise ValueError(
                f"half_window must be at most {MOST} pixels of the image, got "
                f"{self.half_window} times native_scale {self.native_scale}"
            )
        self.steepest = angle_below_grazing("steepest", steepest)

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        return self.sensor.sigma(depth, cos_incidence)

    @property
    @override
    def bias(self) -> Bias:
        bias = self.sensor.bias
        reach = math.ceil(self.half_window * self.native_scale)
        return dataclasses.replace(
            bias,
            window_reach=bias.window_reach + reach,
            # What a window reads over an edge moves that by up to its half.
            outline=bias.outline + reach,
        )

    @override
    @compiled
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        check_depth_along_z(camera)
        return self.sensor.sample(key, self._matched(depth, camera), normal, camera)

    def _matched(self, depth: Depths, camera: Any) -> Depths:
        """Depth of the window's part that is of one surface."""
        has = has_surface(depth)
        z = jnp.where(has, depth, 0)
        slope = jnp.tan(jnp.asarray(self.steepest, depth.dtype))
        width = (z if camera.is_central else 1) / jnp.minimum(camera.fx, camera.fy)
        reach = round(self.half_window * self.native_scale)
        side = 2 * reach + 1
        beyond = jnp.pad(z, reach)

        def at(k: Array) -> tuple[Float[Array, "h w"], Bool[Array, "h w"]]:
            row, col = k // side, k % side
            near = jax.lax.dynamic_slice(beyond, (row, col), z.shape)
            away = jnp.maximum(jnp.abs(row - reach), jnp.abs(col - reach))
            most = slope * width * away.astype(z.dtype)
            return near, (near > 0) & (jnp.abs(near - z) <= most)

        def add(
            k: int | Array, sums: tuple[Float[Array, "h w"], Float[Array, "h w"]]
        ) -> tuple[Float[Array, "h w"], Float[Array, "h w"]]:
            total, count = sums
            one, counts = at(jnp.asarray(k))
            other, other_counts = at(side * side - 1 - jnp.asarray(k))
            # Of opposite ones that both count the differences cancel.
            near = jnp.where(counts, one, other)
            total += jnp.where(counts ^ other_counts, near - z, 0)
            both = counts.astype(z.dtype) + other_counts.astype(z.dtype)
            return total, count + both

        # The middle counts in any case.
        start = jnp.zeros_like(z), jnp.ones_like(z)
        total, count = jax.lax.fori_loop(0, side * side // 2, add, start)
        return jnp.where(has, z + total / count, depth)
