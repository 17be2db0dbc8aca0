"""Solids made of solids: unions, intersections and differences, nested freely.

Each shape that a solid is made of is crossed by a ray at the ends of its stretches in
it. One of these ends is a surface of the solid where the expression, asked of the
places just before it and just after it, changes. So nothing is sorted, and a ray costs
the same whatever it meets: for k ends, 2 k times k comparisons.

*Just* is the rounding of the end: K eps of the lengths that it is made of, over the
slope at which the ray crosses the surface there. So faces that lie flush, as those of a
bore that is cut exactly to the end of a can, are one face, whichever of them rounding
puts first: without it 8 % of the rays through such scenes are wrong. What is thinner
than that, in space, is not seen.

Rounding. All shapes are met by one ray, which starts near the solid in a frame of its
own: that of the shapes as they were given, which the solid's pose moves as one. So
flush faces stay flush at any distance: the rounding of a ray from 1000 lengths away
moves what it meets, and not one face against another. A depth errs as that of the shape
that is seen, and by the rounding of the pose.

Derivatives. Of the shape that is seen alone. That is cast at anew, by a ray that starts
between the end that is seen and the one before, so that it meets the one wanted first:
its own derivative is the solid's.

References:
    Roth (1982), Ray casting for modeling solids, for the stretches.
"""

__all__ = ["Expression", "Solid", "difference", "intersection", "union"]

import functools
import operator
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import zero_from_primal
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from impostor_jax.arguments import is_concrete, is_exact
from impostor_jax.compiling import computed_once
from impostor_jax.geometry.frames import Points, RigidTransform
from impostor_jax.geometry.hull import AbstractHull
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers
from impostor_jax.primitives.base import AbstractPrimitive, check_shapes, combines
from impostor_jax.primitives.expression import (
    Ball,
    Expression,
    ball_of,
    counted_from,
    evaluated,
    hull_of,
    is_bounded,
    is_endless_function,
    reach_of,
)
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.solid_search import Search, alike, chosen, first_change
from impostor_jax.primitives.stretch import Stretch
from impostor_jax.primitives.surface import facing


class Extent(NamedTuple):
    """Where the shapes of a solid are, in the shapes' frame.

    Attributes:
        ball: Near which rays begin: around all that is there, or else around where the
            shapes are; None where nobody knows.
        reach: How far the shapes reach from the origin.
    """

    ball: Ball | None
    reach: Numbers


