"""Rigid transforms between named frames.

A transform is called `target_from_source`, so that neighboring names in a product
match: `camera_from_rig @ rig_from_world`.

One that reaches far, as a pose in map coordinates does, keeps the digits that it was
given with: two large numbers that nearly cancel are subtracted when it is applied.
"""

__all__ = ["RigidTransform", "moved_by", "unmoved"]

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from impostor_jax.arguments import (
    check_rotation,
    float_array,
    is_concrete,
    is_exact,
    place_of,
)
from impostor_jax.geometry.so3 import rotation_by
from impostor_jax.numerics import product

Points = Float[Array, "*batch 3"] | Float[np.ndarray, "*batch 3"]
"""In meters; NumPy's where they lie far from the origin, in double precision."""


class RigidTransform(eqx.Module):
    """Rotation followed by a translation, in meters.

    Concrete numbers of a translation of `FAR` or more stay in double precision, as
    NumPy arrays, and so does what such a transform makes of concrete points.

    Args:
        rotation: (3, 3), orthogonal with determinant 1 to within 1e-3.
        translation: (3,), in meters.
    """

    rotation: Float[Array, "3 3"] | Float[np.ndarray, "3 3"]
    translation: Float[Array, "3"] | Float[np.ndarray, "3"]

    def __init__(self, rotation: Any, translation: Any):
        self.rotation = float_array("rotation", rotation, (3, 3))
        self.translation = float_array("translation", translation, (3,), "meters")
        check_rotation("rotation", self.rotation)
        place = place_of(translation, self.translation)
        if is_exact(place) and is_concrete(rotation):
            # A rotation that is rounded turns what is far by as much as it rounds that.
            self.rotation = np.array(rotation, np.float64)
            self.translation = place

    @property
    def is_exact(self) -> bool:
        """Whether it reaches far, and has all the digits that it was given with."""
        return is_exact(self.translation)

    @staticmethod
    def of(value: Any) -> "RigidTransform | None":
        """Read a transform or a homogeneous (4, 4) matrix; None stays."""
        if value is None or isinstance(value, RigidTransform):
            return value
        return RigidTransform.from_matrix(value)

    @staticmethod
    def from_matrix(matrix: Any) -> "RigidTransform":
        """Read a homogeneous (4, 4) matrix with last row 0 0 0 1."""
        values = float_array("matrix", matrix, (4, 4))
        if is_concrete(values) and not np.allclose(values[3], [0, 0, 0, 1]):
            raise ValueError(
                f"matrix must end in the row 0 0 0 1, got {np.asarray(values[3])}"
            )
        if is_concrete(matrix) and not isinstance(matrix, jax.Array):
            # Not rounded yet.
            values = np.asarray(matrix)
        return RigidTransform(values[:3, :3], values[:3, 3])

    def apply(self, points: Points) -> Points:
        """Map points from the source frame to the target frame."""
        if self._is_exact_with(points, points):
            rotation, translation = self._in_double()
            moved = np.asarray(points, np.float64) @ rotation.T + translation
            return place_of(moved, jnp.asarray(moved))
        points = jnp.asarray(points)
        offset = self.translation.astype(points.dtype)
        return self.rotate(points) + jnp.broadcast_to(offset, points.shape)

    def rotate(self, vectors: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
        """Map directions from the source frame to the target frame."""
        rotation = self.rotation.astype(vectors.dtype)
        # On a GPU the default precision of a product is that of 10-bit mantissas.
        return jnp.einsum("ij,...j->...i", rotation, vectors, precision="highest")

    def inverse(self) -> "RigidTransform":
        """Return the transform from the target frame to the source frame."""
        if self.is_exact and is_concrete(self.rotation):
            # Not the transpose: of a rotation of few digits that is another one.
            back = np.linalg.inv(np.asarray(self.rotation, np.float64))
            return RigidTransform(back, -back @ self.translation)
        back = self.rotation.T
        return RigidTransform(
            back, -jnp.einsum("ij,j->i", back, self.translation, precision="highest")
        )

    def __matmul__(self, other: "RigidTransform") -> "RigidTransform":
        if self._is_exact_with(other.translation, other):
            turned, moved = self._in_double()
            rotation, translation = other._in_double()
            return RigidTransform(turned @ rotation, turned @ translation + moved)
        return RigidTransform(
            product(jnp.asarray(self.rotation), jnp.asarray(other.rotation)),
            self.apply(other.translation),
        )

    def _is_exact_with(self, place: Any, all_of_it: Any) -> bool:
        """Whether it is to be computed in double precision, outside JAX."""
        is_far = self.is_exact or is_exact(place)
        return is_far and is_concrete((self, all_of_it))

    def _in_double(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
        return (
            np.asarray(self.rotation, np.float64),
            np.asarray(self.translation, np.float64),
        )


@functools.cache
def unmoved(dtype: DTypeLike) -> RigidTransform:
    """Pose of a camera whose frame is the world's."""
    with jax.ensure_compile_time_eval():
        return RigidTransform(np.eye(3, dtype=dtype), np.zeros(3, dtype))


def moved_by(motion: Float[Array, "6"]) -> RigidTransform:
    """A small turn, a vector in radians as of `rotation_by`, and then a shift."""
    turn, shift = jnp.split(motion, 2)
    return RigidTransform(rotation_by(turn), shift)
