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

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float
from typing_extensions import override

from impostor_jax.arguments import check_direction, float_arrays, place_of
from impostor_jax.geometry.frames import Points, RigidTransform
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3, unit
from impostor_jax.numerics import Numbers, safe_normalize, smallest_slope
from impostor_jax.primitives.base import AbstractOnePiece
from impostor_jax.primitives.stretch import End, Stretch
from impostor_jax.primitives.surface import facing, implicit_hit

_Point = tuple[Vec3, Vec3]
"""A point, and the unit normal."""


class Plane(AbstractOnePiece):
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

    measure: ClassVar = "unit_normal", 1
    point: Points
    unit_normal: Float[Array, "*batch 3"]

    def __init__(self, point: Any, normal: Any):
        place, normal = float_arrays(
            point=(point, (3,), "meters"), normal=(normal, (3,), "numbers")
        )
        self.point = place_of(point, place)
        check_direction("normal", normal)
        self.unit_normal = safe_normalize(normal)

    @property
    @override
    def is_bounded(self) -> bool:
        return False

    @property
    @override
    def hull(self) -> None:
        return None

    @override
    def intersect(self, ray: Ray) -> Hit:
        t, _ = implicit_hit(_trace, _equation, ray, self._point_and_normal())
        return Hit.on_one_piece(t)

    @override
    def normal(self, ray: Ray, hit: Hit) -> Vec3:
        return facing(Vec3.from_array(self.unit_normal).unit(), ray.direction, hit.mask)

    @override
    def stretches(self, ray: Ray) -> tuple[Stretch]:
        point, n = self._point_and_normal()
        height, n_d = n.dot(point - ray.origin), n.dot(ray.direction)
        meets = jnp.abs(n_d) > smallest_slope(n_d.dtype)
        t = height / jnp.where(meets, n_d, 1)
        is_behind = ~meets & (height >= 0)
        enter = jnp.where(meets & (n_d < 0), t, -jnp.inf)
        leave = jnp.where(meets & (n_d > 0), t, jnp.inf)
        piece = jnp.zeros(t.shape, int), jnp.zeros(t.shape, bool), jnp.abs(n_d)
        stretch = Stretch(End(enter, *piece), End(leave, *piece))
        return (stretch.where(meets | is_behind),)

    @override
    def implicit(self, point: Vec3) -> Float[Array, "*batch"]:
        return _equation(point, None, self._point_and_normal())[0]

    @override
    def outline_gap(self, ray: Ray) -> Numbers:
        point, n = self._point_and_normal()
        ahead = jnp.sign(n.dot(point - ray.origin))
        return ahead * n.dot(ray.direction) / ray.direction.norm()

    @override
    def transformed(self, target_from_source: RigidTransform) -> "Plane":
        point = target_from_source.apply(self.point)
        normal = target_from_source.rotate(unit(self.unit_normal))
        return eqx.tree_at(lambda p: (p.point, p.unit_normal), self, (point, normal))

    def _point_and_normal(self) -> _Point:
        n = Vec3.from_array(self.unit_normal).unit()
        return Vec3.from_array(self.point), n


def _trace(ray: Ray, plane: _Point) -> tuple[Float[Array, "*batch"], None]:
    """Ray parameter of the hit, `+inf` on a miss."""
    point, n = plane
    height = n.dot(point - ray.origin)
    n_d = n.dot(ray.direction)
    meets = jnp.abs(n_d) > smallest_slope(n_d.dtype)
    t = height / jnp.where(meets, n_d, 1)
    return jnp.where(meets & (t > 0), t, jnp.inf), None


def _equation(
    p: Vec3, _: None, plane: _Point
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    point, n = plane
    height = n.dot(p - point)
    return height, jnp.ones_like(height)
