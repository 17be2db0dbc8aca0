"""Sphere.

The ray's stretch in the ball, and of its two ends the first in front of the origin. As
for the cylinder the derivative follows from the equation of the surface alone
(`impostor_jax.primitives.surface`).

Rounding. No two large numbers are subtracted (`ball_interval`) and no ray is moved
farther than what it meets (`Ray.brought_near`), so that depth errs by at most 8 eps
times its condition number sum |x_i dt/dx_i| / t over center, radius, origin and
direction. A hit is wrongly told from a miss only where a change of these by 8 eps
decides otherwise.

Range. That of the cylinder: a radius counts where its square is a normal number, first
derivatives are 0 where |n . d| is at most 3e-10 (1.2e-77 in double precision).
"""

__all__ = ["Sphere"]

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.arguments import check_positive, float_arrays, place_of
from impostor_jax.compiling import computed_apart
from impostor_jax.geometry.frames import Points, RigidTransform
from impostor_jax.geometry.hull import BallHull
from impostor_jax.geometry.rays import Hit, Ray, ball_interval
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, has_square
from impostor_jax.primitives.base import AbstractOnePiece
from impostor_jax.primitives.stretch import End, Stretch
from impostor_jax.primitives.surface import facing, implicit_hit

_Ball = tuple[Vec3, Float[Array, "*#batch"]]
"""Center and radius."""


class Sphere(AbstractOnePiece):
    """Sphere in the world frame.

    Args:
        center: (*batch, 3), in meters.
        radius: In meters, positive, (*batch,).

    Derivatives:
        The depth of a pixel is smooth in both fields and jumps where the outline
        crosses the pixel. It grows without bound as a ray grazes; on a ray that grazes
        to rounding it is 0.

    Raises:
        ValueError: A concrete value is out of range, or a shape does not fit.
    """

    measure: ClassVar = "radius", 0
    center: Points
    radius: Float[Array, "*batch"]

    def __init__(self, center: Any, radius: Any):
        middle, self.radius = float_arrays(
            center=(center, (3,), "meters"), radius=(radius, (), "meters")
        )
        self.center = place_of(center, middle)
        check_positive("radius", self.radius, "meters")

    @property
    @override
    def is_bounded(self) -> bool:
        return True

    @property
    @override
    def hull(self) -> BallHull:
        return BallHull(jnp.asarray(self.center), self.radius)

    @override
    def intersect(self, ray: Ray) -> Hit:
        center = Vec3.from_array(self.center)
        t, _ = implicit_hit(_trace, _equation, ray, (center, self.radius))
        return Hit.on_one_piece(t)

    @override
    def normal(self, ray: Ray, hit: Hit) -> Vec3:
        mask = hit.mask
        q = ray.at(jnp.where(mask, hit.t, 0)) - Vec3.from_array(self.center)
        n = q.normalize()
        return facing(n, ray.direction, mask)

    @override
    def stretches(self, ray: Ray) -> tuple[Stretch]:
        center, r = Vec3.from_array(self.center), self.radius
        near, foot = ray.brought_near(center, center, r)
        ball, d = ball_interval(near, r), ray.direction
        half = jnp.where(ball.lower <= ball.upper, (ball.upper - ball.lower) / 2, 0)
        enter, leave = foot + ball.lower, foot + ball.upper
        piece = jnp.zeros(enter.shape, int), jnp.zeros(enter.shape, bool)
        slope = d.dot(d) * half / r
        stretch = Stretch(End(enter, *piece, slope), End(leave, *piece, slope))
        return (stretch.where(jnp.broadcast_to(has_square(r), enter.shape)),)

    @override
    def implicit(self, point: Vec3) -> Float[Array, "*batch"]:
        return (point - Vec3.from_array(self.center)).norm() - self.radius

    @override
    def outline_gap(self, ray: Ray) -> Numbers:
        center = Vec3.from_array(self.center)
        near, _ = ray.brought_near(center, center, self.radius)
        d = near.direction
        # The norm of a vector product errs by its own rounding alone.
        return self.radius - near.origin.cross(d).norm() / d.norm()

    @override
    def transformed(self, target_from_source: RigidTransform) -> "Sphere":
        center = target_from_source.apply(self.center)
        return eqx.tree_at(lambda s: s.center, self, center)


def _trace(ray: Ray, ball: _Ball) -> tuple[Numbers, Bool[Array, "*batch"]]:
    """Ray parameter of the first hit, `+inf` on a miss, and whether there is one."""
    center, r = ball

    def trace() -> Numbers:
        near, foot = ray.brought_near(center, center, r)
        stretch = ball_interval(near, r)
        enter, leave = foot + stretch.lower, foot + stretch.upper
        hit = (enter <= leave) & (leave > 0) & has_square(r)
        return jnp.where(hit, jnp.where(enter > 0, enter, leave), jnp.inf)

    t = computed_apart(trace, r)
    return t, jnp.isfinite(t)


def _equation(
    point: Vec3, is_hit: Bool[Array, "*batch"], ball: _Ball
) -> tuple[Numbers, Float[Array, "*#batch"]]:
    center, r = ball
    # Counted in radii, so that no power of a small one is lost. A miss has no q.
    held = jax.lax.stop_gradient(r)
    q = (point - center) * jnp.where(is_hit, 1 / held, 0)
    return q.norm() * held - r, r
