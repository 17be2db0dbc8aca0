"""Box in the image around any shape, from its exact outline.

A cylinder or a frustum is the hull of its two end discs, a box that of its corners, and
a sphere is seen within a cone. A camera in front of them keeps hulls, and each has an
explicit support function: how far its image reaches in a direction. A torus is within
the cylinder around it. What has no end, or an unknown one, may be seen anywhere.
"""

__all__ = ["ImageBounds", "image_bounds", "is_bounded"]

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps, safe_sqrt
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.torus import Torus

Corner = Float[Array, "2"]
Disc = tuple[Vec3, Vec3, Float[Array, ""]]

SIDES = ((-1.0, 0.0, 1.0, 0.0), (0.0, -1.0, 0.0, 1.0))
"""Components of the four directions in which a box ends."""


class ImageBounds(eqx.Module):
    """Box in the plane z = 1, or across parallel rays, that holds a shape's image.

    Attributes:
        low: Smallest x and y; `+inf` of a shape that is wholly behind the camera.
        high: Largest x and y.
    """

    low: Corner
    high: Corner


def is_bounded(kind: type[AbstractPrimitive]) -> bool:
    """Whether shapes of a type have bounds; else they may be seen anywhere."""
    return kind in _BOUNDS


def image_bounds(primitive: AbstractPrimitive, is_central: bool) -> ImageBounds:
    """Box around one shape's image.

    Args:
        primitive: A single one, in the camera frame.
        is_central: Whether the camera's rays start in its origin; else along z.

    Returns:
        Wider than the outline by a few roundings of the rays. Endless in every
        direction where the shape reaches behind the camera, or is not bounded.
    """
    bounds = _BOUNDS.get(type(primitive))
    if bounds is None:
        everywhere = jnp.full(2, jnp.inf, primitive.dtype)
        return ImageBounds(-everywhere, everywhere)
    reach, nearest, farthest = bounds(primitive, is_central)
    reach = reach + eps(reach.dtype, 8) * (1 + jnp.abs(reach))
    if is_central:
        reach = jnp.where(nearest > 0, reach, jnp.inf)
    reach = jnp.where(farthest > 0, reach, -jnp.inf)
    return ImageBounds(low=-reach[:2], high=reach[2:])


def _discs_reach(
    ends: list[Disc], is_central: bool
) -> tuple[Float[Array, "4"], Array, Array]:
    """Support of the hull of discs to all four sides, smallest and largest depth."""
    n_x, n_y = jnp.array(SIDES, ends[0][2].dtype)
    reaches = []
    for c, a, r in ends:
        if is_central:
            reaches.append(_disc_support(c, a, r, n_x, n_y))
        else:
            across = safe_sqrt(1 - (n_x * a.x + n_y * a.y) ** 2)
            reaches.append(n_x * c.x + n_y * c.y + r * across)
    deep = [(c.z, r * safe_sqrt(1 - a.z * a.z)) for c, a, r in ends]
    return (
        jnp.max(jnp.stack(reaches), axis=0),
        jnp.min(jnp.stack([z - reach for z, reach in deep])),
        jnp.max(jnp.stack([z + reach for z, reach in deep])),
    )


def _disc_support(
    c: Vec3,
    a: Vec3,
    r: Float[Array, ""],
    n_x: Float[Array, "4"],
    n_y: Float[Array, "4"],
) -> Float[Array, "4"]:
    """Largest n.x over the image of a disc, wholly in front of a camera with a center.

    The disc with center c, unit normal a and radius r has the dual conic
    r^2 (I - a a^T) - c c^T: the line n.x = s of the plane z = 1 touches its image where
    (n, -s) makes that form zero, a quadratic in s.

    References:
        Hartley and Zisserman (2004), section 2.2.3, for the dual conic.
    """
    zero, one = jnp.zeros_like(n_x), jnp.ones_like(n_x)
    normal, forward = Vec3(n_x, n_y, zero), Vec3(zero, zero, one)

    def across(v: Vec3, w: Vec3) -> Float[Array, "4"]:
        return v.dot(w) - v.dot(a) * w.dot(a)

    n_n, n_z = across(normal, normal), across(normal, forward)
    z_z = across(forward, forward)
    w = normal * c.z - forward * normal.dot(c)
    # The discriminant of the quadratic, multiplied out: as it stands it cancels where
    # the disc is small for its distance.
    gap = r * r * (across(w, w) - r * r * (n_n * z_z - n_z * n_z))
    height = c.z * c.z - r * r * z_z
    return (normal.dot(c) * c.z - r * r * n_z + safe_sqrt(gap)) / height


def _cylinder_reach(cylinder: Cylinder, is_central: bool):
    a, c = Vec3.from_array(cylinder.axis).unit(), Vec3.from_array(cylinder.center)
    half = a * (cylinder.height / 2)
    ends = [(end, a, cylinder.radius) for end in (c - half, c + half)]
    return _discs_reach(ends, is_central)


def _frustum_reach(frustum: Frustum, is_central: bool):
    p1, p2 = Vec3.from_array(frustum.p1), Vec3.from_array(frustum.p2)
    a = Vec3.from_array(frustum.axis)
    ends = [(p1, a, frustum.radius1), (p2, a, frustum.radius2)]
    return _discs_reach(ends, is_central)


def _sphere_reach(sphere: Sphere, is_central: bool):
    (x, y, z), r = sphere.center, sphere.radius
    n_x, n_y = jnp.array(SIDES, r.dtype)
    reach = n_x * x + n_y * y
    if is_central:
        # The plane through the camera and the line n.x = s is r away from the center:
        # (n.c - s z)^2 = r^2 (1 + s^2).
        square = (z - r) * (z + r)
        root = safe_sqrt(reach * reach + square)
        reach = (reach * z + r * root) / jnp.where(square == 0, 1, square)
    else:
        reach = reach + r
    return reach, z - r, z + r


def _torus_reach(torus: Torus, is_central: bool):
    height = 2 * torus.minor_radius
    radius = torus.major_radius + torus.minor_radius
    return _cylinder_reach(
        Cylinder(torus.center, torus.axis, radius, height), is_central
    )


def _box_reach(box: Box, is_central: bool):
    sign = jnp.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    offset = sign.astype(box.dtype) * (box.size / 2)[None]
    corners = jnp.einsum("ij,nj->ni", box.rotation, offset, precision="highest")
    x, y, z = (corners + box.center[None]).T
    if is_central:
        x, y = x / z, y / z
    reach = jnp.stack([-jnp.min(x), -jnp.min(y), jnp.max(x), jnp.max(y)])
    return reach, jnp.min(z), jnp.max(z)


_BOUNDS: dict[type[AbstractPrimitive], Callable[[Any, bool], Any]] = {
    Box: _box_reach,
    Cylinder: _cylinder_reach,
    Frustum: _frustum_reach,
    Sphere: _sphere_reach,
    Torus: _torus_reach,
}
