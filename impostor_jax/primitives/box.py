"""Box: a cuboid of any proportions, down to a sheet or a rod.

It is where three slabs overlap, one for each pair of faces. A ray spends one interval
in each; it enters the box where it enters the last slab and leaves it where it leaves
the first, and which slab that was tells the face. The derivative follows from the
equation of that face alone (`impostor_jax.primitives.surface`): with a the face's
column of the rotation, c the center and s its size,

    +-a . (p - c) = s / 2

Rounding. The ray starts near the point of the box that is nearest to its origin, which
is never farther than what it meets: the parameters up to there and from there add up
without cancellation. The move, three products and two sums of a . o and the quotient
are charged to o, c and d, 3 eps at most; half the size is charged to s, 0.5 eps;
quotient and sums to t, 1.5 eps. With x_i the 12 numbers of center, size, origin and
direction,

    kappa = sum |x_i dt/dx_i| / t  >= 2

is the condition number of t, and depth errs by at most 4 eps kappa. Hit or miss and the
face are decided wrongly only where a change of the inputs by 8 eps decides otherwise.

Range. That of the plane: any size that is a normal number counts, first derivatives are
0 where |n . d| is at most 3e-10 (1.2e-77 in double precision), second ones where they
are more than a thousandth of the largest number.
"""

__all__ = ["Box"]

from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import zero_from_primal
from jaxtyping import Array, Float, Int
from typing_extensions import override

from impostor_jax.arguments import check_positive, check_rotation, float_arrays
from impostor_jax.compiling import computed_apart
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Hit, Interval, Ray, slab_interval
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.surface import (
    facing,
    hit_tangent,
    within_range,
)

Values = TypeVar("Values")


class Box(AbstractPrimitive):
    """Box in the world frame.

    Args:
        center: (*batch, 3), in meters.
        rotation: `world_from_box`, (*batch, 3, 3): the columns are the directions of
            the edges. Orthogonal with determinant 1 to within 1e-3, taken as it is: an
            optimizer has to turn it, since nine free numbers do not stay a rotation.
        size: Full lengths of the edges in meters, positive, (*batch, 3).

    Derivatives:
        The depth of a pixel is smooth in every field while the same face is seen and
        jumps where the outline or an edge crosses the pixel. That in `rotation` is of
        the nine numbers by themselves: a face turns, and moves, with its own column and
        not with the two others. A step along `rotation @ K` with K antisymmetric is a
        turn of the box.

    Raises:
        ValueError: A concrete value is out of range, or a shape does not fit.
    """

    center: Float[Array, "*batch 3"]
    rotation: Float[Array, "*batch 3 3"]
    size: Float[Array, "*batch 3"]

    def __init__(self, center: Any, rotation: Any, size: Any):
        center, rotation, size = float_arrays(
            center=(center, (3,), "meters"),
            rotation=(rotation, (3, 3), "numbers"),
            size=(size, (3,), "meters"),
        )
        check_rotation("rotation", rotation)
        check_positive("size", size, "meters")
        self.center = center
        self.rotation = rotation
        self.size = size

    @property
    @override
    def batch_shape(self) -> tuple[int, ...]:
        return self.center.shape[:-1]

    @property
    @override
    def dtype(self) -> np.dtype:
        return self.center.dtype

    @override
    def intersect(self, ray: Ray) -> Hit:
        t, face = _first_hit(ray, self)
        return Hit(t=t, on_cap=jnp.zeros(t.shape, bool), part=face)

    @override
    def normal(self, ray: Ray, hit: Hit) -> Vec3:
        n = _of(hit.part, [a.normalize() for a in _axes(self)])
        return facing(n, ray.direction, hit.mask)

    @override
    def implicit(self, point: Vec3) -> Float[Array, "*batch"]:
        q = point - Vec3.from_array(self.center)
        along = Vec3(*(jnp.abs(q.dot(a)) for a in _axes(self)))
        beyond = along - Vec3.from_array(self.size / 2)
        x, y, z = beyond.x, beyond.y, beyond.z
        outside = Vec3(*(jnp.maximum(v, 0) for v in (x, y, z))).norm()
        return outside + jnp.minimum(jnp.maximum(jnp.maximum(x, y), z), 0)

    @override
    def transformed(self, target_from_source: RigidTransform) -> "Box":
        center = target_from_source.apply(self.center)
        edges = target_from_source.rotate(jnp.swapaxes(self.rotation, -1, -2))
        rotation = jnp.swapaxes(edges, -1, -2)
        return eqx.tree_at(lambda b: (b.center, b.rotation), self, (center, rotation))


