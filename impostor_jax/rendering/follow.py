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
    "placed",
    "seen",
    "shape_of",
    "stride_of",
]

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TypeVar

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


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def followed(
    scene: tuple[Sequence[Group], Ray],
    t: Float[Array, "*batch"],
    code: Code,
    with_normal: bool,
) -> Surface:
    """The surface that was found, now with a derivative in the shapes and the rays."""
    if not with_normal:
        return t, None
    groups, rays = scene
    zero = jnp.zeros_like(t)
    normal = Vec3(zero, zero, zero)
    for shape, mine, hit in seen(groups, t, code):
        normal = shape.normal(rays, hit).where(mine, normal)
    return t, normal


@followed.defjvp
def _followed_jvp(with_normal, primals, tangents):
    scene, t, code = primals

    def cast(scene: tuple[Sequence[Group], Ray]) -> Surface:
        groups, rays = scene
        depth = jnp.zeros_like(t)
        normal = Vec3(depth, depth, depth)
        for shape, mine, _ in seen(groups, t, code):
            hit = shape.intersect(rays)
            # Two programs may round an outline's ray to either side.
            mine = mine & hit.mask
            depth = jnp.where(mine, hit.t, depth)
            if with_normal:
                own = Hit(jnp.where(mine, hit.t, jnp.inf), hit.on_cap, hit.part)
                normal = normal + shape.normal(rays, own)
        return depth, normal if with_normal else None

    _, change = jax.jvp(cast, (scene,), tangents[:1])
    return followed(scene, t, code, with_normal), change


def seen(
    groups: Sequence[Group], t: Float[Array, "*batch"], code: Code
) -> Iterator[tuple[AbstractPrimitive, Bool[Array, "*batch"], Hit]]:
    """Of each group: the shapes ray by ray, where they are seen, and the hits."""
    stride = stride_of(groups)
    part = code % stride
    for group, mine, member in placed(groups, code):
        shape = shape_of(group, member)
        hit = Hit(jnp.where(mine, t, jnp.inf), part % 2 == 1, part // 2)
        yield shape, mine, hit


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
