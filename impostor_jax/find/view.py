"""A depth image as the search sees it: readings, rays and their noise.

What is searched has a bounded number of pixels, of a large image every n-th row and
column; the fits that follow take all of them. Of a camera with a center the inverse
depth of a plane is linear in the rays, of an orthographic one the depth: `linear` is
the one that is.
"""

__all__ = ["Box", "View", "dense_stride", "sigmas_of", "stride_of", "view_of"]

import dataclasses
import itertools
import math
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Shaped

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.fit.regions import NOISY, SQUARE, STEEP
from impostor_jax.opencv import cv2
from impostor_jax.sensor.base import AbstractDepthNoise

INCIDENCES = np.radians(np.arange(0, 90, 10)).astype(np.float32)
"""Angles at which `View.grazing` is known, in radians."""

DENSE = 0.7
"""Share of readings within their closed outline from which their neighbors tell
normals."""

MOST_SPARSE = 4
"""Stride up to which an image with holes is searched more coarsely."""

Box = tuple[slice, slice]
"""Rows and columns of a block of pixels."""


@dataclasses.dataclass(frozen=True)
class View:
    """What is searched.

    Attributes:
        depth: In meters; 0 where there is no reading.
        x: Of each ray's direction at z = 1, or of its origin where rays are parallel.
        y: Likewise.
        is_central: Whether the rays meet in the origin.
        sigma: Standard deviation of each reading if its surface were seen face on, in
            meters; 0 where there is none.
        grazing: Factor of `sigma` at each of `INCIDENCES`.
        footprint: Distance of neighboring rays over the depth; in meters where rays are
            parallel.
        stride: Every n-th row and column of the image is here; of a block without a
            reading in its first pixel another one.
    """

    depth: Float[np.ndarray, "h w"]
    x: Float[np.ndarray, "h w"]
    y: Float[np.ndarray, "h w"]
    is_central: bool
    sigma: Float[np.ndarray, "h w"]
    grazing: Float[np.ndarray, "9"]
    footprint: float
    stride: int

    @cached_property
    def valid(self) -> Bool[np.ndarray, "h w"]:
        """Where there is a reading."""
        return self.depth > 0

    @cached_property
    def linear(self) -> Float[np.ndarray, "h w"]:
        """What is linear in x and y on a plane; 0 where there is no reading."""
        if not self.is_central:
            return self.depth
        return np.where(self.valid, 1 / np.where(self.valid, self.depth, 1), 0)

    @cached_property
    def linear_sigma(self) -> Float[np.ndarray, "h w"]:
        """Standard deviation of `linear`, face on."""
        return self.sigma * self.linear**2 if self.is_central else self.sigma

    @cached_property
    def points(self) -> Float[np.ndarray, "h w 3"]:
        """Points of the camera frame that the readings show, in meters."""
        return self.lifted(self.x, self.y, self.depth)

    @cached_property
    def views(self) -> Float[np.ndarray, "h w 3"]:
        """Unit directions in which the pixels look."""
        one, zero = np.ones_like(self.x), np.zeros_like(self.x)
        if not self.is_central:
            return np.stack([zero, zero, one], axis=-1)
        toward = np.stack([self.x, self.y, one], axis=-1)
        return toward / np.sqrt(self.x**2 + self.y**2 + 1)[..., None]

    @cached_property
    def _bounds(self) -> tuple[np.ndarray, ...]:
        """Smallest and largest x of each column, and y of each row."""
        x, y = self.x, self.y
        return x.min(axis=0), x.max(axis=0), y.min(axis=1), y.max(axis=1)

    def enlarged(
        self, field: Shaped[np.ndarray, "h w"], shape: tuple[int, int]
    ) -> Shaped[np.ndarray, "H W"]:
        """A field of the view, told of all pixels of an image of that shape."""
        if self.stride == 1:
            return field
        # Whole rows last: that is copied twice as fast.
        whole = field.repeat(self.stride, axis=1).repeat(self.stride, axis=0)
        return whole[: shape[0], : shape[1]]

    def agrees(
        self, depth: Float[np.ndarray, "H W"]
    ) -> Bool[np.ndarray, "H W"] | np.bool_:
        """Pixels of the image that show what their pixel of the view does, or nothing.

        Of a block at an edge some may be of what lies beside.
        """
        if self.stride == 1:
            return np.True_
        reach = NOISY * self.sigma + STEEP * self.width(self.depth)
        own, reach = (self.enlarged(part, depth.shape) for part in (self.depth, reach))
        return (depth == 0) | (np.abs(depth - own) <= reach)

    def lifted(
        self,
        x: Float[np.ndarray, "*b"],
        y: Float[np.ndarray, "*b"],
        depth: Float[np.ndarray, "*b"],
    ) -> Float[np.ndarray, "*b 3"]:
        """Points of the camera frame that rays meet at a depth, in meters."""
        if self.is_central:
            x, y = x * depth, y * depth
        return np.stack([x, y, depth], axis=-1)

    def width(self, depth: Any) -> Any:
        """Of a pixel at a depth, in meters."""
        return self.footprint * depth if self.is_central else self.footprint + 0 * depth

    def deviation(self, depth: Any, sigma: Any, cosine: Any) -> Any:
        """Standard deviation of readings along z of a surface, in meters.

        Noise grows where the view grazes, and a reading is off by about a third of a
        pixel sideways; without that everything near an edge would be refuted.

        Args:
            depth: Of the surface, in meters.
            sigma: Face on, in meters.
            cosine: Of the incidence; of either sign.
        """
        cosine = np.clip(np.abs(cosine), 0.05, 1)
        factor = np.interp(np.arccos(cosine), INCIDENCES, self.grazing)
        tangent = np.sqrt(1 - cosine * cosine) / cosine
        return np.hypot(sigma * factor, self.width(depth) / 3 * tangent)

    def box_around(self, points: Float[np.ndarray, "n 3"]) -> Box | None:
        """Smallest block of pixels that holds some points; None where it is empty.

        The whole image where a point is not in front of the camera.
        """
        if self.is_central:
            near = points[:, 2] < 0.01 * np.abs(points).max()
            if near.all():
                return None
            if near.any():
                return slice(0, self.depth.shape[0]), slice(0, self.depth.shape[1])
            points = points / points[:, 2:]
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        left, right, top, bottom = self._bounds
        cols = np.flatnonzero((right >= low[0]) & (left <= high[0]))
        rows = np.flatnonzero((bottom >= low[1]) & (top <= high[1]))
        if not (len(rows) and len(cols)):
            return None
        return slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1)


