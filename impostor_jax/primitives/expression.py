"""Expressions of union, intersection and difference, and what holds for them."""

__all__ = [
    "Ball",
    "Expression",
    "ball_of",
    "counted_from",
    "evaluated",
    "hull_of",
    "is_bounded",
    "is_endless_function",
    "reach_of",
]

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.geometry.hull import AbstractHull, JoinedHull, OverlapHull
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.plane import Plane

Values = TypeVar("Values")

Expression = int | tuple[str, tuple[Any, ...]]
"""Number of a shape, or the name of an operation and the expressions it joins."""

Ball = tuple[Float[Array, "*batch 3"], Numbers]
"""Center and radius."""


def counted_from(first: int, expression: Expression) -> Expression:
    """The same of shapes whose numbers begin with another than 0."""
    if isinstance(expression, int):
        return first + expression
    name, terms = expression
    return name, tuple(counted_from(first, term) for term in terms)


def evaluated(
    expression: Expression,
    values: Sequence[Values],
    joins: Mapping[str, Callable[[Values, Values], Values]],
    complement: Callable[[Values], Values],
) -> Values:
    """Value of an expression from those of the shapes."""
    if isinstance(expression, int):
        return values[expression]
    name, terms = expression
    found = [evaluated(term, values, joins, complement) for term in terms]
    if name == "difference":
        found[1:] = map(complement, found[1:])
        name = "intersection"
    return functools.reduce(joins[name], found)


def is_bounded(expression: Expression, shapes: Sequence[AbstractPrimitive]) -> bool:
    """Whether a solid has an end in every direction."""
    if isinstance(expression, int):
        shape = shapes[expression]
        # The ground goes down without end.
        return shape.is_bounded and not isinstance(shape, Heightfield)
    name, terms = expression
    found = [is_bounded(term, shapes) for term in terms]
    if name == "difference":
        return found[0]
    return all(found) if name == "union" else any(found)


def hull_of(
    expression: Expression, shapes: Sequence[AbstractPrimitive]
) -> AbstractHull | None:
    """Hull of what is bounded."""
    if not is_bounded(expression, shapes):
        return None
    if isinstance(expression, int):
        return shapes[expression].hull
    name, terms = expression
    if name == "difference":
        return hull_of(terms[0], shapes)
    found = [hull_of(term, shapes) for term in terms]
    hulls = tuple(hull for hull in found if hull is not None)
    if len(hulls) == 1:
        return hulls[0]
    return JoinedHull(hulls) if name == "union" else OverlapHull(hulls)


def ball_of(shape: AbstractPrimitive) -> Ball:
    """Where a shape is: a ball that holds it, a plane's point, a ground's extent."""
    if isinstance(shape, Plane):
        return jnp.asarray(shape.point), jnp.zeros(shape.batch_shape, shape.dtype)
    if is_endless_function(shape):
        assert isinstance(shape, Heightfield)
        return jnp.zeros(3, shape.dtype), jnp.max(jnp.abs(shape.extent))
    assert shape.hull is not None
    return shape.hull.ball()


def reach_of(shape: AbstractPrimitive) -> Numbers:
    """How far from its frame's origin a shape reaches, as far as that is known."""
    center, radius = ball_of(shape)
    return Vec3.from_array(center).norm() + radius


def is_endless_function(shape: AbstractPrimitive) -> bool:
    """Whether it is the ground of a function, of which no one knows how far it goes."""
    return isinstance(shape, Heightfield) and not shape.is_bounded
