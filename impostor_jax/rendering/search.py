"""What any rays meet first, and whether anything is in their way.

Rays may start anywhere and go anywhere: from lights, mirrors and glass, or a user's
own. Few shapes are each cast at every ray; many of a type are put into a hierarchy of
boxes, which takes longer for few and grows with their logarithm. What has no end is in
no box, and is cast at every ray. (Rays of a camera are searched by cells of its image:
`impostor_jax.rendering.closest`.)

A search has no derivative: `impostor_jax.rendering.follow` gives what it has found one.
"""

__all__ = ["SEARCHED", "Searched", "first_met", "is_blocked", "searched"]

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.compiling import computed_apart
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.rendering.follow import code_of, stride_of
from impostor_jax.rendering.group import Group
from impostor_jax.rendering.hierarchy import Hierarchy, hierarchy_of, walk

MANY = 128
"""Shapes of a type, and more, are put into boxes."""

TOGETHER = 8192
"""Rays that few shapes are cast at together: they stay in a processor's cache."""

SEARCHED = "searched"
"""Name of what is found, so that a derivative that computes all else anew keeps it."""

State = TypeVar("State")


class Searched(eqx.Module):
    """Shapes, ready to be searched.

    Attributes:
        groups: Of a scene.
        trees: Boxes around the shapes of each group; None where they are few, or have
            no boxes.
    """

    groups: tuple[Group, ...]
    trees: tuple[Hierarchy | None, ...]


def searched(groups: Sequence[Group]) -> Searched:
    """Make shapes ready."""
    return Searched(tuple(groups), tuple(_tree_of(group) for group in groups))


def _tree_of(group: Group) -> Hierarchy | None:
    group = jax.lax.stop_gradient(group)
    many = group.index.shape[0] > MANY
    hull = group.primitives.hull if many else None
    return None if hull is None else hierarchy_of(*hull.box(), group.index >= 0)


def first_met(
    world: Searched, rays: Ray, cast: Bool[Array, " n"]
) -> tuple[Float[Array, " n"], Int[Array, " n"]]:
    """Find what rays meet first.

    Args:
        world: Shapes in the frame of the rays.
        rays: (n,).
        cast: Whether each is cast at all; it meets nothing if not.

    Returns:
        The ray parameters, `+inf` where nothing is met, and the codes, below 0 there.
    """
    world, rays = jax.lax.stop_gradient((world, rays))
    stride = stride_of(world.groups)
    t = jnp.where(cast, jnp.inf, -jnp.inf).astype(rays.direction.x.dtype)
    code = jnp.full(cast.shape, -stride, jnp.int32)

    def meet(
        found: tuple[Array, Array],
        place: Int[Array, "..."],
        hit: Hit,
        meets: Bool[Array, "..."],
    ) -> tuple[Array, Array]:
        t, code = found
        nearer = meets & (hit.t < t)
        return jnp.where(nearer, hit.t, t), jnp.where(
            nearer, code_of(place, hit, stride), code
        )

    t, code = _after_all(world, rays, (t, code), lambda found: found[0], meet)
    return checkpoint_name((jnp.where(cast, t, jnp.inf), code), SEARCHED)


def is_blocked(
    world: Searched, rays: Ray, reach: Float[Array, " n"]
) -> Bool[Array, " n"]:
    """Tell whether anything is in the way of rays.

    Args:
        world: Shapes in the frame of the rays.
        rays: (n,).
        reach: Ray parameter before which it has to be; not positive of a ray that is
            not cast at all, which nothing blocks.
    """
    world, rays, reach = jax.lax.stop_gradient((world, rays, reach))

    def meet(
        left: Float[Array, " n"], _: Array, hit: Hit, meets: Bool[Array, "..."]
    ) -> Float[Array, " n"]:
        return jnp.where(meets & (hit.t < left), -jnp.inf, left)

    left = _after_all(world, rays, reach, lambda left: left, meet)
    return checkpoint_name(left < reach, SEARCHED)


def _after_all(
    world: Searched,
    rays: Ray,
    state: State,
    reach_of: Callable[[State], Float[Array, " n"]],
    meet: Callable[[State, Array, Hit, Bool[Array, " n"]], State],
) -> State:
    """The states after all shapes of all groups."""
    if rays.direction.x.shape[0] == 0:
        return state
    first = 0
    for group, tree in zip(world.groups, world.trees, strict=True):

        def at_members(state, ray, member, meets, group=group, first=first):
            shape = jax.tree.map(lambda x: x[member], group.primitives)
            hit = computed_apart(lambda: shape.intersect(ray), ray.direction.z)
            return meet(state, first + member, hit, meets)

        if tree is None:
            state = _one_by_one(group, rays, state, reach_of, at_members)
        else:
            state = walk(tree, rays, state, reach_of, at_members)
        first += group.index.shape[0]
    return state


def _one_by_one(
    group: Group,
    rays: Ray,
    state: State,
    reach_of: Callable[[State], Float[Array, " n"]],
    at_members: Callable[..., Any],
) -> State:
    """The states after each shape of a group, for so many rays at a time."""
    count = jnp.sum(group.index >= 0, dtype=jnp.int32)
    size = rays.direction.x.shape[0]
    together = min(size, TOGETHER)

    def chunks(x: Array) -> Array:
        return jnp.pad(x, (0, -size % together), mode="edge").reshape(-1, together)

    def at_rays(given: tuple[Ray, State]) -> State:
        ray, state = given

        def at_shape(member: Int[Array, ""], state: State) -> State:
            return at_members(state, ray, member, jnp.array(True))

        # Rays that are not cast lie together.
        turns = jnp.where(jnp.any(reach_of(state) > 0), count, 0)
        return jax.lax.fori_loop(0, turns, at_shape, state)

    states = jax.lax.map(at_rays, jax.tree.map(chunks, (rays, state)))
    return jax.tree.map(lambda x: x.reshape(-1)[:size], states)
