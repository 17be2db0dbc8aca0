"""Free coordinates of a cylinder around a reference, all of about one deviation.

The axis moves on the sphere in two tangent coordinates; the center moves across the
axis in two; the radius and the height are logarithms, so they stay positive; and the
two ends move along the axis. The ends, not center and height, are the coordinates:
where an end is not seen, exactly one coordinate has no effect on the residuals. Every
coordinate is scaled by about its standard deviation, since Levenberg-Marquardt damps
with the identity.
"""

__all__ = ["PARAMETERS", "Chart", "Coordinates"]

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.geometry.so3 import move_on_sphere, tangent_basis
from impostor_jax.primitives.cylinder import Cylinder

PARAMETERS = ("center", "axis", "radius", "height")
"""Names that `fixed` may hold."""


class Coordinates(eqx.Module):
    """Displacement from the reference, in natural units; 0 where held.

    Attributes:
        axis: Tangent coordinates in radians.
        across: Center across the axis in meters, along `tangent_basis(axis)`.
        log_radius: Change of the logarithm of the radius.
        lower: Move of the end at `center - axis * height / 2` along the axis, in
            meters.
        upper: Move of the other end.
    """

    axis: Float[Array, "2"]
    across: Float[Array, "2"]
    log_radius: Float[Array, ""]
    lower: Float[Array, ""]
    upper: Float[Array, ""]


class Chart(eqx.Module):
    """Map from a vector of scaled free coordinates to a cylinder.

    Attributes:
        reference: Cylinder at the zero vector.
        unit: About ten standard deviations of a position, in meters.
        fixed: Names of the parameters that do not move.
    """

    reference: Cylinder
    unit: Float[Array, ""]
    fixed: tuple[str, ...] = eqx.field(static=True)

    @property
    def size(self) -> int:
        """Number of free coordinates."""
        lengths = {"center": 3, "axis": 2, "radius": 1, "height": 1}
        return 7 - sum(lengths[name] for name in self.fixed)

    def coordinates(self, vector: Float[Array, " n"]) -> Coordinates:
        """Take a scaled vector apart; linear."""
        rest = list(vector * self.unit)
        zero = jnp.zeros_like(self.unit)
        axis = across = (zero, zero)
        log_radius = zero
        if "axis" not in self.fixed:
            reach = (self.reference.height + self.reference.radius) / 2
            axis = (rest.pop(0) / reach, rest.pop(0) / reach)
        if "center" not in self.fixed:
            across = (rest.pop(0), rest.pop(0))
        if "radius" not in self.fixed:
            log_radius = rest.pop(0) / self.reference.radius
        # One end or both: a fixed height moves them together, a fixed center apart.
        lower = upper = zero
        if "center" not in self.fixed:
            lower = upper = rest.pop(0)
        if "height" not in self.fixed:
            upper = rest.pop(0)
            lower = -upper if "center" in self.fixed else lower
        return Coordinates(jnp.stack(axis), jnp.stack(across), log_radius, lower, upper)

    def cylinder(self, vector: Float[Array, " n"]) -> Cylinder:
        """Cylinder at a scaled vector."""
        move, start = self.coordinates(vector), self.reference
        first, second = tangent_basis(start.axis)
        center = start.center + (
            move.across[0] * first
            + move.across[1] * second
            + (move.lower + move.upper) / 2 * start.axis
        )
        growth = (move.upper - move.lower) / start.height
        return eqx.tree_at(
            lambda c: (c.center, c.axis, c.radius, c.height),
            start,
            (
                center,
                move_on_sphere(start.axis, move.axis),
                start.radius * jnp.exp(move.log_radius),
                start.height * jnp.exp(growth),
            ),
        )
