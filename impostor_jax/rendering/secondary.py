"""Rays that start at a surface: mirrored, refracted, and towards lights.

A hit lies off its surface by rounding. A ray that started there would meet its own
surface anew, half of all do, and light would leak or shadow specks appear; moved by a
fixed length, 0.001 say, it would at another scale, or miss what is near. So a ray is
moved along the normal by a bound of the rounding itself,

    2 eps (sum_k |n_k| (|o_k| + |c_k| + 2 |t d_k|) + size)

with the normal n, the ray o + t d that met the surface, and the shape's center c and
size. Products with n make it small where the ray grazes. Of 100 million such rays none
met its own surface (experiments/ray_tracing).
"""

__all__ = ["anchors", "clearance", "mirrored", "refracted"]

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, eps, safe_divide, safe_sqrt
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.solid import Solid
from impostor_jax.rendering.group import Group


def anchors(groups: Sequence[Group]) -> list[Float[Array, "n 4"]]:
    """Centers and sizes of the shapes of each group, by which hits are rounded."""
    return [_anchors(group.primitives) for group in groups]


def _anchors(shapes: AbstractPrimitive) -> Float[Array, "n 4"]:
    shapes = jax.lax.stop_gradient(shapes)
    hull = shapes.hull
    if isinstance(shapes, Solid):
        # A frame turns rays, which spreads their rounding to all directions.
        center, size = shapes.translation, shapes.extent.reach
    elif hull is not None:
        center, size = hull.ball()
    elif isinstance(shapes, Plane):
        center, size = shapes.point, jnp.zeros(shapes.batch_shape, shapes.dtype)
    else:
        # A function's surface has no size of its own: that of the way to it is left.
        center = jnp.zeros((*shapes.batch_shape, 3), shapes.dtype)
        size = center[..., 0]
    return jnp.concatenate([center, size[..., None]], axis=-1)


def clearance(ray: Ray, t: Numbers, n: Vec3, anchor: tuple[Vec3, Numbers]) -> Numbers:
    """Length by which a ray that starts at a hit is moved along the normal.

    Args:
        ray: That met the surface.
        t: Where; finite.
        n: Unit normal.
        anchor: Center and size of the shape.

    Derivatives:
        None.
    """
    ray, t, n, (c, size) = jax.lax.stop_gradient((ray, t, n, anchor))
    o, way = ray.origin, ray.direction * t
    reach = Vec3(*(
        jnp.abs(o_k) + jnp.abs(c_k) + 2 * jnp.abs(way_k)
        for o_k, c_k, way_k in zip(*((v.x, v.y, v.z) for v in (o, c, way)), strict=True)
    ))  # fmt: skip
    across = Vec3(jnp.abs(n.x), jnp.abs(n.y), jnp.abs(n.z))
    return eps(t.dtype, 2) * (across.dot(reach) + size)


def mirrored(direction: Vec3, n: Vec3) -> Vec3:
    """Direction of a ray that a surface with the unit normal n mirrors."""
    return direction - n * (2 * n.dot(direction))


def refracted(
    direction: Vec3, n: Vec3, ratio: Numbers
) -> tuple[Vec3, Numbers, Numbers]:
    """Direction of a ray that a surface lets through, by Snell's law.

    Args:
        direction: Of unit length.
        n: Unit normal, against the direction.
        ratio: Index of refraction on the ray's side, over that behind the surface.

    Returns:
        The unit direction, of no meaning where all is mirrored; the cosine of the angle
        behind the surface, 0 where all is mirrored; and the part of unpolarized light
        that is mirrored, 1 there.

    References:
        Born and Wolf (1999), sections 1.5.1 and 1.5.2, for Snell and Fresnel.
    """
    cos_in = -n.dot(direction)
    cos_out = safe_sqrt(1 - ratio * ratio * (1 - cos_in) * (1 + cos_in))
    bent = direction * ratio + n * (ratio * cos_in - cos_out)
    across = safe_divide(ratio * cos_in - cos_out, ratio * cos_in + cos_out)
    along = safe_divide(cos_in - ratio * cos_out, cos_in + ratio * cos_out)
    return bent, cos_out, (across * across + along * along) / 2
