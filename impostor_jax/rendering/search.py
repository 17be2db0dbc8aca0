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

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.compiling import computed_apart
from impostor_jax.device import is_processor
from impostor_jax.geometry.rays import Ray
from impostor_jax.rendering.follow import code_of, stride_of
from impostor_jax.rendering.group import Group
from impostor_jax.rendering.hierarchy import Hierarchy, hierarchy_of, walk

MANY = 128
"""Shapes of a type, and more, are put into boxes."""

TOGETHER = 8192
"""Rays that few shapes are cast at together: they stay in a processor's cache."""

SEARCHED = "searched"
"""Name of what is found, so that a derivative that computes all else anew keeps it."""

Found = tuple[Float[Array, " n"], Int[Array, " n"]]
"""Ray parameters and codes of what is met."""


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
    world: Searched,
    rays: Ray,
    reach: Float[Array, " n"],
    any_does: bool | Bool[Array, ""] = False,
) -> Found:
    """Find what rays meet first.

    Args:
        world: Shapes in the frame of the rays.
        rays: (n,).
        reach: Ray parameter before which it has to be; not positive of a ray that is
            not cast at all, which meets nothing.
        any_does: Whether anything that is met does, be it the first or not; `t` is
            `-inf` there.

    Returns:
        The ray parameters, `+inf` where nothing is met, and the codes, below 0 there.
    """
    world, rays, reach = jax.lax.stop_gradient((world, rays, reach))
    stride = stride_of(world.groups)
    found = reach, jnp.full(reach.shape, -stride, jnp.int32)
    if reach.shape[0] == 0:
        return found
    first = 0
    for group, tree in zip(world.groups, world.trees, strict=True):

        def at_members(found, ray, member, meets, group=group, first=first):
            shape = jax.tree.map(lambda x: x[member], group.primitives)

            def cast() -> tuple[Array, Array]:
                hit = shape.intersect(ray)
                return hit.t, code_of(first + member, hit, stride)

            new, own = computed_apart(cast, ray.direction.z)
            t, code = found
            nearer = meets & (new < t)
            # What need not be cast any farther ends its search.
            new = jnp.where(any_does, -jnp.inf, new)
            return jnp.where(nearer, new, t), jnp.where(nearer, own, code)

        if tree is None:
            found = _one_by_one(group, rays, found, at_members)
        else:
            found = walk(tree, rays, found, lambda found: found[0], at_members)
        first += group.index.shape[0]
    t, code = found
    return jnp.where(code < 0, jnp.inf, t), code


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
    _, code = first_met(world, rays, reach, any_does=True)
    return code >= 0


def _one_by_one(
    group: Group, rays: Ray, found: Found, at_members: Callable[..., Found]
) -> Found:
    """What is found after each shape of a group, for so many rays at a time."""
    count = jnp.sum(group.index >= 0, dtype=jnp.int32)
    size = rays.direction.x.shape[0]
    together = min(size, TOGETHER) if is_processor() else size

    def chunks(x: Array) -> Array:
        return jnp.pad(x, (0, -size % together), mode="edge").reshape(-1, together)

    def at_rays(given: tuple[Ray, Found]) -> Found:
        ray, found = given

        def at_shape(member: Int[Array, ""], found: Found) -> Found:
            return at_members(found, ray, member, jnp.array(True))

        # Rays that are not cast lie together.
        turns = jnp.where(jnp.any(found[0] > 0), count, 0)
        return jax.lax.fori_loop(0, turns, at_shape, found)

    after = jax.lax.map(at_rays, jax.tree.map(chunks, (rays, found)))
    return jax.tree.map(lambda x: x.reshape(-1)[:size], after)
