"""A bounding volume hierarchy, made and walked on any device.

The shapes are halved again and again at the median of their boxes' middles, along the
side of their common box that is longest, all parts of a level by one sort. Their number
is a power of 2, so the tree is complete, and its nodes in preorder, with the node to go
on with where a box is missed, are known before any shape.

Rays walk it in lanes: in lockstep they would wait for the slowest of them, 1.7 times as
long for 1000 balls.
"""

__all__ = ["Hierarchy", "hierarchy_of", "walk"]

import functools
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.geometry.lanes import in_lanes
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, eps

LANES = 4096
"""Rays that walk side by side."""

State = TypeVar("State")
"""Of each ray, arrays (n,): what the walk finds."""


class Hierarchy(eqx.Module):
    """Nodes in preorder: each is followed by its first half, if it has halves.

    Attributes:
        low: Corner of each node's box.
        high: The corner across.
        member: Place of a leaf's shape in the batch; -1 of a node with halves.
        skip: Node to go on with where the box is missed; the number of nodes at the
            end.
    """

    low: Float[Array, "nodes 3"]
    high: Float[Array, "nodes 3"]
    member: Int[Array, " nodes"]
    skip: Int[Array, " nodes"]


def hierarchy_of(
    low: Float[Array, "n 3"], high: Float[Array, "n 3"], there: Bool[Array, " n"]
) -> Hierarchy:
    """Make the hierarchy of boxes.

    Args:
        low: Corner of each box.
        high: The corner across.
        there: Whether there is such a shape; the boxes of others are put where no ray
            meets them.
    """
    count = low.shape[0]
    assert count & (count - 1) == 0, "a bucket's size is a power of 2"
    levels = count.bit_length() - 1
    # What is not there comes last in every part, and is in no other's box.
    middle = jnp.where(there[:, None], (low + high) / 2, jnp.inf)
    low = jnp.where(there[:, None], low, jnp.inf)
    high = jnp.where(there[:, None], high, -jnp.inf)
    order = jnp.arange(count, dtype=jnp.int32)
    place = order

    def halved(level: Int[Array, ""], order: Int[Array, " n"]) -> Int[Array, " n"]:
        """The parts of a level, each in order along its longest side."""
        part = place >> (levels - level)
        ends = (
            jax.ops.segment_max(high[order], part, count, indices_are_sorted=True),
            jax.ops.segment_min(low[order], part, count, indices_are_sorted=True),
        )
        axis = jnp.argmax(ends[0] - ends[1], axis=-1)[part]
        key = jnp.take_along_axis(middle[order], axis[:, None], axis=1)[:, 0]
        *_, order = jax.lax.sort((part, key, order), num_keys=2)
        return order

    # One sort for all levels: each takes a second to compile.
    order = jax.lax.fori_loop(0, levels, halved, order)
    lows, highs = [low[order]], [high[order]]
    for _ in range(levels):
        lows.append(jnp.min(lows[-1].reshape(-1, 2, 3), axis=1))
        highs.append(jnp.max(highs[-1].reshape(-1, 2, 3), axis=1))
    breadth_first, skip, leaf = _preorder(levels)
    low, high = (jnp.concatenate(x[::-1])[breadth_first] for x in (lows, highs))
    # The slab test passes any ray through a box that is turned inside out.
    nothing, far = low > high, float(np.finfo(low.dtype).max) / 4
    low, high = (jnp.where(nothing, far, x) for x in (low, high))
    member = jnp.where(leaf < 0, -1, order[np.maximum(leaf, 0)])
    return Hierarchy(low, high, member.astype(jnp.int32), jnp.asarray(skip))


