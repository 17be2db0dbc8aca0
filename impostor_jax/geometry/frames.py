"""Rigid transforms between named frames.

A transform is called `target_from_source`, so that neighboring names in a product
match: `camera_from_rig @ rig_from_world`.
"""

__all__ = ["RigidTransform"]

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.arguments import check_rotation, float_array, is_concrete
from impostor_jax.numerics import product


class RigidTransform(eqx.Module):
    """Rotation followed by a translation, in meters.

    Args:
        rotation: (3, 3), orthogonal with determinant 1 to within 1e-3.
        translation: (3,), in meters.
    """

    rotation: Float[Array, "3 3"]
    translation: Float[Array, "3"]

    def __init__(self, rotation: Any, translation: Any):
        self.rotation = float_array("rotation", rotation, (3, 3))
        self.translation = float_array("translation", translation, (3,), "meters")
        check_rotation("rotation", self.rotation)

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
        return RigidTransform(values[:3, :3], values[:3, 3])

    def apply(self, points: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
        """Map points from the source frame to the target frame."""
        offset = self.translation.astype(points.dtype)
        return self.rotate(points) + jnp.broadcast_to(offset, points.shape)

    def rotate(self, vectors: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
        """Map directions from the source frame to the target frame."""
        rotation = self.rotation.astype(vectors.dtype)
        # On a GPU the default precision of a product is that of 10-bit mantissas.
        return jnp.einsum("ij,...j->...i", rotation, vectors, precision="highest")

    def inverse(self) -> "RigidTransform":
        """Return the transform from the target frame to the source frame."""
        back = self.rotation.T
        return RigidTransform(
            back, -jnp.einsum("ij,j->i", back, self.translation, precision="highest")
        )

    def __matmul__(self, other: "RigidTransform") -> "RigidTransform":
        return RigidTransform(
            product(self.rotation, other.rotation),
            self.apply(other.translation),
        )
