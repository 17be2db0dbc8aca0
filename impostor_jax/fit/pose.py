"""Poses of what is fitted: the frame at a shape's center, with z along its axis."""

__all__ = ["Pose", "in_double", "pose_from_camera", "pose_of"]

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.arguments import is_exact
from impostor_jax.geometry.frames import Points, RigidTransform
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.geometry.vec3 import unit
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.tube import as_tube

Pose = Float[Array, "*batch 4 4"] | Float[np.ndarray, "*batch 4 4"]


def pose_of(shape: AbstractPrimitive) -> Pose:
    """Matrix to the world from the frame of a shape, or of each of a batch.

    The origin is the center, of a frustum the middle between its ends; z is the axis,
    and x and y are the two vectors of `tangent_basis(axis)`. A sphere has no axis: its
    frame has that of the world. A box has its own.

    Args:
        shape: A box, a cylinder, a frustum, a sphere or a tube.

    Raises:
        ValueError: It is another shape.
    """
    if isinstance(shape, Sphere):
        rotation = jnp.broadcast_to(
            jnp.eye(3, dtype=shape.dtype), (*shape.batch_shape, 3, 3)
        )
        return _homogeneous(rotation, shape.center)
    if isinstance(shape, Box):
        return _homogeneous(shape.rotation, shape.center)
    if isinstance(shape, Frustum):
        center, axis = (shape.p1 + shape.p2) / 2, shape.axis
    elif isinstance(shape, Cylinder):
        center, axis = shape.center, unit(shape.axis)
    else:
        held = as_tube(shape)
        center, axis = held.center, held.axis
    across = jnp.vectorize(tangent_basis, signature="(n)->(m,n)")(axis)
    rows = jnp.concatenate([across, axis[..., None, :]], axis=-2)
    return _homogeneous(jnp.swapaxes(rows, -1, -2), center)


def pose_from_camera(pose: Pose, camera_from_world: RigidTransform | None) -> Pose:
    """Matrix to the camera, of that to the world.

    Args:
        pose: As of `pose_of`.
        camera_from_world: Pose of the camera; None where it is the world.
    """
    if camera_from_world is None:
        return pose
    axes = camera_from_world.rotate(jnp.swapaxes(pose[..., :3, :3], -1, -2))
    center = camera_from_world.apply(pose[..., :3, 3])
    return _homogeneous(jnp.swapaxes(axes, -1, -2), center)


def in_double(
    move: RigidTransform | None,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Rotation and translation of a pose, for NumPy; those of None move nothing."""
    if move is None:
        return np.eye(3), np.zeros(3)
    return np.asarray(move.rotation, float), np.asarray(move.translation, float)


def _homogeneous(rotation: Float[Array, "*batch 3 3"], center: Points) -> Pose:
    if is_exact(center):
        matrix = np.broadcast_to(np.eye(4), (*center.shape[:-1], 4, 4)).copy()
        matrix[..., :3, :3], matrix[..., :3, 3] = rotation, center
        return matrix
    upper = jnp.concatenate([rotation, center[..., None]], axis=-1)
    last = jnp.zeros_like(upper[..., :1, :]).at[..., 3].set(1)
    return jnp.concatenate([upper, last], axis=-2)
