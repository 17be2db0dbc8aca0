"""Stretches of a ray in a solid: where it enters and leaves, and through what.

`Interval` says how far a stretch goes. What solids are made of tells more: the piece of
the surface at either end, and how steeply the ray crosses it, since a surface that is
off by a rounding moves the end of a stretch by that over the slope.
"""

__all__ = ["End", "Stretch"]

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


class End(eqx.Module):
    """Where a ray crosses the surface of a solid.

    Attributes:
        t: Ray parameter; infinite where a stretch has no end, or is empty.
        part: Which piece of the surface, as `Hit.part` tells.
        on_cap: As `Hit.on_cap`.
        slope: How fast the ray crosses it: unit normal times direction, not negative.
    """

    t: Float[Array, "*batch"]
    part: Int[Array, "*batch"]
    on_cap: Bool[Array, "*batch"]
    slope: Float[Array, "*batch"]

    def where(self, mask: Bool[Array, "*batch"], other: "End") -> "End":
        """Take this end where `mask` holds and the other elsewhere."""
        return jax.tree.map(lambda x, y: jnp.where(mask, x, y), self, other)


class Stretch(eqx.Module):
    """Stretch of a ray in a solid; it is empty, or a point, where it ends at its start.

    Attributes:
        enter: Where it begins.
        leave: Where it ends.
    """

    enter: End
    leave: End

    def where(self, mask: Bool[Array, "*batch"]) -> "Stretch":
        """Take the stretch where `mask` holds; elsewhere it is empty."""
        enter = jnp.where(mask, self.enter.t, jnp.inf)
        leave = jnp.where(mask, self.leave.t, -jnp.inf)
        return eqx.tree_at(lambda s: (s.enter.t, s.leave.t), self, (enter, leave))

    @property
    def crosses(self) -> Bool[Array, "*batch"]:
        """Whether there is any of it."""
        return self.enter.t <= self.leave.t
