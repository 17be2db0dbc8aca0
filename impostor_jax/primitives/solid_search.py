"""Where a ray first meets a solid made of solids: a search, without a derivative.

Shapes of one type are crossed side by side, so that a program grows with the types, and
the ends of all stretches are tried one after the other by a loop that is compiled once.
So many rays at a time stay in a processor's cache, and where none of them passes the
ball around the solid, they are done.
"""

__all__ = ["Search", "alike", "chosen", "first_change"]

import operator
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.compiling import computed_once
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, eps
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.expression import Ball, Expression, evaluated
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.stretch import End, Stretch

ROUNDING = 4
"""Of an end, in eps of the lengths it is made of."""

TOGETHER = 4096
"""Rays that are searched at a time."""

AROUND = 1.001
"""Factor on the ball's radius, for the rounding of the ray."""

Shapes = tuple[AbstractPrimitive, ...]


class Search(NamedTuple):
    """What is searched, and by what.

    Attributes:
        near: The rays, from near the solid, in the shapes' frame.
        least: Ray parameter from which on they see anything.
        reach: Lengths from which places on them are computed.
        shapes: The shapes; single ones, or one for each ray.
        ball: Around all that is there; None where that has no end.
    """

    near: Ray
    least: Numbers
    reach: Numbers
    shapes: Shapes
    ball: Ball | None


def first_change(
    search: Search, expression: Expression
) -> tuple[Float[Array, "*batch"], Int[Array, "*batch"]]:
    """First end of a stretch at which an expression changes.

    Returns:
        Its ray parameter, from where the near ray begins, `+inf` where there is none;
        and twice the number of its part, counted through all shapes, plus 1 on a cap.
    """
    size = search.least.shape
    count = int(np.prod(size))
    together = min(count, TOGETHER)
    per_ray = (search.near, search.least, search.reach)
    of_shapes = (search.shapes, search.ball)
    rank = len(search.shapes[0].batch_shape)

    def chunks(x: Array) -> Array:
        flat = x.reshape(count, *x.shape[len(size) :])
        spare = [(0, -count % together), *[(0, 0)] * (flat.ndim - 1)]
        padded = jnp.pad(flat, spare, mode="edge")
        return padded.reshape(-1, together, *flat.shape[1:])

    def searched(given: Any) -> tuple[Array, Array]:
        (near, least, reach), of_shapes_here = given
        here = Search(near, least, reach, *of_shapes_here)
        nothing = jnp.full_like(least, jnp.inf), jnp.zeros(least.shape, jnp.int32)
        if here.ball is None:
            return _changes(here, expression)
        may_meet = jnp.any(_passes(here.near, here.ball))
        return jax.lax.cond(
            may_meet, lambda: _changes(here, expression), lambda: nothing
        )

    if rank:
        of_each = jax.tree.map(
            lambda x: jnp.broadcast_to(x, (*size, *x.shape[rank:])), of_shapes
        )
        found = jax.lax.map(searched, jax.tree.map(chunks, (per_ray, of_each)))
    else:
        found = jax.lax.map(
            lambda rays: searched((rays, of_shapes)), jax.tree.map(chunks, per_ray)
        )
    return jax.tree.map(lambda x: x.reshape(-1)[:count].reshape(size), found)


def _passes(near: Ray, ball: Ball) -> Bool[Array, " n"]:
    """Which rays pass a ball."""
    center, radius = ball
    d = near.direction
    off = (near.origin - Vec3.from_array(center)).cross(d)
    return off.dot(off) <= (AROUND * radius) ** 2 * d.dot(d)


