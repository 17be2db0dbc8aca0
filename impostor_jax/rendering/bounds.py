"""Box in the image around any shape, from the hull that holds it."""

__all__ = ["ImageBounds", "image_bounds", "ray_coordinates"]

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.camera.base import Projection
from impostor_jax.geometry.hull import AbstractHull
from impostor_jax.geometry.rays import Ray
from impostor_jax.numerics import Numbers, eps, safe_sqrt
from impostor_jax.primitives.base import AbstractPrimitive

Corner = Float[Array, "*batch 2"]


class ImageBounds(eqx.Module):
    """Box in both coordinates of a projection that holds a shape's image.

    Attributes:
        low: Smallest of both; `+inf` of a shape that is wholly behind the camera.
        high: Largest of both.
    """

    low: Corner
    high: Corner


def ray_coordinates(rays: Ray, projection: Projection) -> tuple[Numbers, Numbers]:
    """Where rays lie in the image: both coordinates of the projection."""
    if projection == "parallel":
        return rays.origin.x, rays.origin.y
    d = rays.direction
    if projection == "planar":
        return d.x, d.y
    across = safe_sqrt(d.x * d.x + d.z * d.z)
    return jnp.arctan2(d.x, d.z), jnp.arctan2(-d.y, across)


def image_bounds(primitive: AbstractPrimitive, projection: Projection) -> ImageBounds:
    """Box around the image of a shape, or of each of a batch.

    Args:
        primitive: In the camera frame.
        projection: Of the camera.

    Returns:
        Wider than the outline by a few roundings of the rays. Endless in every
        direction where the shape is not bounded, or reaches behind a camera that looks
        forward alone.
    """
    hull = primitive.hull
    if hull is None:
        everywhere = jnp.full((*primitive.batch_shape, 2), jnp.inf, primitive.dtype)
        return ImageBounds(-everywhere, everywhere)
    if projection == "spherical":
        return _spherical_bounds(hull)
    if projection == "planar":
        reach, nearest, farthest = hull.reach()
        reach = reach + eps(reach.dtype, 8) * (1 + jnp.abs(reach))
        reach = jnp.where((nearest > 0)[..., None], reach, jnp.inf)
        low, high = -reach[..., :2], reach[..., 2:]
    else:
        # Whether a ray from afar meets a shape is rounded as its depth is.
        low, high = hull.box()
        low, high, farthest = low[..., :2], high[..., :2], high[..., 2]
    is_ahead = (farthest > 0)[..., None]
    return ImageBounds(
        low=jnp.where(is_ahead, low, jnp.inf), high=jnp.where(is_ahead, high, -jnp.inf)
    )


def _spherical_bounds(hull: AbstractHull) -> ImageBounds:
    """Azimuths and elevations of the box around a hull along the axes of the frame.

    Seen along y the box is a rectangle. One that holds the origin has all azimuths, and
    so has, for simplicity, one that the half-plane behind the camera cuts, where
    azimuths jump; any other lies between those of two of its corners. The elevation is
    largest on the top of the box where that is nearest, or, of a top below the camera,
    where that is farthest; and its smallest likewise.
    """
    low, high = hull.box()
    (x0, y0, z0), (x1, y1, z1) = (jnp.moveaxis(end, -1, 0) for end in (low, high))
    # Distances from the origin, seen along y, of the nearest and the farthest point.
    beside, ahead = (jnp.maximum(a, -b) for a, b in ((x0, x1), (z0, z1)))
    beside, ahead = jnp.maximum(beside, 0), jnp.maximum(ahead, 0)
    nearest = safe_sqrt(beside * beside + ahead * ahead)
    wide, deep = jnp.maximum(-x0, x1), jnp.maximum(-z0, z1)
    farthest = safe_sqrt(wide * wide + deep * deep)
    top = jnp.arctan2(-y0, jnp.where(y0 < 0, nearest, farthest))
    bottom = jnp.arctan2(-y1, jnp.where(y1 > 0, nearest, farthest))
    corners = jnp.stack([jnp.arctan2(x, z) for x in (x0, x1) for z in (z0, z1)])
    is_cut = (x0 <= 0) & (x1 >= 0) & (z0 <= 0)
    left = jnp.where(is_cut, -math.pi, jnp.min(corners, axis=0))
    right = jnp.where(is_cut, math.pi, jnp.max(corners, axis=0))
    # Of the two arc tangents, of the box and of a ray.
    room = eps(low.dtype, 32)
    return ImageBounds(
        low=jnp.stack([left, bottom], axis=-1) - room,
        high=jnp.stack([right, top], axis=-1) + room,
    )
