"""The impostor's billboard: a tile of pixels around a shape's exact outline."""

__all__ = ["outline_box", "outline_tile"]

import jax
import jax.numpy as jnp

from impostor_jax.arguments import is_concrete
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.pixels import PixelBox, Tile
from impostor_jax.primitives.base import (
    AbstractPrimitive,
    check_single,
    in_camera_frame,
)
from impostor_jax.primitives.local_world import near_its_camera
from impostor_jax.rendering.bounds import image_bounds

STEP = 16
"""Sides of a tile are multiples of this many pixels, so that few sizes are compiled."""


@near_its_camera
@jax.jit
def outline_box(primitive: AbstractPrimitive, camera: AbstractCamera) -> PixelBox:
    """Smallest box of pixels that holds all whose center ray can meet the shape.

    From the outline's support in four directions, not from max(radius, height): that
    square misses corners, and it is several times too large for a rod.

    Args:
        primitive: Any shape, a single one, in the world frame.
        camera: The camera, with or without a lens.

    Returns:
        The box; empty where no pixel sees the shape. The whole image where the shape
        reaches behind the plane z = 0 of a pinhole camera, and for a shape that has no
        end or whose end is not known in closed form. Of a `SphericalCamera` not the
        smallest: that of the box around the shape along the axes of its frame, and all
        columns where that holds the vertical through the camera or lies behind it.

    Raises:
        ValueError: The shape is a batch.
    """
    check_single(primitive)
    primitive = in_camera_frame(primitive, camera)
    bounds = image_bounds(primitive, camera.projection)
    return camera.pixel_box(bounds.low, bounds.high)


def outline_tile(
    primitive: AbstractPrimitive,
    camera: AbstractCamera,
    shape: tuple[int, int] | None = None,
    margin: int = 0,
) -> Tile:
    """Tile of pixels around a shape's outline.

    Args:
        primitive: Any shape, a single one, in the world frame.
        camera: The camera.
        shape: Rows and columns of the tile. Needed where the primitive or the camera is
            traced, because a size must be known when the program is compiled; the tile
            is then centered on the outline. If None, the smallest multiples of 16
            pixels that hold the outline.
        margin: Pixels around the outline that the tile holds too. 1 makes it hold all
            pixels that are covered in part, whose centers the outline may miss.

    Returns:
        A tile that lies wholly in the image.

    Raises:
        ValueError: `shape` is missing with traced arguments, or exceeds the image; or
            the primitive is a batch.
    """
    box = outline_box(primitive, camera)
    if is_concrete(box):
        # Python's own numbers: each small jax operation would cost 50 us.
        box = jax.tree.map(int, box)
    elif shape is None:
        raise ValueError(
            "shape must be given where primitive or camera is traced: the size of a "
            "tile must be known when the program is compiled"
        )
    if shape is None:
        shape = (
            _rounded_up(box.last_row - box.first_row + 1 + 2 * margin, camera.height),
            _rounded_up(box.last_col - box.first_col + 1 + 2 * margin, camera.width),
        )
    height, width = shape
    if not (0 < height <= camera.height and 0 < width <= camera.width):
        raise ValueError(
            f"shape must be at most the image's {camera.height} x {camera.width} "
            f"pixels, got {height} x {width}"
        )
    return Tile(
        row=_start(box.first_row, box.last_row, height, camera.height),
        col=_start(box.first_col, box.last_col, width, camera.width),
        height=height,
        width=width,
    )


def _rounded_up(length: int, limit: int) -> int:
    return min(limit, STEP * max(1, -(-length // STEP)))


def _start(first, last, length: int, limit: int):
    """Start of a stretch of `length` that is centered on first..last and in range."""
    start = (first + last + 1 - length) // 2
    if isinstance(start, int):
        return min(max(start, 0), limit - length)
    return jnp.clip(start, 0, limit - length)
