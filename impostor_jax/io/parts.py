"""Shapes taken apart: batches into their members, solids into what they are made of."""

__all__ = ["Joined", "Tree", "members", "tree_of"]

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np

from impostor_jax.numerics import eps
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.solid import Expression, Solid

Values = TypeVar("Values")

ROUNDING = 256
"""By which a ground's sides may be off, in eps: poses have moved them apart from it."""


class Joined(NamedTuple):
    """Part of a solid.

    Attributes:
        operation: Its name: union, intersection or difference.
        parts: What it joins, in order.
    """

    operation: str
    parts: tuple["Tree", ...]


Tree = AbstractPrimitive | Joined


def members(values: Values, batch_shape: Sequence[int]) -> list[Values]:
    """Members of a batch of that shape, one after the other; or the only one."""
    rank = len(batch_shape)
    return [
        jax.tree.map(lambda x, k=k: x.reshape(-1, *x.shape[rank:])[k], values)
        for k in range(math.prod(batch_shape))
    ]


def tree_of(solid: Solid) -> Joined:
    """What a single solid is made of, in the frame of its shapes.

    A heightfield stands for the ground below it: the planes that a solid holds beside
    its extent are part of it.

    Raises:
        ValueError: A ground's sides have been moved away from its extent.
    """
    tree = _tree_of(solid.expression, solid.shapes)
    return tree if isinstance(tree, Joined) else Joined("union", (tree,))


def _tree_of(expression: Expression, shapes: Sequence[AbstractPrimitive]) -> Tree:
    if isinstance(expression, int):
        return shapes[expression]
    name, terms = expression
    found = _ground_of(name, [shapes[k] for k in terms if isinstance(k, int)])
    if found is not None:
        return found
    return Joined(name, tuple(_tree_of(term, shapes) for term in terms))


def _ground_of(name: str, parts: Sequence[AbstractPrimitive]) -> Heightfield | None:
    """The heightfield of a ground with its sides; None of anything else."""
    fields = [part for part in parts if isinstance(part, Heightfield)]
    if not fields:
        return None
    (field, *more), planes = fields, parts[1:]
    sides = field.sides
    is_ground = name == "intersection" and not more and len(planes) == len(sides)
    if not is_ground or not all(map(_is_same, planes, sides)):
        raise ValueError(
            "a heightfield in a solid must have the sides of its extent, as ij.union "
            "and the like give it"
        )
    return field


def _is_same(given: Any, side: Plane) -> bool:
    """Whether a plane is that one, to rounding."""
    if not isinstance(given, Plane):
        return False
    points, normals = (
        np.asarray(pair, float)
        for pair in (
            (given.point, side.point), (given.unit_normal, side.unit_normal)
        )
    )  # fmt: skip
    few = float(eps(side.dtype, ROUNDING))
    off = abs(np.dot(points[0] - points[1], normals[1]))
    return bool(
        off <= few * np.abs(points).sum() and np.allclose(*normals, rtol=0, atol=few)
    )
