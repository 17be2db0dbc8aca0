"""Silhouettes of shapes, each as if it were alone, also beyond the image's border.

What labels of a data set need: which pixels a shape would cover if nothing hid it, and
how many there would be if the border of the image did not cut it off.
"""

__all__ = ["Silhouettes", "silhouettes"]

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from impostor_jax.camera.base import AbstractCamera, check_planar
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.pixels import PixelBox, linear_pixel_box
from impostor_jax.geometry.rays import Ray
from impostor_jax.primitives.base import (
    AbstractPrimitive,
    check_shapes,
    in_camera_frame,
)
from impostor_jax.primitives.local_world import near_its_camera
from impostor_jax.rendering.blocks import Rectangles, Tiling, rectangles_of
from impostor_jax.rendering.bounds import image_bounds
from impostor_jax.rendering.clipping import Clipping, clipping_of

TILING = Tiling(8, 32)
"""Blocks. Long rows fill the processor's lanes."""

Margin = tuple[int, int]
"""Rows above and below the image, columns on its left and right."""


class Silhouettes(eqx.Module):
    """Pixels that a shape covers, or each of a batch.

    Attributes:
        mask: Those of the image.
        count: Number of those of the image and its margin.
        box: The smallest block of pixels that holds all of these, in rows and columns
            of the image, which are negative before it; empty where there are none.
    """

    mask: Bool[Array, "*batch h w"]
    count: Int[Array, "*batch"]
    box: PixelBox


class _Found(eqx.Module):
    """Number of pixels, and the smallest and largest row and column."""

    count: Int[Array, ""]
    low: Int[Array, "2"]
    high: Int[Array, "2"]

    @staticmethod
    def nothing() -> "_Found":
        limit = jnp.iinfo(jnp.int32).max
        low = jnp.full(2, limit, jnp.int32)
        return _Found(jnp.zeros((), jnp.int32), low, -low)

    def and_(
        self, hit: Bool[Array, "h w"], row: Int[Array, "h w"], col: Int[Array, "h w"]
    ) -> "_Found":
        """With the hits of a block."""
        at = jnp.stack([row, col])
        far = jnp.iinfo(jnp.int32).max
        low = jnp.min(jnp.where(hit[None], at, far), axis=(1, 2))
        high = jnp.max(jnp.where(hit[None], at, -far), axis=(1, 2))
        low, high = jnp.minimum(low, self.low), jnp.maximum(high, self.high)
        count = self.count + jnp.sum(hit, dtype=jnp.int32)
        return _Found(count, low, high)


@near_its_camera
def silhouettes(
    shapes: AbstractPrimitive,
    camera: AbstractCamera,
    margin: Margin = (0, 0),
    near: Any = None,
    far: Any = None,
) -> Silhouettes:
    """Find the pixels whose center's ray meets a shape, whatever else is before it.

    The work is that of the pixels that the shapes can cover. Map over several images
    with `jax.lax.map`: `jax.vmap` would do the work of the largest for each. It has no
    derivative; `coverage` has one.

    Args:
        shapes: A single one, or a batch (n,) of one type, in the world frame.
        camera: The camera. Its lens ends with the image: the margin is that of a camera
            without one.
        margin: Rows above and below the image, and columns on its left and right, in
            which pixels are counted, too.
        near: Depth in meters, as `render` has it, in front of which everything is cut
            away; None for 0. It may be traced, as `far` may.
        far: Depth in meters behind which everything is cut away; None for no end.

    Raises:
        ValueError: The shapes are a batch of more axes or none at all, the margin or
            near is negative, far is not more than near, or the camera is no
            `PinholeCamera` and there is a margin.
    """
    check_shapes([shapes])
    if min(margin) < 0:
        raise ValueError(f"margin must not be negative, got {margin} pixels")
    if any(margin):
        check_planar(camera)
    clipping = clipping_of(near, far, camera)
    if shapes.batch_shape:
        return _silhouettes(shapes, camera, clipping, margin)
    alone = jax.tree.map(lambda x: jnp.asarray(x)[None], shapes)
    return jax.tree.map(lambda x: x[0], _silhouettes(alone, camera, clipping, margin))