def view_of(
    depth: Float[np.ndarray, "h w"],
    camera: AbstractCamera,
    noise: AbstractDepthNoise,
    most_pixels: int,
    stride: int = 1,
) -> View:
    """The view of an image.

    Args:
        depth: In meters; 0 where there is no reading.
        camera: That took it; concrete.
        noise: Of its readings.
        most_pixels: That are searched.
        stride: Of rows and columns; larger where there would be more pixels.
    """
    stride = stride_of(depth.shape, most_pixels, stride)
    pick = _pick(depth, stride)
    x, y, sees = (np.asarray(part)[pick] for part in _rays(camera))
    picked = np.where(sees, depth[pick], 0).astype(np.float32)
    sigma, grazing = sigmas_of(noise, picked)
    return View(
        depth=picked,
        x=x,
        y=y,
        is_central=camera.is_central,
        sigma=sigma,
        grazing=grazing,
        footprint=stride / min(_focal(camera)),
        stride=stride,
    )


def dense_stride(depth: Float[np.ndarray, "h w"], stride: int) -> int:
    """Stride from which on an image has few holes between readings; at least as given.

    One that was warped to the rays of a camera of a longer focal length has readings
    with holes around each of them.

    Args:
        depth: In meters; 0 where there is no reading.
        stride: At least.
    """
    for coarser in range(stride, max(stride, MOST_SPARSE) + 1):
        valid = (depth[_pick(depth, coarser)] > 0).astype(np.uint8)
        closed = cv2.morphologyEx(valid, cv2.MORPH_CLOSE, SQUARE)
        if np.count_nonzero(valid) >= DENSE * np.count_nonzero(closed):
            return coarser
    return stride


def _pick(depth: Float[np.ndarray, "h w"], stride: int) -> tuple[Any, Any]:
    """Index of a pixel of each block, with a reading where one has any."""
    height, width = depth.shape
    rows, cols = slice(None, None, stride), slice(None, None, stride)
    if stride == 1 or depth[rows, cols].all():
        return rows, cols
    first = np.ix_(np.arange(0, height, stride), np.arange(0, width, stride))
    row, col = (np.array(part) for part in np.broadcast_arrays(*first))
    for down, right in sorted(itertools.product(range(stride), repeat=2), key=sum):
        other = (
            np.minimum(first[0] + down, height - 1),
            np.minimum(first[1] + right, width - 1),
        )
        better = (depth[row, col] == 0) & (depth[other] > 0)
        row, col = np.where(better, other[0], row), np.where(better, other[1], col)
    return row, col


def stride_of(shape: tuple[int, int], most_pixels: int, stride: int) -> int:
    """Stride with which an image has no more pixels than are searched."""
    return max(stride, math.ceil(math.sqrt(math.prod(shape) / most_pixels)))


def sigmas_of(
    noise: AbstractDepthNoise, depth: Float[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "9"]]:
    """Deviation of readings that are seen face on, and its factor at `INCIDENCES`.

    Args:
        noise: Of the readings.
        depth: In meters; 0 where there is no reading, whose deviation is 0.
    """
    known = depth[depth > 0]
    middle = np.float32(np.median(known[::16]) if len(known) else 1)
    sigma, turned = jax.tree.map(np.asarray, _sigmas(noise, depth, middle))
    return np.where(depth > 0, sigma, 0).astype(np.float32), turned / turned[0]


def _focal(camera: Any) -> tuple[float, float]:
    """Of both kinds of camera: pixels a unit of x and y."""
    return float(camera.fx), float(camera.fy)


@jax.jit
def _sigmas(
    noise: AbstractDepthNoise, depth: Float[Array, "h w"], middle: Float[Array, ""]
) -> tuple[Float[Array, "h w"], Float[Array, "9"]]:
    """Of readings that are seen face on, and at each of `INCIDENCES`."""
    turned = noise.sigma(jnp.full(INCIDENCES.shape, middle), jnp.cos(INCIDENCES))
    return noise.sigma(depth, jnp.ones_like(depth)), turned


@jax.jit
def _rays(camera: AbstractCamera) -> tuple[Array, Array, Array]:
    """The x and y of the rays, and which pixels see anything."""
    row, col = camera.frame.pixels()
    ray, sees = camera.rays(row, col, jnp.float32), camera.sees(row, col)
    part = ray.direction if camera.is_central else ray.origin
    return part.x, part.y, jnp.ones(row.shape, bool) if sees is None else sees
