"""The surfaces that a search has found, with their derivatives.

A search yields of each ray only how far it goes and a code: which shape it meets, and
which part of it. The normal follows from these, and so does the derivative, which does
not pass through the search: of each type of shape once, whatever the search had to try.
"""

__all__ = [
    "code_of",
    "code_stride",
    "followed",
    "member_of",
    "normals_of",
    "of_seen",
    "placed",
    "seen",
    "shape_of",
    "stride_of",
]

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.rendering.group import Group, lies_alone

FEW = 16
"""Shapes of a type that are chosen one by one."""

Values = TypeVar("Values")

Surface = tuple[Float[Array, "*batch"], Vec3 | None]
"""Ray parameter, and the normal if it is wanted."""

Code = Int[Array, "*batch"]
"""Place of what is seen among all shapes, times a stride, plus twice its part, plus 1
on a cap; below 0 where nothing is."""


def stride_of(groups: Sequence[Group]) -> int:
    """Codes of a shape: of each piece that any of them has, on a cap or not."""
    return code_stride(
        sum(group.index.shape[0] for group in groups),
        max(group.primitives.num_parts for group in groups),
    )


def code_stride(num_shapes: int, num_parts: int) -> int:
    """Codes of each of so many shapes with so many parts.

    Raises:
        ValueError: The codes of all are more than 32 bits count.
    """
    stride = 2 * num_parts
    most = np.iinfo(np.int32).max // stride
    if num_shapes > most:
        raise ValueError(
            f"shapes of a scene must be at most {most} where one has {num_parts} "
            f"parts, got {num_shapes}, those included that fill up its buckets"
        )
    return stride


def code_of(place: Int[Array, "*#batch"], hit: Hit, stride: int) -> Code:
    """Code of hits of shapes at their places."""
    piece = 2 * hit.part.astype(jnp.int32) + hit.on_cap.astype(jnp.int32)
    return stride * place + piece


class Seen(NamedTuple):
    """What rays see of a group.

    Attributes:
        group: The shapes.
        mine: Where one of them is seen.
        member: Which of them; the first elsewhere.
        piece: Twice its part, plus 1 on a cap.
    """

    group: Group
    mine: Bool[Array, "*batch"]
    member: Int[Array, "*batch"]
    piece: Int[Array, "*batch"]

    @property
    def shape(self) -> AbstractPrimitive:
        """The shapes ray by ray."""
        return shape_of(self.group, self.member)

    def hit(self, t: Float[Array, "*batch"]) -> Hit:
        """Hits at these ray parameters, where the group is seen."""
        t = jnp.where(self.mine, t, jnp.inf)
        return Hit(t, self.piece % 2 == 1, self.piece // 2)


def normals_of(
    groups: Sequence[Group], rays: Ray, t: Float[Array, "*batch"], code: Code
) -> Vec3:
    """Unit normals of the surfaces that were found; without a derivative."""
    groups, rays, t = jax.lax.stop_gradient((groups, rays, t))

    def put(_: int, seen: Seen, planes: Float[Array, " 3 *batch"]) -> Array:
        own = seen.shape.normal(rays, seen.hit(t)).planes()
        return jnp.where(seen.mine, own, planes)

    return Vec3(*of_seen(groups, code, put, jnp.zeros((3, *t.shape), t.dtype)))


def of_seen(
    groups: Sequence[Group],
    code: Code,
    put: Callable[[int, Seen, Values], Values],
    values: Values,
) -> Values:
    """Values of the shapes that rays see, one type after the other.

    Each type has a branch of its own, which is not run where none is seen. What is not
    in a branch XLA computes, and compiles, anew for all that reads it: the picture of
    the gallery, of thirteen types, then takes twice the time.

    Args:
        groups: The shapes.
        code: What rays see.
        put: From the number of a group, what is seen of it, and values of all rays to
            those where the group's stand in their place.
        values: Of rays that see nothing.
    """
    for number, one in enumerate(seen(groups, code)):
        values = jax.lax.cond(
            jnp.any(one.mine), partial(put, number, one), lambda values: values, values
        )
    return values


@jax.custom_jvp
def followed(
    scene: tuple[Sequence[Group], Ray],
    t: Float[Array, "*batch"],
    code: Code,
    normal: Vec3 | None = None,
) -> Surface:
    """The surface that was found, now with a derivative in the shapes and the rays."""
    return t, normal


@followed.defjvp
def _followed_jvp(primals, tangents):
    scene, t, code, found_normal = primals
    with_normal = found_normal is not None

    def cast(scene: tuple[Sequence[Group], Ray]) -> Surface:
        groups, rays = scene
        depth = jnp.zeros_like(t)
        normal = Vec3(depth, depth, depth)
        for one in seen(groups, code):
            shape = one.shape
            hit = shape.intersect(rays)
            # Two programs may round an outline's ray to either side.
            mine = one.mine & hit.mask
            depth = jnp.where(mine, hit.t, depth)
            if with_normal:
                own = Hit(jnp.where(mine, hit.t, jnp.inf), hit.on_cap, hit.part)
                normal = normal + shape.normal(rays, own)
        return depth, normal if with_normal else None

    _, change = jax.jvp(cast, (scene,), tangents[:1])
    return followed(scene, t, code, found_normal), change


def seen(groups: Sequence[Group], code: Code) -> Iterator[Seen]:
    """What is seen of each group."""
    part = code % stride_of(groups)
    for group, mine, member in placed(groups, code):
        yield Seen(group, mine, member, part)


def placed(
    groups: Sequence[Group], code: Code
) -> Iterator[tuple[Group, Bool[Array, "*batch"], Int[Array, "*batch"]]]:
    """Each group, where its shapes are seen, and which of them; the first elsewhere."""
    place, first = code // stride_of(groups), 0
    for group in groups:
        count = group.index.shape[0]
        mine = (first <= place) & (place < first + count)
        yield group, mine, jnp.clip(place - first, 0, count - 1)
        first += count


def shape_of(
    group: Group, member: Int[Array, "*batch"], *, by_index: bool = False
) -> AbstractPrimitive:
    """The shape that each member of a group is, (*batch,).

    What lies alone in its group stays the single one that can be cast.

    Args:
        group: Of the shapes.
        member: Which of them.
        by_index: Whether it is taken by an index of few, too.
    """
    if lies_alone(group.primitives):
        return jax.tree.map(lambda x: x[0], group.primitives)
    if by_index:
        return jax.tree.map(lambda x: x[member], group.primitives)
    return member_of(group.primitives, member)


def member_of(values: Values, member: Int[Array, "*batch"]) -> Values:
    """Of arrays (n, ...), what each member has, (*batch, ...).

    Of few without an index, whose derivative in reverse mode adds up number by number.
    """

    def taken(x: Array) -> Array:
        if x.shape[0] > FEW:
            return x[member]
        rank = (1,) * (x.ndim - 1)
        value = jnp.broadcast_to(x[0], (*member.shape, *x.shape[1:]))
        for k in range(1, x.shape[0]):
            value = jnp.where((member == k).reshape(member.shape + rank), x[k], value)
        return value

    return jax.tree.map(taken, values)