@partial(jax.jit, static_argnames="margin")
def _silhouettes(
    shapes: AbstractPrimitive,
    camera: AbstractCamera,
    clipping: Clipping | None,
    margin: Margin,
) -> Silhouettes:
    shapes = jax.vmap(lambda shape: in_camera_frame(shape, camera))(shapes)
    row, col = camera.frame.pixels()
    rays = camera.rays(row, col, shapes.dtype)
    every = jnp.ones(shapes.batch_shape, bool)
    extent = TILING.extent(rays, camera.projection)
    blocks = rectangles_of(shapes, every, extent, camera.projection)
    is_pixel = camera.sees(row, col)
    is_pixel = jnp.ones_like(row, bool) if is_pixel is None else is_pixel
    # What fills up the last blocks is no pixel.
    rays = jax.tree.map(TILING.made_whole, rays)
    is_pixel = TILING.made_whole(is_pixel, mode="constant")
    cut = partial(jax.lax.dynamic_slice, slice_sizes=TILING)

    def cover(given):
        shape, mine = given

        def at_block(number, state):
            mask, found = state
            corner = _corner(mine, number)
            ray, real = jax.tree.map(lambda x: cut(x, corner), (rays, is_pixel))
            hit = _is_met(shape, ray, clipping) & real
            mask = jax.lax.dynamic_update_slice(mask, hit, corner)
            return mask, found.and_(hit, *_pixels(corner))

        start = jnp.zeros(is_pixel.shape, bool), _Found.nothing()
        mask, found = jax.lax.fori_loop(0, mine.count, at_block, start)
        if any(margin):
            assert isinstance(camera, PinholeCamera)
            found = _beyond(shape, camera, clipping, margin, found)
        low, high = found.low, found.high
        box = PixelBox(low[0], high[0], low[1], high[1])
        return Silhouettes(mask[: camera.height, : camera.width], found.count, box)

    return jax.lax.map(cover, (shapes, blocks))


def _is_met(
    shape: AbstractPrimitive, ray: Ray, clipping: Clipping | None
) -> Bool[Array, "h w"]:
    """Whether rays of a camera meet a shape at a depth that is seen."""
    if clipping is None:
        return shape.intersect(ray).mask
    t = shape.intersect(clipping.started(ray)).t
    return jnp.isfinite(clipping.depth(t))


def _corner(
    blocks: Rectangles, number: Int[Array, ""]
) -> tuple[Int[Array, ""], Int[Array, ""]]:
    """First row and column of pixels of one of a single shape's blocks."""
    row, col = blocks.block(number)
    return TILING.rows * row, TILING.cols * col


def _pixels(
    corner: tuple[Int[Array, ""], Int[Array, ""]],
) -> tuple[Int[Array, "h w"], Int[Array, "h w"]]:
    """Rows and columns of a block."""
    row, col = (
        jax.lax.broadcasted_iota(jnp.int32, TILING, axis) + first
        for axis, first in enumerate(corner)
    )
    return row, col


def _beyond(
    shape: AbstractPrimitive,
    camera: PinholeCamera,
    clipping: Clipping | None,
    margin: Margin,
    found: _Found,
) -> _Found:
    """What is found with a shape's pixels in the margin, which are cast as needed."""
    above, left = margin
    # Of the image and its margin; its rays are those of the image without its lens.
    wide = PinholeCamera(
        camera.fx, camera.fy, camera.cx + left, camera.cy + above,
        camera.width + 2 * left, camera.height + 2 * above,
    )  # fmt: skip
    bounds = image_bounds(shape, "planar")
    box = jax.tree.map(jnp.asarray, linear_pixel_box(wide, bounds.low, bounds.high))
    row, col = box.first_row // TILING.rows, box.first_col // TILING.cols
    num_rows = box.last_row // TILING.rows + 1 - row
    num_cols = box.last_col // TILING.cols + 1 - col
    is_empty = (box.last_row < box.first_row) | (box.last_col < box.first_col)
    blocks = Rectangles(row, jnp.where(is_empty, 0, num_rows), col, num_cols)

    def at_block(number: Int[Array, ""], found: _Found) -> _Found:
        row, col = _pixels(_corner(blocks, number))
        y, x = row - above, col - left
        outside = (y < 0) | (y >= camera.height) | (x < 0) | (x >= camera.width)
        outside = outside & (row < wide.height) & (col < wide.width)

        def cast(found: _Found) -> _Found:
            hit = _is_met(shape, wide.rays(row, col, shape.dtype), clipping)
            return found.and_(hit & outside, y, x)

        return jax.lax.cond(jnp.any(outside), cast, lambda found: found, found)

    return jax.lax.fori_loop(0, blocks.count, at_block, found)
