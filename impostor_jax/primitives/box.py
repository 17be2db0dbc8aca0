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

from typing import Any, ClassVar, NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from impostor_jax.arguments import (
    check_positive,
    check_rotation,
    float_arrays,
    place_of,
)
from impostor_jax.compiling import computed_apart
from impostor_jax.geometry.frames import Points, RigidTransform
from impostor_jax.geometry.hull import DiscHull
from impostor_jax.geometry.rays import Hit, Interval, Ray, slab_interval
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import (
    Numbers,
    first_largest,
    one_of_three,
    safe_divide,
    safe_sqrt,
)
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.stretch import End, Stretch
from impostor_jax.primitives.surface import facing, implicit_hit

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

    measure: ClassVar = "size", 1
    center: Points
    rotation: Float[Array, "*batch 3 3"]
    size: Float[Array, "*batch 3"]

    def __init__(self, center: Any, rotation: Any, size: Any):
        middle, self.rotation, self.size = float_arrays(
            center=(center, (3,), "meters"),
            rotation=(rotation, (3, 3), "numbers"),
            size=(size, (3,), "meters"),
        )
        self.center = place_of(center, middle)
        check_rotation("rotation", self.rotation)
        check_positive("size", self.size, "meters")

    @property
    @override
    def num_parts(self) -> int:
        return 6

    @property
    @override
    def is_bounded(self) -> bool:
        return True

    @property
    @override
    def hull(self) -> DiscHull:
        half = self.size / 2
        center = jnp.asarray(self.center)
        return DiscHull.of_cuboid(-half, half, self.rotation, center)

    @override
    def intersect(self, ray: Ray) -> Hit:
        t, face = implicit_hit(_trace, _equation, ray, self._cuboid())
        return Hit(t=t, on_cap=jnp.zeros(t.shape, bool), part=face)

    @override
    def normal(self, ray: Ray, hit: Hit) -> Vec3:
        n = _of(hit.part, [a.normalize() for a in self._cuboid().axes])
        return facing(n, ray.direction, hit.mask)

    @override
    def stretches(self, ray: Ray) -> tuple[Stretch]:
        cuboid = self._cuboid()
        foot, slabs = _slabs(ray, cuboid)

        def end(t: Numbers, enters: bool) -> End:
            face = _face(slabs, ray, cuboid, jnp.full(t.shape, enters))
            slope = jnp.abs(_of(face, [ray.direction.dot(a) for a in cuboid.axes]))
            return End(foot + t, face, jnp.zeros(t.shape, bool), slope)

        x, y, z = slabs
        solid = x.overlap(y).overlap(z)
        stretch = Stretch(end(solid.lower, True), end(solid.upper, False))
        is_solid = jnp.broadcast_to(_is_solid(cuboid), foot.shape)
        return (stretch.where(stretch.crosses & is_solid),)

    @override
    def implicit(self, point: Vec3) -> Float[Array, "*batch"]:
        center, axes, _ = self._cuboid()
        along = Vec3(*(jnp.abs((point - center).dot(a)) for a in axes))
        beyond = along - Vec3.from_array(self.size / 2)
        x, y, z = beyond.x, beyond.y, beyond.z
        outside = Vec3(*(jnp.maximum(v, 0) for v in (x, y, z))).norm()
        return outside + jnp.minimum(jnp.maximum(jnp.maximum(x, y), z), 0)

    @override
    def outline_gap(self, ray: Ray) -> Numbers:
        o, d, halves = self._seen_from_within(ray)
        gap = jnp.asarray(jnp.inf, d[0].dtype)
        for i, j in ((0, 1), (1, 2), (2, 0)):
            # Along the third axis the box is a rectangle, and the ray a line.
            reach = halves[i] * jnp.abs(d[j]) + halves[j] * jnp.abs(d[i])
            length = safe_sqrt(d[i] * d[i] + d[j] * d[j])
            inside = safe_divide(reach - jnp.abs(o[i] * d[j] - o[j] * d[i]), length)
            gap = jnp.minimum(gap, jnp.where(length > 0, inside, jnp.inf))
        return gap

    @override
    def crease_gap(
        self, ray: Ray, part: Int[Array, "..."], other: Int[Array, "..."]
    ) -> Numbers:
        o, d, halves = self._seen_from_within(ray)

        def across(face: Int[Array, "..."]) -> tuple[Numbers, Numbers]:
            side = jnp.where(face % 2 == 1, 1, -1).astype(d[0].dtype)
            return _of(face, o) - side * _of(face, halves), _of(face, d)

        (o_i, d_i), (o_j, d_j) = across(part), across(other)
        gap = safe_divide(o_i * d_j - o_j * d_i, safe_sqrt(d_i * d_i + d_j * d_j))
        # Two faces across one axis have no edge.
        return jnp.where(part // 2 == other // 2, 1, gap)

    @override
    def transformed(self, target_from_source: RigidTransform) -> "Box":
        center = target_from_source.apply(self.center)
        edges = target_from_source.rotate(jnp.swapaxes(self.rotation, -1, -2))
        rotation = jnp.swapaxes(edges, -1, -2)
        return eqx.tree_at(lambda b: (b.center, b.rotation), self, (center, rotation))

    def _seen_from_within(
        self, ray: Ray
    ) -> tuple[list[Numbers], list[Numbers], list[Float[Array, "*#batch"]]]:
        """A point of the ray and its direction along the edges, and half of these."""
        center, axes, halves = self._cuboid()
        near, _ = ray.brought_near(center, center, jnp.zeros_like(halves[0]))
        o, d = ([v.dot(a) for a in axes] for v in (near.origin, near.direction))
        return o, d, halves

    def _cuboid(self) -> "_Cuboid":
        axes = [Vec3.from_array(self.rotation[..., k]) for k in range(3)]
        halves = [self.size[..., k] / 2 for k in range(3)]
        return _Cuboid(Vec3.from_array(self.center), axes, halves)


class _Cuboid(NamedTuple):
    """The fields as the formulas take them.

    Attributes:
        center: The box's.
        axes: Directions of the edges; none of them need be of unit length.
        halves: Half of their lengths.
    """

    center: Vec3
    axes: list[Vec3]
    halves: list[Float[Array, "*#batch"]]


def _of(face: Int[Array, "*batch"], values: list[Values]) -> Values:
    """Take the first, second or third value: that of the axis a face is across."""
    return one_of_three(face // 2, values)


def _slabs(ray: Ray, cuboid: _Cuboid) -> tuple[Float[Array, "*batch"], list[Interval]]:
    """Stretches of the ray in the slabs, less the parameter that comes first."""
    center, axes, halves = cuboid
    # The point of the box that is nearest to the ray's origin.
    from_center, nearest = ray.origin - center, center
    for a, half in zip(axes, halves, strict=True):
        nearest = nearest + a * jnp.clip(from_center.dot(a), -half, half)
    near, foot = ray.brought_near(center, nearest, jnp.zeros_like(halves[0]))
    slabs = [slab_interval(near, a, half) for a, half in zip(axes, halves, strict=True)]
    return foot, slabs


def _face(
    slabs: list[Interval], ray: Ray, cuboid: _Cuboid, enters: Bool[Array, "*batch"]
) -> Int[Array, "*batch"]:
    """Face through which a ray enters the box, or leaves it."""
    axis = first_largest([jnp.where(enters, s.lower, -s.upper) for s in slabs])
    # A face that the ray enters looks against it, one that it leaves along it.
    rises = one_of_three(axis, [ray.direction.dot(a) > 0 for a in cuboid.axes])
    return 2 * axis + (rises != enters).astype(axis.dtype)


def _is_solid(cuboid: _Cuboid) -> Bool[Array, "*#batch"]:
    """Whether it has a size; what is traced may have none."""
    first, second, third = cuboid.halves
    return jnp.minimum(jnp.minimum(first, second), third) > 0


def _trace(
    ray: Ray, cuboid: _Cuboid
) -> tuple[Float[Array, "*batch"], Int[Array, "*batch"]]:
    """Ray parameter of the first hit, `+inf` on a miss, and the face.

    Faces 0 to 5 are the lower and the upper one across the first axis, and so on.
    """

    def trace() -> tuple[Float[Array, "*batch"], Int[Array, "*batch"]]:
        foot, (x, y, z) = _slabs(ray, cuboid)
        solid = x.overlap(y).overlap(z)
        enter, leave = foot + solid.lower, foot + solid.upper
        enters = enter > 0
        face = _face([x, y, z], ray, cuboid, enters)
        hit = (solid.lower <= solid.upper) & (leave > 0) & _is_solid(cuboid)
        return jnp.where(hit, jnp.where(enters, enter, leave), jnp.inf), face

    return computed_apart(trace, cuboid.halves[0])


def _equation(
    point: Vec3, face: Int[Array, "*batch"], cuboid: _Cuboid
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Of the plane of a face."""
    side = jnp.where(face % 2 == 1, 1, -1).astype(point.x.dtype)
    beyond = (point - cuboid.center).dot(_of(face, cuboid.axes)) * side
    return beyond - _of(face, cuboid.halves), jnp.ones_like(beyond)
