"""Perspective outline of a capped cylinder and of a sphere in closed form.

The cylinder is the convex hull of its two end discs, and a camera in front of it keeps
convex hulls, so the outline is the hull of the images of the two discs. A disc with
center c, unit axis a and radius r has the dual conic r^2 (I - a a^T) - c c^T: the line
n.x = s of the plane z = 1 touches its image where (n, -s) makes that form zero. That is
a quadratic in s, so the support function of each disc is explicit, and that of the
cylinder is the larger of the two. A plane touches a sphere where its distance from the
center is the radius, a quadratic again.

All this holds while the shape lies wholly in front of the camera's plane z = 0. The
curve of `outline_curve` knows no such limit.
"""

__all__ = [
    "bounding_box",
    "disc_support",
    "discs",
    "in_front",
    "outline_points",
    "sphere_box",
    "sphere_support",
    "support",
]

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from impostor_jax.geometry.vec3 import Vec3, unit
from impostor_jax.numerics import safe_divide, safe_sqrt
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.sphere import Sphere


def discs(cylinder: Cylinder) -> tuple[Vec3, Vec3]:
    """Centers of the two caps."""
    offset = unit(cylinder.axis) * (cylinder.height / 2)
    return (
        Vec3.from_array(cylinder.center - offset),
        Vec3.from_array(cylinder.center + offset),
    )


def in_front(cylinder: Cylinder) -> Bool[Array, ""]:
    """Whether every point of a cylinder, in the camera frame, has positive depth."""
    reach = cylinder.radius * safe_sqrt(1 - unit(cylinder.axis)[2] ** 2)
    below, above = discs(cylinder)
    return jnp.minimum(below.z, above.z) > reach


def support(
    cylinder: Cylinder, n_x: Float[Array, "*batch"], n_y: Float[Array, "*batch"]
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Support function of the outline: the largest n.x over its points x.

    Args:
        cylinder: In the camera frame, wholly in front of the camera.
        n_x: First component of the unit normal of a line in the plane z = 1.
        n_y: Second component.

    Returns:
        The support, and the point (x, y) of the outline where the line touches it.

    References:
        Hartley and Zisserman (2004), section 2.2.3, for the dual conic.
    """
    a, r = Vec3.from_array(cylinder.axis).unit(), cylinder.radius
    (s0, x0, y0), (s1, x1, y1) = (
        disc_support(c, a, r, n_x, n_y) for c in discs(cylinder)
    )
    second = s1 > s0
    return (
        jnp.where(second, s1, s0),
        jnp.where(second, x1, x0),
        jnp.where(second, y1, y0),
    )


def disc_support(
    c: Vec3,
    a: Vec3,
    r: Float[Array, ""],
    n_x: Float[Array, "*batch"],
    n_y: Float[Array, "*batch"],
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Support function of the image of a disc, and the point where the line touches.

    Args:
        c: Center of the disc, in the camera frame, wholly in front of the camera.
        a: Its unit normal.
        r: Its radius.
        n_x: First component of the unit normal of a line in the plane z = 1.
        n_y: Second component.
    """
    zero, one = jnp.zeros_like(n_x), jnp.ones_like(n_x)
    normal, forward = Vec3(n_x, n_y, zero), Vec3(zero, zero, one)

    def across(v: Vec3, w: Vec3) -> Float[Array, "*batch"]:
        return v.dot(w) - v.dot(a) * w.dot(a)

    n_n, n_z = across(normal, normal), across(normal, forward)
    z_z = across(forward, forward)
    w = normal * c.z - forward * normal.dot(c)
    # The discriminant b^2 - a c of the quadratic below, multiplied out: as it stands it
    # cancels where the disc is small for its distance.
    gap = r * r * (across(w, w) - r * r * (n_n * z_z - n_z * n_z))
    height = c.z * c.z - r * r * z_z
    s = (normal.dot(c) * c.z - r * r * n_z + safe_sqrt(gap)) / height
    # The line (n, -s) touches the conic at the point C (n, -s).
    line = normal - forward * s
    pole_x = r * r * (line.x - a.x * line.dot(a)) - c.x * line.dot(c)
    pole_y = r * r * (line.y - a.y * line.dot(a)) - c.y * line.dot(c)
    pole_z = r * r * (line.z - a.z * line.dot(a)) - c.z * line.dot(c)
    return s, safe_divide(pole_x, pole_z), safe_divide(pole_y, pole_z)


def outline_points(cylinder: Cylinder, count: int = 360) -> Float[Array, "{count} 2"]:
    """Points of the outline in order, as a closed polygon of the plane z = 1.

    Args:
        cylinder: In the camera frame, wholly in front of the camera.
        count: Number of directions whose touching points are taken; the two straight
            edges lie between neighbors.
    """
    angle = jnp.arange(count, dtype=cylinder.radius.dtype) * (2 * jnp.pi / count)
    _, x, y = support(cylinder, jnp.cos(angle), jnp.sin(angle))
    return jnp.stack([x, y], axis=-1)


@jax.jit
def bounding_box(cylinder: Cylinder) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
    """Smallest and largest (x, y) of the outline in the plane z = 1.

    Args:
        cylinder: In the camera frame. The box is the whole plane where it is not wholly
            in front of the camera.
    """
    dtype = cylinder.radius.dtype
    n_x = jnp.array([-1, 0, 1, 0], dtype)
    n_y = jnp.array([0, -1, 0, 1], dtype)
    reach, _, _ = support(cylinder, n_x, n_y)
    reach = jnp.where(in_front(cylinder), reach, jnp.inf)
    return -reach[:2], reach[2:]


def sphere_support(
    sphere: Sphere, n_x: Float[Array, "*batch"], n_y: Float[Array, "*batch"]
) -> Float[Array, "*batch"]:
    """Support function of the image of a sphere: the largest n.x over its points x.

    Args:
        sphere: In the camera frame, wholly in front of the camera.
        n_x: First component of the unit normal of a line in the plane z = 1.
        n_y: Second component.
    """
    (x, y, z), r = sphere.center, sphere.radius
    n_c = n_x * x + n_y * y
    # The plane through the camera and the line n.x = s is r away from the center:
    # (n.c - s z)^2 = r^2 (1 + s^2).
    square = (z - r) * (z + r)
    root = safe_sqrt(n_c * n_c + square)
    return (n_c * z + r * root) / jnp.where(square == 0, 1, square)


@jax.jit
def sphere_box(sphere: Sphere) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
    """Smallest and largest (x, y) of a sphere's outline; as `bounding_box`."""
    dtype = sphere.radius.dtype
    n_x = jnp.array([-1, 0, 1, 0], dtype)
    n_y = jnp.array([0, -1, 0, 1], dtype)
    reach = sphere_support(sphere, n_x, n_y)
    reach = jnp.where(sphere.center[2] > sphere.radius, reach, jnp.inf)
    return -reach[:2], reach[2:]
