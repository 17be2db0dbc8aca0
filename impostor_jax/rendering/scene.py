"""Any mix of shapes; the closest surface is seen.

Shapes of a type lie side by side in arrays, as many as the next size of a bucket, so
that one more of a type, or one that moves, runs the program that is there. Planes, and
what else may be seen anywhere, are each cast at every ray, and fill no bucket. Types
that a scene does not hold are in no program.
"""

__all__ = ["Group", "Scene", "Shown"]

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.primitives.base import AbstractPrimitive, in_camera_frame
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.rendering.bounds import is_bounded

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


class Scene(eqx.Module):
    """Shapes in the world frame.

    Args:
        shapes: Primitives, single ones or batches (n,), of any types. They are counted
            in this order, the members of a batch one by one.

    Derivatives:
        Depth and normal of a pixel are differentiable in every field of the shape that
        it sees, and do not depend on any other; they jump where one shape takes
        another's place. Differentiate in the shapes, from which a scene can be made
        while they are traced, or by `equinox.filter_grad` in the scene.

    Raises:
        ValueError: There is no shape, or something is none.
    """

    groups: tuple[Group, ...]

    def __init__(self, shapes: Sequence[AbstractPrimitive]):
        if isinstance(shapes, AbstractPrimitive) or not isinstance(shapes, Sequence):
            raise ValueError(
                f"shapes must be a sequence of primitives, got {type(shapes).__name__}"
            )
        for shape in shapes:
            if not isinstance(shape, AbstractPrimitive) or len(shape.batch_shape) > 1:
                raise ValueError(
                    "shapes must be primitives, single ones or batches (n,), got "
                    f"{type(shape).__name__}"
                )
        if not sum(shape.batch_shape == () or shape.batch_shape[0] for shape in shapes):
            raise ValueError("shapes must hold at least one primitive, got none")
        dtype = jnp.result_type(*(shape.dtype for shape in shapes))
        alike: dict[Any, list[tuple[AbstractPrimitive, np.ndarray]]] = {}
        first = 0
        for shape in shapes:
            batch = _as_batch(shape, dtype)
            index = first + np.arange(batch.batch_shape[0])
            first += len(index)
            alike.setdefault(_structure(batch, first), []).append((batch, index))
        # In an order of their own, which that of the shapes does not change.
        self.groups = tuple(_group(alike[key]) for key in sorted(alike))

    @property
    def dtype(self) -> np.dtype:
        """Floating-point type of the fields."""
        return self.groups[0].primitives.dtype

    def seen_by(self, camera: AbstractCamera) -> "Scene":
        """Express the shapes in the frame of a camera."""
        moved = jax.vmap(lambda primitive: in_camera_frame(primitive, camera))
        groups = tuple(Group(moved(g.primitives), g.index) for g in self.groups)
        return eqx.tree_at(lambda scene: scene.groups, self, groups)


Shown = AbstractPrimitive | Scene
"""What can be rendered."""


def _as_batch(shape: AbstractPrimitive, dtype: np.dtype) -> AbstractPrimitive:
    """The shape as a batch (n,), in the precision of the scene."""

    def converted(x: Array) -> Array:
        x = jnp.asarray(x)
        x = x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x
        return x if shape.batch_shape else x[None]

    return jax.tree.map(converted, shape)


def _structure(batch: AbstractPrimitive, first: int) -> tuple[str, ...]:
    """What shapes must have in common to lie side by side.

    A heightfield has a grid or a function of its own and lies alone.
    """
    alone = f"{first:09d}" if isinstance(batch, Heightfield) else ""
    leaves = [str(leaf.shape[1:]) for leaf in jax.tree.leaves(batch)]
    return type(batch).__name__, str(jax.tree.structure(batch)), *leaves, alone


def _group(alike: list[tuple[AbstractPrimitive, np.ndarray]]) -> Group:
    """Shapes of one structure, and copies of the first that fill the bucket."""
    batches, indices = zip(*alike, strict=True)
    index = np.concatenate(indices)
    size = 1 if is_bounded(type(batches[0])) else len(index)
    while size < len(index):
        size *= GROWTH
    spare = size - len(index)

    def joined(*leaves: Array) -> Array:
        filler = jnp.broadcast_to(leaves[0][:1], (spare, *leaves[0].shape[1:]))
        return jnp.concatenate([*leaves, filler])

    index = np.concatenate([index, np.full(spare, -1)])
    return Group(jax.tree.map(joined, *batches), jnp.asarray(index, dtype=jnp.int32))
