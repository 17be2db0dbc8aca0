"""Free coordinates of a cylinder around a reference.

The axis moves on the sphere in two tangent coordinates, the center moves across the
axis in two, radius and height are logarithms, so they stay positive, and the two ends
move along the axis. The ends, not center and height, are the coordinates: where an end
is not seen, exactly one coordinate has no effect on the residuals.
"""

__all__ = ["COORDINATES", "PARAMETERS", "Chart"]

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.primitives.cylinder import Cylinder

PARAMETERS = ("center", "axis", "radius", "height")
"""Names that `fixed` may hold."""

COORDINATES = (
    "axis_first",
    "axis_second",
    "center_first",
    "center_second",
    "center_along",
    "radius",
    "height",
)
"""Tangent coordinates of a covariance, in radians and meters.

Those called first and second are along the two vectors of `tangent_basis(axis)`.
"""


class Chart(eqx.Module):
    """Map from a vector of scaled free coordinates to a cylinder.

    Attributes:
        reference: Cylinder at the zero vector.
        scale: Natural coordinates that one unit of each free coordinate moves: of the
            axis along the two vectors of `tangent_basis(axis)`, of the center along
            them, of the logarithm of the radius, and of the lower and the upper end
            along the axis.
        motion: Linear map from natural coordinates to changes of center, axis,
            logarithm of radius and logarithm of height.
    """

    reference: Cylinder
    scale: Float[Array, "7 n"]
    motion: Float[Array, "8 7"]

    @staticmethod
    def around(
        reference: Cylinder,
        unit: Float[Array, ""],
        end_unit: Float[Array, ""],
        fixed: tuple[str, ...],
    ) -> "Chart":
        """Chart whose free coordinates all move the surface by about `unit`.

        Levenberg-Marquardt damps with the identity, so the scales must match.

        Args:
            reference: Cylinder at the zero vector, in the world frame.
            unit: In meters.
            end_unit: The same of the two ends, which a pixel's size may blur more than
                the noise does the wall.
            fixed: Names of the parameters that do not move.
        """
        r, h, a = reference.radius, reference.height, reference.axis
        one, lever = unit * jnp.ones_like(r), unit * 2 / (h + r)
        ends = [end_unit * jnp.ones_like(r)] * 2
        sizes = jnp.stack([lever, lever, one, one, unit / r, *ends])
        scale = jnp.asarray(_free_directions(fixed), r.dtype) * sizes[:, None]
        basis, zero = tangent_basis(a).T, jnp.zeros((3, 1), r.dtype)
        along, still = a[:, None] / 2, jnp.zeros((3, 2), r.dtype)
        motion = jnp.concatenate(
            [
                jnp.concatenate([still, basis, zero, along, along], axis=1),
                jnp.concatenate([basis, still, zero, zero, zero], axis=1),
                jnp.array([[0, 0, 0, 0, 1, 0, 0]], r.dtype),
                jnp.array([[0, 0, 0, 0, 0, -1, 1]], r.dtype) / h,
            ]
        )
        return Chart(reference, scale, motion)

    @property
    def size(self) -> int:
        """Number of free coordinates."""
        return self.scale.shape[1]

    def natural(self) -> Float[Array, "8 7"]:
        """Derivative of center, axis, radius and height in the natural coordinates."""
        start = self.reference
        one = jnp.ones(6, start.radius.dtype)
        sizes = jnp.concatenate([one, jnp.stack([start.radius, start.height])])
        return sizes[:, None] * self.motion

    def cylinder(self, vector: Float[Array, " n"]) -> Cylinder:
        """Cylinder at a vector of scaled free coordinates."""
        natural = jnp.matmul(self.scale, vector, precision="highest")
        change = jnp.matmul(self.motion, natural, precision="highest")
        start = self.reference
        axis = start.axis + change[3:6]
        growth = jnp.exp(change[6:])
        return eqx.tree_at(
            lambda c: (c.center, c.axis, c.radius, c.height),
            start,
            (
                start.center + change[:3],
                axis * jax.lax.rsqrt(jnp.sum(axis * axis)),
                start.radius * growth[0],
                start.height * growth[1],
            ),
        )

    def quantities(self) -> Float[Array, "7 n"]:
        """Derivative of the cylinder's coordinates at the zero vector.

        In the order of `COORDINATES`: those of a covariance that a user reads.
        """
        lower, upper = self.scale[5], self.scale[6]
        return jnp.concatenate(
            [
                self.scale[:4],
                ((lower + upper) / 2)[None],
                (self.reference.radius * self.scale[4])[None],
                (upper - lower)[None],
            ]
        )


def _free_directions(fixed: tuple[str, ...]) -> Float[np.ndarray, "7 n"]:
    """Natural coordinates, or combinations of them, that are free to move."""
    first, second, across1, across2, radius, lower, upper = np.eye(7)
    free = []
    if "axis" not in fixed:
        free += [first, second]
    if "center" not in fixed:
        free += [across1, across2]
    if "radius" not in fixed:
        free += [radius]
    # A held height moves both ends together, a held center moves them apart.
    if "center" not in fixed and "height" not in fixed:
        free += [lower, upper]
    elif "center" not in fixed:
        free += [lower + upper]
    elif "height" not in fixed:
        free += [upper - lower]
    return np.stack(free, axis=1)