def _changes(
    search: Search, expression: Expression
) -> tuple[Float[Array, " n"], Int[Array, " n"]]:
    """`first_change` of some rays."""
    near, shapes = search.near, search.shapes
    first = np.cumsum([0, *(shape.num_parts for shape in shapes)])
    rows: list[Stretch] = []
    owners: list[int] = []
    for numbers in alike(shapes):
        for stretch in _stretches([shapes[k] for k in numbers], near):
            owners += numbers
            rows.append(_with_parts(stretch, first[list(numbers)]))
    enter, leave = (
        _joined([row.enter for row in rows]),
        _joined([row.leave for row in rows]),
    )
    ends = _joined([enter, leave])
    crosses = enter.t <= leave.t
    is_end = jnp.concatenate([crosses, crosses]) & jnp.isfinite(ends.t)
    t = jnp.where(is_end, ends.t, 0)
    speed = near.direction.norm()
    room = eps(t.dtype, ROUNDING) * (search.reach[None] + jnp.abs(t) * speed[None])
    room = room / ends.slope
    code = 2 * ends.part + ends.on_cap.astype(jnp.int32)
    ahead = is_end & (t > search.least[None])

    def is_inside(t: Float[Array, " n"]) -> Bool[Array, " n"]:
        inside: dict[int, Bool[Array, " n"]] = {}
        for row, number in enumerate(owners):
            holds = (enter.t[row] < t) & (t < leave.t[row])
            inside[number] = inside[number] | holds if number in inside else holds
        joins = {"union": operator.or_, "intersection": operator.and_}
        of_each = [inside[number] for number in range(len(shapes))]
        return evaluated(expression, of_each, joins, operator.invert)

    def at_end(
        number: Int[Array, ""], best: tuple[Float[Array, " n"], Int[Array, " n"]]
    ) -> tuple[Float[Array, " n"], Int[Array, " n"]]:
        here, beside = t[number], room[number]
        changes = is_inside(here - beside) != is_inside(here + beside)
        nearer = ahead[number] & changes & (here < best[0])
        return jnp.where(nearer, here, best[0]), jnp.where(
            nearer, code[number], best[1]
        )

    start = jnp.full_like(search.least, jnp.inf), jnp.zeros(speed.shape, jnp.int32)
    return jax.lax.fori_loop(0, t.shape[0], at_end, start)


def _stretches(shapes: Sequence[AbstractPrimitive], near: Ray) -> tuple[Stretch, ...]:
    """Stretches in shapes of one type, (k, n)."""
    if len(shapes) == 1:
        found = computed_once(lambda: shapes[0].stretches(near))
        found = jax.tree.map(lambda x: x[None], found)
    else:
        stacked = jax.tree.map(lambda *x: jnp.stack(x), *shapes)
        found = computed_once(
            lambda: jax.vmap(lambda shape: shape.stretches(near))(stacked)
        )
    assert found is not None
    return found


def _joined(ends: Sequence[End]) -> End:
    """Ends (k, n), one after the other."""
    return jax.tree.map(lambda *x: jnp.concatenate(x), *ends)


def _with_parts(stretch: Stretch, first: Int[np.ndarray, " k"]) -> Stretch:
    """The stretches with parts counted through all shapes."""

    def counted(end: End) -> End:
        parts = end.part.astype(jnp.int32) + jnp.asarray(first, jnp.int32)[:, None]
        return End(end.t, parts, end.on_cap, end.slope)

    return Stretch(counted(stretch.enter), counted(stretch.leave))


def alike(shapes: Sequence[AbstractPrimitive]) -> list[tuple[int, ...]]:
    """Numbers of the shapes that can lie side by side. A heightfield lies alone."""
    found: dict[Any, list[int]] = {}
    for number, shape in enumerate(shapes):
        alone = number if isinstance(shape, Heightfield) else -1
        key = (alone, jax.tree.structure(shape))
        found.setdefault(key, []).append(number)
    return [tuple(numbers) for numbers in found.values()]


def chosen(
    shapes: Sequence[AbstractPrimitive],
    numbers: Sequence[int],
    number: Int[Array, "*batch"],
) -> AbstractPrimitive:
    """Of shapes that can lie side by side, one for each ray; the first for others.

    Args:
        shapes: All shapes: single ones, or one for each ray.
        numbers: Those that can lie side by side.
        number: Which one it is.
    """
    some = [shapes[k] for k in numbers]
    if len(some) == 1:
        return some[0]
    rank = len(some[0].batch_shape)

    def choose(*fields: Array) -> Array:
        rest = fields[0].shape[rank:]
        value, *others = (jnp.broadcast_to(x, (*number.shape, *rest)) for x in fields)
        for k, other in zip(numbers[1:], others, strict=True):
            mine = (number == k).reshape(*number.shape, *(1,) * len(rest))
            value = jnp.where(mine, other, value)
        return value

    return jax.tree.map(choose, *some)