@functools.cache
def _preorder(levels: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Order of the nodes of a complete tree.

    Returns:
        Of each node in preorder: its place breadth first, the node to go on with
        without its halves, and its place among the leaves, -1 if it is none.
    """
    places, skips, leaves = [], [], []

    def visit(level: int, within: int) -> None:
        here = len(places)
        places.append((1 << level) - 1 + within)
        skips.append(0)
        leaves.append(within if level == levels else -1)
        if level < levels:
            visit(level + 1, 2 * within)
            visit(level + 1, 2 * within + 1)
        skips[here] = len(places)

    visit(0, 0)
    as_numbers = functools.partial(np.array, dtype=np.int32)
    return as_numbers(places), as_numbers(skips), as_numbers(leaves)


class _Cast(NamedTuple):
    """Rays, ready for boxes."""

    ray: Ray
    inverse: Vec3

    @staticmethod
    def of(ray: Ray) -> "_Cast":
        # Of a direction across an axis any huge number will do, but not infinity, whose
        # product with the distance 0 is NaN.
        least = float(np.finfo(ray.direction.x.dtype).tiny)
        inverse = jax.tree.map(
            lambda d: 1 / jnp.where(jnp.abs(d) < least, jnp.copysign(least, d), d),
            ray.direction,
        )
        return _Cast(ray, inverse)

    def meets(
        self, low: Float[Array, "n 3"], high: Float[Array, "n 3"], reach: Numbers
    ) -> Bool[Array, " n"]:
        """Whether each ray meets its box before `reach`.

        No box is missed by rounding, which takes 6 eps; a triangle is wider than its
        box by 8 eps of its distance.

        References:
            Ize (2013), Robust BVH ray traversal, JCGT 2(2).
        """
        o, inverse = self.ray.origin, self.inverse
        first = _product(Vec3.from_array(low) - o, inverse)
        second = _product(Vec3.from_array(high) - o, inverse)
        near = _largest(jax.tree.map(jnp.minimum, first, second))
        far = -_largest(jax.tree.map(lambda x, y: -jnp.maximum(x, y), first, second))
        far = far * (1 + eps(far.dtype, 16))
        return (near <= far) & (far > 0) & (near < reach)


def _product(v: Vec3, w: Vec3) -> Vec3:
    return Vec3(v.x * w.x, v.y * w.y, v.z * w.z)


def _largest(v: Vec3) -> Numbers:
    return jnp.maximum(jnp.maximum(v.x, v.y), v.z)


def walk(
    tree: Hierarchy,
    rays: Ray,
    state: State,
    reach_of: Callable[[State], Float[Array, " n"]],
    meet: Callable[[State, Ray, Int[Array, " n"], Bool[Array, " n"]], State],
) -> State:
    """Take every ray past the leaves whose boxes it meets.

    Args:
        tree: Of the shapes.
        rays: (n,).
        state: Of each ray, before.
        reach_of: From states to the ray parameters from which on nothing counts; what
            is not positive ends a ray's walk, or it does not begin.
        meet: From states, their rays, shapes by their members, and whether their boxes
            are met, to the states with these shapes.

    Returns:
        The states, after.
    """
    last = tree.skip.shape[0]

    def turn(
        rays: Ray,
    ) -> Callable[[tuple[Array, State]], tuple[Array, State]]:
        cast = _Cast.of(rays)

        def step(kept: tuple[Array, State]) -> tuple[Array, State]:
            node, state = kept
            here = jnp.minimum(node, last - 1)
            meets = cast.meets(tree.low[here], tree.high[here], reach_of(state))
            meets, member = meets & (node < last), tree.member[here]
            is_leaf = member >= 0
            state = meet(state, cast.ray, jnp.maximum(member, 0), meets & is_leaf)
            node = jnp.where(meets & ~is_leaf, node + 1, tree.skip[here])
            return jnp.where(reach_of(state) > 0, node, last), state

        return step

    begin = jnp.where(reach_of(state) > 0, 0, last).astype(jnp.int32)
    _, found = in_lanes(turn, lambda kept: kept[0] < last, rays, (begin, state), LANES)
    return found
