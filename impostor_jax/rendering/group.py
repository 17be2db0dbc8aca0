"""Shapes of a type, side by side.

They lie in arrays, as many as the next size of a bucket, so that one more of a type, or
one that moves, runs the program that is there. Planes, heightfields, and what else may
be seen anywhere, fill no bucket.
"""

__all__ = ["Group", "grouped", "is_searched", "lies_alone", "padded_size"]

from collections.abc import Iterator, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from impostor_jax.arguments import is_concrete, is_exact
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.solid import Solid

Leaf = Array | np.ndarray

GROWTH = 4
"""Sizes of buckets are its powers."""


class Group(eqx.Module):
    """Shapes of one type and structure.

    Attributes:
        primitives: A batch (n,); the last ones may be there to fill the bucket.
        index: Of each among the scene's shapes, in the order they were given; -1 of
            those that fill the bucket and are not seen.
    """

    primitives: AbstractPrimitive
    index: Int[Array, " n"]

    def transformed(self, target_from_source: RigidTransform) -> "Group":
        """Express the shapes in another frame, by numbers that Python can read."""
        shapes = self.primitives
        if isinstance(shapes, Heightfield):
            # One alone, whose pose is no batch.
            one = jax.tree.map(lambda x: x[0], shapes).transformed(target_from_source)
            shapes = jax.tree.map(lambda x: x[None], one)
        else:
            shapes = shapes.transformed(target_from_source)
        return Group(shapes, self.index)


def grouped(shapes: Sequence[AbstractPrimitive]) -> tuple[Group, ...]:
    """The shapes by their types, in an order that does not depend on theirs.

    Args:
        shapes: Single ones or batches (n,), of any types. They are counted in this
            order, the members of a batch one by one.
    """
    dtype = jnp.result_type(*(shape.dtype for shape in shapes))
    alike: dict[Any, list[tuple[AbstractPrimitive, np.ndarray]]] = {}
    first = 0
    for batch in _batches(shapes, dtype):
        index = first + np.arange(batch.batch_shape[0])
        first += len(index)
        alike.setdefault(_structure(batch, first), []).append((batch, index))
    return tuple(_group(alike[key]) for key in sorted(alike))


def padded_size(count: int) -> int:
    """Size of the bucket for so many."""
    size = 1
    while size < count:
        size *= GROWTH
    return size


def is_searched(shapes: AbstractPrimitive) -> bool:
    """Whether shapes like these are searched side by side, for the pixels they cover.

    Others are each cast at every ray: what may be seen anywhere, and what lies alone.
    """
    return shapes.is_bounded and not lies_alone(shapes)


def lies_alone(shapes: AbstractPrimitive) -> bool:
    """Whether shapes like these are cast at rays one by one, and are no batch of many.

    A heightfield has a grid or a function of its own, and so has what is made of one.
    """
    if isinstance(shapes, Solid):
        return any(lies_alone(shape) for shape in shapes.shapes)
    return isinstance(shapes, Heightfield)


def _batches(
    shapes: Sequence[AbstractPrimitive], dtype: np.dtype
) -> Iterator[AbstractPrimitive]:
    """The shapes as batches (n,), of one each where they lie alone."""
    for shape in shapes:
        batch = _as_batch(shape, dtype)
        if lies_alone(batch):
            for k in range(batch.batch_shape[0]):
                yield jax.tree.map(lambda x, k=k: x[k : k + 1], batch)
        else:
            yield batch


def _as_batch(shape: AbstractPrimitive, dtype: np.dtype) -> AbstractPrimitive:
    """The shape as a batch (n,), in the precision of the scene."""

    def converted(x: Leaf) -> Leaf:
        if is_exact(x):
            return x if shape.batch_shape else x[None]
        x = jnp.asarray(x)
        x = x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x
        return x if shape.batch_shape else x[None]

    return jax.tree.map(converted, shape)


def _structure(batch: AbstractPrimitive, first: int) -> tuple[str, ...]:
    """What shapes must have in common to lie side by side."""
    alone = f"{first:09d}" if lies_alone(batch) else ""
    leaves = [str(leaf.shape[1:]) for leaf in jax.tree.leaves(batch)]
    return type(batch).__name__, str(jax.tree.structure(batch)), *leaves, alone


def _group(alike: list[tuple[AbstractPrimitive, np.ndarray]]) -> Group:
    """Shapes of one structure, and copies of the first that fill the bucket."""
    batches, indices = zip(*alike, strict=True)
    index = np.concatenate(indices)
    size = padded_size(len(index)) if is_searched(batches[0]) else len(index)
    spare = size - len(index)

    def joined(*leaves: Leaf) -> Leaf:
        # What lies far off keeps its digits until it is seen from near.
        is_host = any(map(is_exact, leaves)) and is_concrete(leaves)
        xp = np if is_host else jnp
        filler = xp.broadcast_to(leaves[0][:1], (spare, *leaves[0].shape[1:]))
        return xp.concatenate([*leaves, filler])

    index = np.concatenate([index, np.full(spare, -1)])
    return Group(jax.tree.map(joined, *batches), jnp.asarray(index, dtype=jnp.int32))
