"""Depth aligned to another camera: each reading is copied to several pixels.

A driver that aligns depth to a color camera copies each native reading to all pixels
that its square touches, and the nearest wins where two squares meet. So what is nearer
reaches over what is farther, and walls lean outward: by about half a pixel of the
image, which no average over readings takes away.
"""

__all__ = ["LEAN", "AlignedDepth"]

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import is_concrete, real_number
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.compiling import compiled
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, Scalar
from impostor_jax.sensor.across import MOST_SLANT
from impostor_jax.sensor.base import (
    NO_READING,
    AbstractDepthNoise,
    Depths,
    Normals,
    noise_model,
)
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.surface import has_surface

LEAN = 0.6
"""Standard deviation, in pixels of the image, by which the nearer reaches too far.

Two squares share one pixel, so either is half a pixel too wide: by 0.5 along rows or
columns, 0.7 along a diagonal; and that a copy is told along the ray of its own pixel
adds to it. Fits to cans of 40 mm, 20 to 120 pixels wide, drawn at scales of 1.25 to 3,
come out 0.44 to 0.87 pixels too large in radius, and 0.57 where pixels were only
repeated: too far apart to be corrected.
"""

MOST_SCALE = 10.0
"""Pixels of the image along a native one, at most."""


class AlignedDepth(AbstractDepthNoise):
    """A sensor whose image was warped to a camera of finer pixels, the nearest first.

    The grid of its native pixels lies anywhere over the image's, in all of the image
    alike: the parallax that bends it is left out. A native pixel reads what its middle
    sees, and that is copied to all pixels of the image that it touches, of which some
    are touched by others, too: there the nearest reading is kept. So an object grows at
    its outline by up to a pixel, also over places where nothing is hit.

    A fit does not correct the lean: it counts it in, as `std_budget["alignment"]`, and
    takes errors of neighbors for correlated. Native depth has none of this.

    Args:
        sensor: The noise model that makes the readings. What it says of pixels is of
            the image's.
        native_scale: Pixels of the image along one native pixel, from 1 to 10: the
            ratio of the two focal lengths.
    """

    sensor: AbstractDepthNoise
    native_scale: Scalar

    def __init__(self, sensor: Any, native_scale: Any = 1.5):
        self.sensor = noise_model(sensor)
        scale = real_number("native_scale", native_scale)
        if is_concrete(scale) and not 1 <= scale <= MOST_SCALE:
            raise ValueError(
                f"native_scale must be from 1 to 10 pixels of the image, got {scale}"
            )
        self.native_scale = scale

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        return self.sensor.sigma(depth, cos_incidence)

    @property
    @override
    def bias(self) -> Bias:
        return dataclasses.replace(self.sensor.bias, lean=LEAN)

    @override
    @compiled
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        place_key, sensor_key = jax.random.split(key)
        scale = jnp.asarray(self.native_scale, depth.dtype)
        origin = scale * jax.random.uniform(place_key, (2,), depth.dtype)
        reading = self.sensor.sample(sensor_key, depth, normal, camera)
        row, col = camera.frame.pixels()
        rows, cols = _touching(row, origin[0], scale), _touching(col, origin[1], scale)
        nearest = jnp.full_like(depth, jnp.inf)
        for i in rows:
            for j in cols:
                one = _read_at(i, j, reading, depth, normal, camera)
                nearest = jnp.minimum(nearest, jnp.where(one > 0, one, jnp.inf))
        missing = jnp.where(has_surface(depth), NO_READING, jnp.inf)
        return jnp.where(jnp.isfinite(nearest), nearest, missing)


def _touching(
    index: Int[Array, "h w"], origin: Float[Array, ""], scale: Float[Array, ""]
) -> tuple[Float[Array, "h w"], Float[Array, "h w"]]:
    """Middles of the first and the last native pixel that touch a row or column."""
    # A pixel reaches from its index to that + 1; the middle of one is its index.
    start = index.astype(scale.dtype) - origin

    def middle(native: Float[Array, "h w"]) -> Float[Array, "h w"]:
        return scale * (native + 0.5) + origin - 0.5

    first, last = jnp.floor(start / scale), jnp.ceil((start + 1) / scale) - 1
    return middle(first), middle(last)


def _read_at(
    row: Float[Array, "h w"],
    col: Float[Array, "h w"],
    reading: Depths,
    depth: Depths,
    normal: Normals,
    camera: AbstractCamera,
) -> Depths:
    """What is read at places between pixels: of the nearest pixel's plane."""
    height, width = depth.shape
    i = jnp.clip(jnp.round(row).astype(jnp.int32), 0, height - 1)
    j = jnp.clip(jnp.round(col).astype(jnp.int32), 0, width - 1)
    down, right = row - i.astype(depth.dtype), col - j.astype(depth.dtype)
    # Rays between pixels, from those of the neighbors within the image.
    below, beside = jnp.where(i > 0, -1, 1), jnp.where(j > 0, -1, 1)
    d = camera.rays(i, j, depth.dtype).direction
    d_row = camera.rays(i + below, j, depth.dtype).direction - d
    d_col = camera.rays(i, j + beside, depth.dtype).direction - d
    turned = d + d_row * (down * below.astype(depth.dtype))
    turned = turned + d_col * (right * beside.astype(depth.dtype))
    n = Vec3.from_array(normal[i, j])
    least = -MOST_SLANT * d.norm()
    ratio = jnp.minimum(n.dot(d), least) / jnp.minimum(n.dot(turned), least)
    there = has_surface(depth[i, j]) & (reading[i, j] > 0)
    read = jnp.where(there, reading[i, j], 0)
    return jnp.where(there & jnp.isfinite(read), read * ratio, NO_READING)
