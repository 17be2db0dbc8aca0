"""Where a cylinder is expected in an image, and what reads there.

It is rendered a little larger than it is expected, so that all of it is within; pixels
that read near its surface may show it. Others have a reading in front of it, which is
of something that hides it, or behind it, where it is not. Where it stands on a plane
the two cannot be told from each other: pixels of which that is so are left out, by
where they are and not by what they read.
"""

__all__ = ["MARGIN", "NO_PLANES", "Sight", "sight_of"]

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.pixels import Tile
from impostor_jax.compiling import kept
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.rendering.tile import outline_box
from impostor_jax.sensor.base import AbstractDepthNoise

REACH = 0.5
"""Radii from the surface within which a reading is near it, or `SIGMAS`."""

SIGMAS = 5.0
"""Standard deviations of a reading within which it may be of a surface, and two
surfaces cannot be told from each other."""

MARGIN = 2.0
"""Pixels that are rendered around what is expected."""

MOST_MARGIN = 0.25
"""The same in radii, at most."""

SMALLEST_TILE = 64
"""Pixels along a side of the tiles that are rendered, which double: so few programs are
compiled."""

MOST_PLANES = 8
"""That are looked at, the nearest first."""

NO_PLANES = np.zeros((0, 4))


@dataclasses.dataclass(frozen=True)
class Sight:
    """What reads where a cylinder is expected, within a tile of the image.

    Attributes:
        window: The tile's rows and columns; empty where none is expected.
        gap: How far a pixel's reading is from its surface, or from a larger one's, in
            meters; infinite where it is not near.
        expected: How many pixels of the image it would have.
        explained: How many of these read near it.
        empty: How many have a reading behind it. The others have one in front of it, or
            none.
    """

    window: tuple[slice, slice]
    gap: Float[np.ndarray, "r c"]
    expected: int
    explained: int
    empty: int


def sight_of(
    shape: Float[np.ndarray, "8"],
    image: Float[np.ndarray, "h w"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    planes: Float[np.ndarray, "m 4"],
) -> Sight:
    """Look where a cylinder is expected.

    Args:
        shape: Center, axis, radius and height, in the camera's frame.
        image: Depth in meters; 0 where there is no reading.
        camera: Without a pose.
        noise: Of the sensor.
        planes: That the image shows, in the camera's frame: unit normals that face the
            camera, and their product with the points of each.
    """
    shape = shape.astype(np.result_type(image))
    pixel = max(shape[2], shape[6]) / min(float(camera.fx), float(camera.fy))
    margin = np.asarray(min(MARGIN * pixel, MOST_MARGIN * shape[6]), shape.dtype)
    first_row, last_row, first_col, last_col = map(
        int, np.asarray(kept(_box)(shape, margin, camera))
    )
    rows, cols = last_row - first_row + 1, last_col - first_col + 1
    if rows <= 0 or cols <= 0:
        nothing = slice(0, 0)
        blank = np.zeros((0, 0), np.float32)
        return Sight((nothing, nothing), blank, 0, 0, 0)
    side = SMALLEST_TILE
    while side < max(rows, cols):
        side *= 2
    size = min(side, camera.height), min(side, camera.width)
    row = _start(first_row, last_row, size[0], camera.height)
    col = _start(first_col, last_col, size[1], camera.width)
    window = slice(row, row + size[0]), slice(col, col + size[1])
    below = _below(planes, shape).astype(shape.dtype)
    place = np.array([row, col], np.int32)
    gap, counts = kept(_looked)(
        shape, margin, camera, place, image[window], below, noise
    )
    return Sight(window, np.asarray(gap), *map(int, np.asarray(counts)))


def _start(first: int, last: int, length: int, limit: int) -> int:
    """Start of a stretch that is centered on others, within an image."""
    return int(np.clip((first + last + 1 - length) // 2, 0, limit - length))


def _below(
    planes: Float[np.ndarray, "m 4"], shape: Float[np.ndarray, "8"]
) -> Float[np.ndarray, "p 4"]:
    """Planes on which a cylinder may stand; those of its own caps have it behind."""
    height = planes[:, :3] @ shape[:3] - planes[:, 3]
    planes = planes[height > 0][np.argsort(height[height > 0])][:MOST_PLANES]
    below = np.zeros((MOST_PLANES, 4))
    below[: len(planes)] = planes
    return below


def _cylinder(
    shape: Float[Array, "8"], beside: Float[Array, ""], beyond: Float[Array, ""]
) -> Cylinder:
    """One that is larger by a margin beside its wall and by one beyond each end."""
    return eqx.tree_at(
        lambda c: (c.center, c.axis, c.radius, c.height),
        Cylinder((0, 0, 0), (0, 0, 1), 1, 1),
        (shape[:3], shape[3:6], shape[6] + beside, shape[7] + 2 * beyond),
    )


def _box(
    shape: Float[Array, "8"], margin: Float[Array, ""], camera: PinholeCamera
) -> Int[Array, "4"]:
    """First and last row and column of the pixels that may see a larger cylinder."""
    box = outline_box(_cylinder(shape, margin, margin), camera)
    ends = (box.first_row, box.last_row, box.first_col, box.last_col)
    return jnp.stack([jnp.asarray(end, jnp.int32) for end in ends])


def _looked(
    shape: Float[Array, "8"],
    margin: Float[Array, ""],
    camera: PinholeCamera,
    place: Int[Array, "2"],
    reading: Float[Array, "r c"],
    below: Float[Array, "p 4"],
    noise: AbstractDepthNoise,
) -> tuple[Float[Array, "r c"], Int[Array, "3"]]:
    """What `sight_of` compiles: gaps, and what a `Sight` counts."""
    tile = Tile(place[0], place[1], *reading.shape)
    ray = camera.rays(*tile.pixels(), reading.dtype)
    none = jnp.zeros_like(margin)
    own, longer, around = (
        _cylinder(shape, beside, beyond).intersect(ray).t
        for beside, beyond in ((none, none), (none, margin), (margin, margin))
    )
    is_own = jnp.isfinite(own)
    surface = jnp.where(is_own, own, jnp.where(jnp.isfinite(longer), longer, around))
    is_some, is_read = jnp.isfinite(surface), reading > 0
    sigma = noise.sigma(surface, jnp.ones_like(surface))
    reach = jnp.maximum(REACH * shape[6], SIGMAS * sigma)
    off = reading - surface
    is_near = is_some & is_read & (jnp.abs(off) <= reach)
    is_apart = jnp.ones_like(is_near)
    for k in range(MOST_PLANES):
        cosine = ray.direction.dot(Vec3.from_array(below[k, :3]))
        is_met = cosine < 0
        plane = jnp.where(is_met, below[k, 3] / jnp.where(is_met, cosine, 1), jnp.inf)
        is_apart &= plane - surface > SIGMAS * sigma
        # One pixel of the plane at the outline would move a radius by six deviations.
        is_apart &= jnp.abs(plane - reading) > jnp.abs(off)
        # Beside the outline what reads as the plane does is the plane.
        is_apart &= is_own | (plane - reading > SIGMAS * sigma)
    gap = jnp.where(is_near & is_apart, jnp.abs(off), jnp.inf)
    counts = [is_own, is_own & is_near, is_own & is_read & (off > reach)]
    return gap, jnp.stack([jnp.sum(one, dtype=jnp.int32) for one in counts])
