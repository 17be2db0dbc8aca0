"""Errors across the ray: a reading may be of a place beside the ray that it is told by.

A beam points a little elsewhere, a file rounds coordinates to a grid, scans are joined
by poses that err, a surface is rough. On a surface that faces the sensor that changes
nothing; the more a ray grazes, the more it moves the reading along the ray.
"""

__all__ = ["AcrossRay", "errors_across", "moved_across"]

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, PRNGKeyArray
from typing_extensions import override

from impostor_jax.arguments import bounded_number
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, Scalar, safe_divide
from impostor_jax.sensor.base import AbstractDepthNoise, Depths, Normals, noise_model
from impostor_jax.sensor.bias import Bias
from impostor_jax.sensor.draws import normal_draws
from impostor_jax.sensor.surface import has_surface

MOST_SLANT = 0.05
"""Least cosine of the incidence up to which a surface is followed beside the ray."""


def errors_across(across: Any, angle: Any) -> tuple[Scalar | None, Scalar | None]:
    """Checked standard deviations across the ray; what is not known stays None.

    Args:
        across: Of a reading's place, along each of two directions, in meters.
        angle: Of the ray's direction, likewise, in radians.
    """
    if across is not None:
        across = bounded_number("across", across, "0 or positive, in meters")
    if angle is not None:
        angle = bounded_number("angle", angle, "from 0 to 0.1 radians", 0.1)
    return across, angle


class AcrossRay(AbstractDepthNoise):
    """A sensor whose readings err across their rays, as a fit learns it.

    Args:
        sensor: The noise model that makes the readings.
        across: Standard deviation across the ray, in meters, beside the sensor's own.
        along: More of it along the ray, in meters: a grid errs in all directions.
        doubt: Standard deviation of the square of `across`, in square meters.
    """

    sensor: AbstractDepthNoise
    across: Scalar
    along: Scalar
    doubt: Scalar

    def __init__(self, sensor: Any, across: Any, along: Any = 0.0, doubt: Any = 0.0):
        self.sensor = noise_model(sensor)
        self.across = bounded_number("across", across, "0 or positive, in meters")
        self.along = bounded_number("along", along, "0 or positive, in meters")
        self.doubt = bounded_number("doubt", doubt, "0 or positive, in square meters")

    def doubted(self) -> "AcrossRay":
        """The same with an error across the ray that is as large as it may well be."""
        more = jnp.sqrt(jnp.asarray(self.across) ** 2 + jnp.asarray(self.doubt))
        return dataclasses.replace(self, across=more)

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        along = jnp.asarray(self.along, depth.dtype)
        return jnp.hypot(self.sensor.sigma(depth, cos_incidence), along)

    @property
    @override
    def bias(self) -> Bias:
        bias = self.sensor.bias
        own = jnp.asarray(self.across)
        if bias.across is not None:
            own = jnp.hypot(own, jnp.asarray(bias.across, own.dtype))
        return dataclasses.replace(bias, across=own)

    @override
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        raise NotImplementedError("what a fit learns of a sensor is not drawn")


def moved_across(
    key: PRNGKeyArray,
    depth: Depths,
    normal: Normals,
    camera: AbstractCamera,
    bias: Bias,
) -> tuple[PRNGKeyArray, Depths]:
    """Depths of a scene along rays that each err, told as of the rays that are known.

    A ray's error is normal, as large along the columns as along the rows. It meets the
    surface of the pixel that is nearest to it, continued as a plane. Rays that are
    exact, or of which nothing is said, leave all as it is.

    Args:
        key: Random key.
        depth: As of `AbstractDepthNoise.sample`.
        normal: Likewise.
        camera: Likewise.
        bias: Of the sensor.

    Returns:
        A key for what else is drawn, and the depths.
    """
    if bias.has_exact_rays:
        return key, depth
    key, own = jax.random.split(key)
    return key, _beside(own, depth, normal, camera, bias)


def _beside(
    key: PRNGKeyArray,
    depth: Depths,
    normal: Normals,
    camera: AbstractCamera,
    bias: Bias,
) -> Depths:
    height, width = depth.shape
    draw = normal_draws(key, (2 * height, width), depth.dtype)
    row, col = camera.frame.pixels()
    rays = camera.rays(row, col, depth.dtype)
    far = jnp.where(has_surface(depth), depth, 0)
    error = bias.across_at(far * rays.direction.norm())

    def beside(down: int, right: int, drawn: Array) -> tuple[Ray, Numbers]:
        """Change of a ray to that of a neighboring pixel, and how many that it errs."""
        is_out = (row + down >= height) | (col + right >= width)
        sign = jnp.where(is_out, -1, 1)
        near = camera.rays(row + sign * down, col + sign * right, depth.dtype)
        factor = sign.astype(depth.dtype)
        shift = (near.origin - rays.origin) * factor
        turn = (near.direction - rays.direction) * factor
        aside = shift + turn * far
        along = rays.direction.normalize()
        aside = aside - along * aside.dot(along)
        return Ray(shift, turn), drawn * safe_divide(error, aside.norm())

    down, rows = beside(1, 0, draw[:height])
    right, cols = beside(0, 1, draw[height:])
    near_row = jnp.clip(row + jnp.round(rows).astype(jnp.int32), 0, height - 1)
    near_col = jnp.clip(col + jnp.round(cols).astype(jnp.int32), 0, width - 1)
    rest_row = rows - (near_row - row).astype(depth.dtype)
    rest_col = cols - (near_col - col).astype(depth.dtype)
    met, n = depth[near_row, near_col], Vec3.from_array(normal[near_row, near_col])
    near = camera.rays(near_row, near_col, depth.dtype)
    there = has_surface(met)
    z = jnp.where(there, met, 1)
    # The plane through the nearest pixel's point, o + z d with the normal n, is met by
    # another ray, o' + z' d', at z' = (n.(o - o') + z n.d) / n.d'.
    shift = down.origin * rest_row + right.origin * rest_col
    turn = down.direction * rest_row + right.direction * rest_col
    least = MOST_SLANT * near.direction.norm()
    toward = near.direction + turn
    facing = jnp.minimum(n.dot(toward), -least)
    ahead = z * jnp.minimum(n.dot(near.direction), -least) - n.dot(shift)
    place = near.origin + shift + toward * (ahead / facing) - rays.origin
    # What is read is a distance, along the ray that is known.
    moved = place.dot(rays.direction) / rays.direction.dot(rays.direction)
    return jnp.where(there & (moved > 0), moved, met)
