"""Endless plane, such as a table, a wall or a floor.

The ray crosses it at t = n.(p - o) / n.d, once or never. The derivative follows from
the equation of the plane (`impostor_jax.primitives.surface`).

Rounding. That of p - o, of the three products and of the two sums of n.(p - o) is
charged to p and o, that of n.d to d and that of the quotient to t: 2, 1.5 and 0.5 eps
at most. With x_i the 9 numbers of point, origin and direction,

    kappa = sum |x_i dt/dx_i| / t  >= 2

is the condition number of t, and depth errs by at most 2 eps kappa. The length and the
rounding of n do not count. Whether the plane is ahead is decided wrongly only where a
change of the inputs by 8 eps decides otherwise.

Range. A ray with |n . d| at most 3e-10 (1.2e-77 in double precision), far below its
rounding, is parallel and misses. Second derivatives grow as the lengths squared over
(n . d)^3, and are 0 where that is more than a thousandth of the largest number.
"""

__all__ = ["Plane"]

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from impostor_jax.arguments import check_direction, float_arrays
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3, unit
from impostor_jax.numerics import safe_normalize, smallest_slope
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.surface import facing, hit_tangent, within_range


class Plane(AbstractPrimitive):
    """Endless plane in the world frame, seen from either side.

    A ray parallel to it or moving away from it misses. The signed distance is positive
    on the side that the normal points to.

    Args:
        point: Any point of the plane, (*batch, 3), in meters.
        normal: (*batch, 3); any nonzero length, kept as a unit vector. One that an
            optimizer has changed since counts as its direction.

    Derivatives:
        The depth of a pixel is smooth in both fields and jumps where the horizon
        crosses the pixel, towards which it grows without bound. Moving the point within
        the plane changes nothing.

    Raises:
        ValueError: A concrete value is out of range, or a shape does not fit.
    """

    point: Float[Array, "*batch 3"]
    unit_normal: Float[Array, "*batch 3"]

    def __init__(self, point: Any, normal: Any):
        point, normal = float_arrays(
            point=(point, (3,), "meters"), normal=(normal, (3,), "numbers")
        )
        check_direction("normal", normal)
        self.point = point
        self.unit_normal = safe_normalize(normal)

    @property
    @override
    def batch_shape(self) -> tuple[int, ...]:
        return self.point.shape[:-1]

    @property
    @override
    def dtype(self) -> np.dtype:
        return self.point.dtype

    @override
    def intersect(self, ray: Ray) -> Hit:
        t = _first_hit(ray, self)
        return Hit.on_one_piece(t)

    @override
    def normal(self, ray: Ray, hit: Hit) -> Vec3:
        return facing(Vec3.from_array(self.unit_normal).unit(), ray.direction, hit.mask)

    @override
    def implicit(self, point: Vec3) -> Float[Array, "*batch"]:
        n = Vec3.from_array(self.unit_normal).unit()
        return (point - Vec3.from_array(self.point)).dot(n)

    @override
    def transformed(self, target_from_source: RigidTransform) -> "Plane":
        point = target_from_source.apply(self.point)
        normal = target_from_source.rotate(unit(self.unit_normal))
        return eqx.tree_at(lambda p: (p.point, p.unit_normal), self, (point, normal))


@jax.custom_jvp
def _first_hit(ray: Ray, plane: Plane) -> Float[Array, "*batch"]:
    """Ray parameter of the hit, `+inf` on a miss."""
    n = Vec3.from_array(plane.unit_normal).unit()
    height = n.dot(Vec3.from_array(plane.point) - ray.origin)
    n_d = n.dot(ray.direction)
    meets = jnp.abs(n_d) > smallest_slope(n_d.dtype)
    t = height / jnp.where(meets, n_d, 1)
    return jnp.where(meets & (t > 0), t, jnp.inf)


@_first_hit.defjvp
def _first_hit_jvp(primals, tangents):
    (ray, plane), (d_ray, d_plane) = primals, tangents
    hit = _first_hit(ray, plane)
    mask = jnp.isfinite(hit)
    t = jnp.where(mask, hit, 0)
    n, d_normal = (Vec3.from_array(p.unit_normal) for p in (plane, d_plane))
    n, d_normal = jax.jvp(Vec3.unit, (n,), (d_normal,))
    d = ray.direction
    q = ray.at(t) - Vec3.from_array(plane.point)
    n_d = n.dot(d)
    squares = q.dot(q) + t * t * d.dot(d)
    n, n_d, q, t = within_range((n, n_d, q, t), squares, jnp.ones_like(n_d), n_d)
    d_point = d_ray.at(t) - Vec3.from_array(d_plane.point)
    change = -n.dot(d_point) - q.dot(d_normal)
    return hit, hit_tangent(change, n_d, mask)
