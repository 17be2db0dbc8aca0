"""A depth image as the search sees it: readings, rays and noise, reduced to a size.

What is searched has at most as many pixels as a search is worth; the fits that follow
take all of them. Of a camera with a center the inverse depth of a plane is linear in
the rays, of an orthographic one the depth; `linear` is the one that is.
"""

__all__ = ["View", "view_of"]

import functools
import json
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.sensor.base import AbstractDepthNoise

MOST_PIXELS = 340_000
"""Of a view: every n-th row and column of a larger image is searched."""


class View(NamedTuple):
    """What is searched, all of one shape (h, w) unless it says otherwise.

    Attributes:
        depth: In meters; 0 where there is no reading.
        x: Of the ray's direction at z = 1, or of its origin where rays are parallel.
        y: Likewise.
        is_central: Whether rays meet in the origin.
        sigma: Standard deviation of a reading of a surface seen face on, in meters.
        grazing: Factor of `sigma` at incidences of 0, 10, ..., 80 degrees, (9,).
        footprint: Distance of neighboring rays over the depth, or that of parallel
            rays, in meters.
        stride: Every n-th row and column of the image is here.
    """

    depth: Float[np.ndarray, "h w"]
    x: Float[np.ndarray, "h w"]
    y: Float[np.ndarray, "h w"]
    is_central: bool
    sigma: Float[np.ndarray, "h w"]
    grazing: Float[np.ndarray, "9"]
    footprint: float
    stride: int

    @property
    def valid(self) -> Bool[np.ndarray, "h w"]:
        """Where there is a reading."""
        return self.depth > 0

    @property
    def linear(self) -> Float[np.ndarray, "h w"]:
        """What is linear in x and y on a plane; 0 where there is no reading."""
        if not self.is_central:
            return self.depth
        valid = self.valid
        return np.where(valid, 1 / np.where(valid, self.depth, 1), 0)

    @property
    def linear_sigma(self) -> Float[np.ndarray, "h w"]:
        """Standard deviation of `linear`, face on."""
        if not self.is_central:
            return self.sigma
        return self.sigma * self.linear**2

    def width(self, depth: Any) -> Any:
        """Of a pixel at a depth, in meters."""
        return self.footprint * depth if self.is_central else self.footprint + 0 * depth

    def points(self, index: Any = ...) -> Float[np.ndarray, "... 3"]:
        """Points of the camera frame that some pixels show."""
        x, y, z = self.x[index], self.y[index], self.depth[index]
        if self.is_central:
            x, y = x * z, y * z
        return np.stack([x, y, z], axis=-1)

    def views(self, index: Any = ...) -> Float[np.ndarray, "... 3"]:
        """Unit directions in which some pixels look."""
        x, y = self.x[index], self.y[index]
        if not self.is_central:
            return np.stack([0 * x, 0 * x, 1 + 0 * x], axis=-1)
        length = np.sqrt(1 + x * x + y * y)
        return np.stack([x, y, np.ones_like(x)], axis=-1) / length[..., None]


def view_of(
    depth: Float[np.ndarray, "h w"],
    camera: AbstractCamera,
    noise: AbstractDepthNoise,
    most_pixels: int = MOST_PIXELS,
) -> View:
    """The view of an image.

    Args:
        depth: In meters; 0 where there is no reading.
        camera: That took it; concrete.
        noise: Of its readings.
        most_pixels: That are searched.
    """
    stride = max(1, int(np.ceil(np.sqrt(depth.size / most_pixels))))
    x, y, sees = _rays(camera)
    pick = np.s_[::stride, ::stride]
    depth = np.where(sees, depth, 0)[pick].astype(np.float32)
    x, y = x[pick], y[pick]
    focal = min(float(camera.fx), float(camera.fy))
    sigma, grazing = jax.tree.map(np.asarray, _sigmas(noise, depth))
    sigma = np.where(depth > 0, sigma, 0).astype(np.float32)
    return View(
        depth, x, y, camera.is_central, sigma, grazing, stride / focal, stride
    )


@jax.jit
def _sigmas(noise: AbstractDepthNoise, depth: Any) -> Any:
    sigma = noise.sigma(depth, jnp.ones_like(depth))
    angles = np.radians(np.arange(0, 90, 10)).astype(depth.dtype)
    middle = jnp.where(depth > 0, depth, jnp.nan)
    middle = jnp.nanmedian(middle[::8, ::8])
    middle = jnp.where(jnp.isfinite(middle), middle, 1)
    turned = noise.sigma(jnp.full(9, middle), jnp.cos(angles))
    return sigma, turned / turned[0]


def _rays(camera: AbstractCamera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    row, col = camera.frame.pixels()
    ray = camera.rays(row, col, jnp.float32)
    sees = camera.sees(row, col)
    part = ray.direction if camera.is_central else ray.origin
    shape = (camera.height, camera.width)
    x, y = (np.broadcast_to(np.asarray(v), shape) for v in (part.x, part.y))
    is_seen = np.ones(shape, bool) if sees is None else np.asarray(sees)
    return x, y, is_seen