class Solid(AbstractPrimitive):
    """A solid made of others, as `union`, `intersection` and `difference` return it.

    Attributes:
        shapes: What it is made of, in a frame of their own.
        expression: How.
        rotation: `world_from_shapes`, (*batch, 3, 3); of what was just made of shapes
            in the world, the identity.
        translation: (*batch, 3), in meters.

    Derivatives:
        The depth of a pixel is smooth in every field of the shape that it sees, and
        does not depend on any other; it jumps where another surface takes its place.
        Like that of a `Scene` it can be made from shapes while they are traced.
    """

    measure: ClassVar = "rotation", 2
    shapes: tuple[AbstractPrimitive, ...]
    expression: Expression = eqx.field(static=True)
    rotation: Float[Array, "*batch 3 3"]
    translation: Points

    @property
    @override
    def num_parts(self) -> int:
        """The parts of all shapes, one after the other."""
        return sum(shape.num_parts for shape in self.shapes)

    @property
    def first_parts(self) -> tuple[int, ...]:
        """Number of the first part of each shape, as `Hit.part` counts."""
        counts = np.cumsum([0, *(shape.num_parts for shape in self.shapes)])
        return tuple(int(count) for count in counts[:-1])

    @property
    @override
    def is_bounded(self) -> bool:
        return is_bounded(self.expression, self.shapes)

    @property
    @override
    def hull(self) -> AbstractHull | None:
        hull = hull_of(self.expression, self.shapes)
        return (
            None
            if hull is None
            else hull.moved(self.rotation, jnp.asarray(self.translation))
        )

    @override
    def intersect(self, ray: Ray) -> Hit:
        t, code = _first_hit(ray, self)
        return Hit(t=t, on_cap=code % 2 == 1, part=code // 2)

    @override
    def normal(self, ray: Ray, hit: Hit) -> Vec3:
        mask = hit.mask
        near, foot, _ = self._near(ray)
        t = jnp.where(mask, hit.t, 0) - foot
        zero = jnp.zeros_like(t)
        n = Vec3(zero, zero, zero)
        for shape, mine, part in self._seen(hit.part, mask):
            own = Hit(jnp.where(mine, t, jnp.inf), hit.on_cap, part)
            of_type = computed_once(
                lambda shape=shape, own=own: shape.normal(near, own).planes()
            )
            n = Vec3(*of_type).where(mine, n)
        x, y, z = self._edges()
        # A surface that is taken away is seen from within the shape: it faces the ray
        # like any other.
        return facing(x * n.x + y * n.y + z * n.z, ray.direction, mask)

    @override
    def stretches(self, ray: Ray) -> None:
        return None

    @override
    def implicit(self, point: Vec3) -> Float[Array, "*batch"]:
        """Signed distance from the surface, or less: by the least and the greatest.

        0 on the surface, negative inside, and never more than the true distance.
        """
        q = point - Vec3.from_array(self.translation)
        own = Vec3(*(q.dot(edge) for edge in self._edges()))
        return evaluated(
            self.expression,
            [shape.implicit(own) for shape in self.shapes],
            {"union": jnp.minimum, "intersection": jnp.maximum},
            operator.neg,
        )

    @override
    def outline_gap(self, ray: Ray) -> None:
        return None

    @override
    def crease_gap(
        self, ray: Ray, part: Int[Array, "..."], other: Int[Array, "..."]
    ) -> None:
        return None

    @override
    def transformed(self, target_from_source: RigidTransform) -> "Solid":
        # The shapes stay where they are to each other, to the last digit.
        columns = target_from_source.rotate(jnp.swapaxes(self.rotation, -1, -2))
        pose = jnp.swapaxes(columns, -1, -2), target_from_source.apply(self.translation)
        return eqx.tree_at(lambda s: (s.rotation, s.translation), self, pose)

    def _edges(self) -> tuple[Vec3, Vec3, Vec3]:
        """Directions of the shapes' axes in the world."""
        x, y, z = (Vec3.from_array(self.rotation[..., k]) for k in range(3))
        return x, y, z

    def _near(self, ray: Ray) -> tuple[Ray, Numbers, "Extent"]:
        """The ray in the shapes' frame, from near them; its start; their extent."""
        edges, extent = self._edges(), self.extent
        place, d = Vec3.from_array(self.translation), ray.direction
        if extent.ball is None:
            near, foot = Ray(ray.origin - place, d), jnp.zeros_like(d.x)
        else:
            center, radius = extent.ball
            x, y, z = (v * center[..., k] for k, v in enumerate(edges))
            near, foot = ray.brought_near(place, place + x + y + z, radius)
        # Turned after that: a product with the way from afar would round it aside.
        turned = (Vec3(*(v.dot(edge) for edge in edges)) for v in (near.origin, d))
        return Ray(*turned), foot, extent

    @property
    def extent(self) -> "Extent":
        """Where the shapes are, in their own frame; without a derivative."""
        shapes = jax.lax.stop_gradient(self.shapes)

        def extent() -> Extent:
            # All count, also what is taken away: where it is large or far off, so is
            # the rounding of the hole that it leaves.
            reach = functools.reduce(jnp.maximum, map(reach_of, shapes))
            ball = _ball_near(self.expression, shapes)
            return Extent(ball, jnp.broadcast_to(reach, self.batch_shape))

        return computed_once(extent)

    def _seen(
        self, part: Int[Array, "*batch"], mask: Bool[Array, "*batch"]
    ) -> Iterator[
        tuple[AbstractPrimitive, Bool[Array, "*batch"], Int[Array, "*batch"]]
    ]:
        """Of each type: the shapes ray by ray, where they are seen, and which part."""
        number = jnp.zeros(part.shape, jnp.int32)
        begin = jnp.zeros_like(part)
        for k, first in enumerate(self.first_parts):
            number = jnp.where(part >= first, k, number)
            begin = jnp.where(part >= first, first, begin)
        for numbers in alike(self.shapes):
            is_any = [number == k for k in numbers]
            mine = mask & functools.reduce(operator.or_, is_any)
            shape = chosen(self.shapes, numbers, number)
            yield shape, mine, jnp.where(mine, part - begin, 0)


def union(*shapes: Any) -> Solid:
    """What is in any of some solids; also written `a | b`.

    Args:
        shapes: Closed ones: cylinders, frusta and their sectors, spheres, boxes, tori,
            and solids. A plane counts as the half-space that its normal points away
            from, a heightfield as the ground below it, without end, over its extent.
            Single ones, or batches (n,) of one size.

    Raises:
        ValueError: One is open or no primitive, or batches have several sizes.
    """
    return _combined("union", shapes)


def intersection(*shapes: Any) -> Solid:
    """What is in all of some solids; also written `a & b`.

    Args:
        shapes: As of `union`.

    Raises:
        ValueError: As of `union`.
    """
    return _combined("intersection", shapes)


def difference(shape: Any, *others: Any) -> Solid:
    """What is in a solid and in none of some others; also written `a - b`.

    Args:
        shape: As those of `union`.
        others: What is taken away.

    Raises:
        ValueError: As of `union`.
    """
    return _combined("difference", (shape, *others))


@combines
def _combined(name: str, shapes: Sequence[Any]) -> Solid:
    check_shapes(shapes)
    if not shapes:
        raise ValueError(f"shapes must be one or more to make a {name}, got none")
    batches = {shape.batch_shape for shape in shapes} - {()}
    if len(batches) > 1:
        raise ValueError(
            f"shapes must be single ones, or batches of one size, got {sorted(batches)}"
        )
    batch = batches.pop() if batches else ()
    place = _far_place(shapes)
    if place is not None:
        near_from_world = RigidTransform(np.eye(3), -place)
        shapes = [shape.transformed(near_from_world) for shape in shapes]
    dtype = jnp.result_type(*(shape.dtype for shape in shapes))
    leaves: list[AbstractPrimitive] = []
    terms = tuple(_taken_apart(shape, leaves) for shape in shapes)

    def converted(shape: AbstractPrimitive) -> AbstractPrimitive:
        has_batch = shape.batch_shape == batch

        def convert(x: Array) -> Array:
            x = jnp.asarray(x)
            x = x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x
            return x if has_batch else jnp.broadcast_to(x, (*batch, *x.shape))

        return jax.tree.map(convert, shape)

    zeros = jnp.zeros((*batch, 3), dtype)
    return Solid(
        shapes=tuple(map(converted, leaves)),
        expression=(name, terms),
        rotation=jnp.broadcast_to(jnp.eye(3, dtype=dtype), (*batch, 3, 3)),
        translation=zeros if place is None else np.zeros(zeros.shape) + place,
    )


def _ball_near(
    expression: Expression, shapes: Sequence[AbstractPrimitive]
) -> Ball | None:
    """Ball of `Extent`."""
    hull = hull_of(expression, shapes)
    if hull is not None:
        return hull.ball()
    if any(is_endless_function(shape) for shape in shapes):
        return None
    center, radius = zip(*map(ball_of, shapes), strict=True)
    middle = functools.reduce(operator.add, center) / len(center)
    off = [Vec3.from_array(x - middle).norm() for x in center]
    reach = map(operator.add, off, radius)
    return middle, functools.reduce(jnp.maximum, reach)


def _far_place(shapes: Sequence[AbstractPrimitive]) -> Float[np.ndarray, "3"] | None:
    """A place among shapes that lie so far off that they keep double precision.

    It is where their own frame is, in which they lie near; None if none lies far off.
    """
    leaves = [leaf for leaf in jax.tree.leaves(shapes) if is_exact(leaf)]
    if not leaves:
        return None
    places = np.concatenate([leaf.reshape(-1, 3) for leaf in leaves])
    return places[np.argmax(np.linalg.norm(places, axis=1))]


def _taken_apart(
    shape: AbstractPrimitive, leaves: list[AbstractPrimitive]
) -> Expression:
    """How a shape is made of those that are added to the leaves."""
    first = len(leaves)
    if isinstance(shape, Solid):
        leaves += _in_the_world(shape)
        return counted_from(first, shape.expression)
    if isinstance(shape, Heightfield):
        if shape.batch_shape:
            raise ValueError(
                "shapes must hold no batch of heightfields, got one of shape "
                f"{shape.batch_shape}; map over it with jax.vmap"
            )
        leaves += [shape, *shape.sides]
        return "intersection", tuple(range(first, len(leaves)))
    if _is_open(shape):
        raise ValueError(
            "shapes must be closed, to enclose what solids are made of, got a "
            f"{type(shape).__name__} that is open"
        )
    leaves.append(shape)
    return first


def _is_open(shape: AbstractPrimitive) -> bool:
    # Of a function of the module JAX keeps what it has traced, for the next shape of
    # the kind: 84 shapes took 3 s, and take 0.3 s.
    return jax.eval_shape(_stretches_of, shape) is None


def _stretches_of(shape: AbstractPrimitive) -> tuple[Stretch, ...] | None:
    zeros = Vec3(*jnp.zeros((3, *shape.batch_shape), shape.dtype))
    return shape.stretches(Ray(zeros, zeros))


def _in_the_world(solid: Solid) -> Sequence[AbstractPrimitive]:
    """The shapes of a solid where its pose moves them."""
    pose = solid.rotation, solid.translation
    if is_concrete(pose):
        turn, shift = map(np.asarray, pose)
        if np.all(turn == np.eye(3)) and not shift.any():
            return solid.shapes

    def moved(
        shapes: tuple[AbstractPrimitive, ...],
        rotation: Float[Array, "3 3"],
        translation: Points,
    ) -> tuple[AbstractPrimitive, ...]:
        world_from_shapes = RigidTransform(rotation, translation)
        return tuple(shape.transformed(world_from_shapes) for shape in shapes)

    if solid.batch_shape:
        moved = jax.vmap(moved)
    return moved(solid.shapes, *pose)


@jax.custom_jvp
def _first_hit(
    ray: Ray, solid: Solid
) -> tuple[Float[Array, "*batch"], Int[Array, "*batch"]]:
    """Ray parameter of the first hit, `+inf` on a miss; twice its part, plus on a cap.

    A miss has the code 0.
    """
    near, foot, extent = solid._near(ray)
    search = Search(
        near=jax.tree.map(lambda x: jnp.broadcast_to(x, foot.shape), near),
        least=-foot,
        reach=near.origin.norm() + extent.reach,
        shapes=solid.shapes,
        ball=extent.ball if solid.is_bounded else None,
    )
    t, code = first_change(search, solid.expression)
    return foot + t, code


@_first_hit.defjvp
def _first_hit_jvp(primals, tangents):
    t, code = _first_hit(*primals)
    mask = jnp.isfinite(t)

    def cast(ray: Ray, solid: Solid) -> Float[Array, "*batch"]:
        near, foot, extent = solid._near(ray)
        place = jnp.where(mask, t, 0) - foot
        room = (near.origin.norm() + extent.reach) / near.direction.norm()
        depth = jnp.zeros_like(place)
        for shape, mine, _ in solid._seen(code // 2, mask):
            start = jax.lax.stop_gradient(_start(shape, near, place, room))
            start = jnp.where(mine, start, 0)
            hit = shape.intersect(Ray(near.at(start), near.direction))
            # Two programs may round an outline's ray to either side.
            depth = jnp.where(mine & hit.mask, foot + start + hit.t, depth)
        return depth

    _, d_t = jax.jvp(cast, primals, tangents)
    return (t, code), (d_t, zero_from_primal(code))


def _start(shape: AbstractPrimitive, near: Ray, t: Numbers, room: Numbers) -> Numbers:
    """Where a ray has to start for a shape's surface at t to be the first it meets.

    Half way from the last of its other ends; without one, a bit before.
    """
    stretches = shape.stretches(near)
    assert stretches is not None
    ends = [end.t for stretch in stretches for end in (stretch.enter, stretch.leave)]
    # The one that is seen is the nearest, and no other.
    off = functools.reduce(jnp.minimum, [jnp.abs(end - t) for end in ends])
    before = jnp.full_like(t, -jnp.inf)
    for end in ends:
        is_before = (end < t) & (jnp.abs(end - t) > off) & jnp.isfinite(end)
        before = jnp.where(is_before, jnp.maximum(before, end), before)
    return jnp.where(jnp.isfinite(before), (before + t) / 2, t - room)
