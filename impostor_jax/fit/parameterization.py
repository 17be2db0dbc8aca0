"""Free coordinates of a body around a reference.

An axis moves on the sphere in two tangent coordinates, a center moves across the axis
in two, radii are logarithms, so they stay positive, and ends move along the axis.
"""

__all__ = ["Chart"]

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.fit.body import AbstractBody


class Chart(eqx.Module):
    """Map from a vector of scaled free coordinates to a body.

    Attributes:
        reference: AbstractBody at the zero vector.
        scale: Natural coordinates that one unit of each free coordinate moves.
        fixed: Names of the parameters that do not move.
    """

    reference: AbstractBody
    scale: Float[Array, "c n"]
    fixed: tuple[str, ...] = eqx.field(static=True)

    @staticmethod
    def around(
        reference: AbstractBody,
        unit: Float[Array, ""],
        end_unit: Float[Array, ""],
        fixed: tuple[str, ...],
    ) -> "Chart":
        """Chart whose free coordinates all move the surface by about `unit`.

        Levenberg-Marquardt damps with the identity, so the scales must match.

        Args:
            reference: AbstractBody at the zero vector, in the camera frame.
            unit: In meters.
            end_unit: The same of the two ends, which a pixel's size may blur more than
                the noise does the wall.
            fixed: Names of the parameters that do not move.
        """
        steps = reference.steps(unit, end_unit)
        free = jnp.asarray(reference.free_directions(fixed), steps.dtype)
        return Chart(reference, free * steps[:, None], fixed)

    @property
    def size(self) -> int:
        """Number of free coordinates."""
        return self.scale.shape[1]

    def body(self, vector: Float[Array, " n"]) -> AbstractBody:
        """Body at a vector of scaled free coordinates."""
        natural = jnp.matmul(self.scale, vector, precision="highest")
        return self.reference.moved(natural, self.fixed)

    def moving_numbers(self, body: AbstractBody) -> Float[Array, " p"]:
        """Numbers of a body of the chart that move, as `residuals` takes them."""
        return body.numbers[np.array(body.moving(self.fixed))]

    def natural(self) -> Float[Array, "p c"]:
        """Derivative of the moving numbers in the natural coordinates."""
        still = jnp.zeros(self.scale.shape[0], self.scale.dtype)

        def numbers(natural: Float[Array, " c"]) -> Float[Array, " p"]:
            return self.moving_numbers(self.reference.moved(natural, self.fixed))

        return jax.jacfwd(numbers)(still)