def _axes(box: Box) -> list[Vec3]:
    """Directions of the edges; none of them need be of unit length."""
    return [Vec3.from_array(box.rotation[..., k]) for k in range(3)]


def _of(face: Int[Array, "*batch"], values: list[Values]) -> Values:
    """Take the first, second or third value: that of the axis a face is across."""
    axis = face // 2
    return jax.tree.map(
        lambda x, y, z: jnp.where(axis == 0, x, jnp.where(axis == 1, y, z)), *values
    )


def _bounds(ray: Ray, box: Box) -> tuple[Float[Array, "*batch"], list[Interval]]:
    """Stretches of the ray in the slabs, less the parameter that comes first."""
    center, axes = Vec3.from_array(box.center), _axes(box)
    halves = [box.size[..., k] / 2 for k in range(3)]
    # The point of the box that is nearest to the ray's origin.
    from_center, nearest = ray.origin - center, center
    for a, half in zip(axes, halves, strict=True):
        nearest = nearest + a * jnp.clip(from_center.dot(a), -half, half)
    near, foot = ray.brought_near(center, nearest, jnp.zeros_like(halves[0]))
    slabs = [slab_interval(near, a, half) for a, half in zip(axes, halves, strict=True)]
    return foot, slabs


@jax.custom_jvp
@jax.jit
def _first_hit(
    ray: Ray, box: Box
) -> tuple[Float[Array, "*batch"], Int[Array, "*batch"]]:
    """Ray parameter of the first hit, `+inf` on a miss, and the face.

    Faces 0 to 5 are the lower and the upper one across the first axis, and so on.
    """

    def trace() -> tuple[Float[Array, "*batch"], Int[Array, "*batch"]]:
        foot, (x, y, z) = _bounds(ray, box)
        lower = jnp.maximum(jnp.maximum(x.lower, y.lower), z.lower)
        upper = jnp.minimum(jnp.minimum(x.upper, y.upper), z.upper)
        enter, leave = foot + lower, foot + upper
        enters = enter > 0
        bounds = [jnp.where(enters, slab.lower, -slab.upper) for slab in (x, y, z)]
        axis = jnp.where(
            bounds[0] >= jnp.maximum(bounds[1], bounds[2]),
            0,
            jnp.where(bounds[1] >= bounds[2], 1, 2),
        )
        # A face that the ray enters looks against it, one that it leaves along it.
        rises = _of(2 * axis, [ray.direction.dot(a) > 0 for a in _axes(box)])
        face = 2 * axis + (rises != enters).astype(axis.dtype)
        is_solid = jnp.min(box.size, axis=-1) > 0
        hit = (lower <= upper) & (leave > 0) & is_solid
        return jnp.where(hit, jnp.where(enters, enter, leave), jnp.inf), face

    return computed_apart(trace, box.size)


@_first_hit.defjvp
@jax.jit
def _first_hit_jvp(primals, tangents):
    (ray, box), (d_ray, d_box) = primals, tangents
    hit, face = _first_hit(ray, box)
    mask = jnp.isfinite(hit)
    t = jnp.where(mask, hit, 0)
    d, a = ray.direction, _of(face, _axes(box))
    q = ray.at(t) - Vec3.from_array(box.center)
    side = jnp.where(face % 2 == 1, 1, -1).astype(t.dtype)
    n, n_d, lean = a * side, d.dot(a) * side, q * -side
    squares = q.dot(q) + t * t * d.dot(d)
    flat = jnp.ones_like(n_d)
    n, n_d, lean, t = within_range((n, n_d, lean, t), squares, flat, n_d)
    d_half = _of(face, [d_box.size[..., k] / 2 for k in range(3)])
    d_point = d_ray.at(t) - Vec3.from_array(d_box.center)
    change = d_half - n.dot(d_point) + lean.dot(_of(face, _axes(d_box)))
    return (hit, face), (hit_tangent(change, n_d, mask), zero_from_primal(face))
