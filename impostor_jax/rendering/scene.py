"""Any mix of shapes; the closest surface is seen.

Types that a scene does not hold are in no program.
"""

__all__ = ["Scene", "Shown"]

import functools
import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.base import (
    AbstractPrimitive,
    check_shapes,
    in_camera_frame,
)
from impostor_jax.rendering.follow import code_of, followed, normals_of, stride_of
from impostor_jax.rendering.group import Group, grouped
from impostor_jax.rendering.search import first_met, is_blocked, searched


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
        check_shapes(shapes)
        if not sum(shape.batch_shape == () or shape.batch_shape[0] for shape in shapes):
            raise ValueError("shapes must hold at least one primitive, got none")
        self.groups = grouped(shapes)

    @property
    def dtype(self) -> np.dtype:
        """Floating-point type of the fields."""
        return self.groups[0].primitives.dtype

    def intersect(self, ray: Ray) -> Hit:
        """First surface of any shape in front of the rays' origins.

        Args:
            ray: Of any origins and directions in the world frame, in any number and
                shape, which need have nothing to do with each other. (`render` is
                faster for those of a camera.) What is not finite meets nothing.

        Returns:
            As of a shape; `index` tells which shape it is, -1 where nothing is met.

        Derivatives:
            Of t, as those of the shape that is met.
        """
        flat, shape = _flat(ray)
        t, code = first_met(searched(self.groups), flat, _reach(flat, jnp.inf))
        t, _ = followed((self.groups, flat), t, code)
        index, stride = self._index_of(code), stride_of(self.groups)
        part = jnp.where(code < 0, 0, code % stride)
        hit = Hit(t, part % 2 == 1, part // 2, index)
        return jax.tree.map(lambda x: x.reshape(shape), hit)

    def normal(self, ray: Ray, hit: Hit) -> Vec3:
        """Unit normals at the hits that `intersect` found, turned against the rays.

        Zero where nothing is hit.
        """
        assert hit.index is not None
        stride = stride_of(self.groups)
        place = self._place_of(hit.index)
        code = jnp.where(hit.mask, code_of(place, hit, stride), -stride)
        normal = normals_of(self.groups, ray, hit.t, code)
        _, normal = followed((self.groups, ray), hit.t, code, normal)
        assert normal is not None
        return normal

    def occluded(
        self, ray: Ray, t_max: float | Float[Array, "..."] = math.inf
    ) -> Bool[Array, "..."]:
        """Whether anything is in the way of rays. It has no derivative.

        Args:
            ray: As of `intersect`.
            t_max: Ray parameter before which it has to be.
        """
        flat, shape = _flat(ray)
        reach = jnp.broadcast_to(jnp.asarray(t_max, self.dtype), shape).reshape(-1)
        return is_blocked(searched(self.groups), flat, _reach(flat, reach)).reshape(
            shape
        )

    def _index_of(self, code: Int[Array, " n"]) -> Int[Array, " n"]:
        """Numbers of shapes by the codes of their hits."""
        given = jnp.concatenate([group.index for group in self.groups])
        place = jnp.maximum(code, 0) // stride_of(self.groups)
        return jnp.where(code < 0, -1, given[place])

    def _place_of(self, index: Int[Array, "..."]) -> Int[Array, "..."]:
        """Places of shapes by their numbers."""
        given = jnp.concatenate([group.index for group in self.groups])
        place = jnp.arange(given.shape[0], dtype=jnp.int32)
        put = jnp.where(given < 0, given.shape[0], given)
        places = jnp.zeros_like(place).at[put].set(place, mode="drop")
        return places[jnp.maximum(index, 0)]

    def transformed(self, target_from_source: RigidTransform) -> "Scene":
        """Express the shapes in another frame."""
        groups = tuple(group.transformed(target_from_source) for group in self.groups)
        return eqx.tree_at(lambda scene: scene.groups, self, groups)

    def seen_by(self, camera: AbstractCamera) -> "Scene":
        """Express the shapes in the frame of a camera."""
        moved = jax.vmap(lambda primitive: in_camera_frame(primitive, camera))
        groups = tuple(Group(moved(g.primitives), g.index) for g in self.groups)
        return eqx.tree_at(lambda scene: scene.groups, self, groups)


Shown = AbstractPrimitive | Scene
"""What can be rendered."""


def _flat(ray: Ray) -> tuple[Ray, tuple[int, ...]]:
    """Rays one after the other, and the shape that they had."""
    each = jnp.broadcast_arrays(*jax.tree.leaves(ray))
    flat = [x.reshape(-1) for x in each]
    return jax.tree.unflatten(jax.tree.structure(ray), flat), each[0].shape


def _reach(ray: Ray, most: float | Float[Array, " n"]) -> Float[Array, " n"]:
    """How far rays are cast: those that are not finite, not at all."""
    finite = [jnp.isfinite(x) for x in jax.tree.leaves(ray)]
    reach = jnp.where(functools.reduce(jnp.logical_and, finite), most, -jnp.inf)
    return reach.astype(ray.direction.x.dtype)
