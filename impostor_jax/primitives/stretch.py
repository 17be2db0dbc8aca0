"""Stretches of a ray in a solid: where it enters and leaves, and through what.

`Interval` says how far a stretch goes. What solids are made of tells more: the piece of
the surface at either end, and how steeply the ray crosses it, since a surface that is
off by a rounding moves the end of a stretch by that over the slope.
"""

__all__ = ["End", "Stretch", "slope_of"]

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3


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
        return End(
            jnp.where(mask, self.t, other.t),
            jnp.where(mask, self.part, other.part),
            jnp.where(mask, self.on_cap, other.on_cap),
            jnp.where(mask, self.slope, other.slope),
        )


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

    def holds(self, t: Float[Array, "*batch"]) -> Bool[Array, "*batch"]:
        """Whether a place of the ray is in it."""
        return (self.enter.t < t) & (t < self.leave.t)


def slope_of(ray: Ray, n: Vec3) -> Float[Array, "*batch"]:
    """How fast a ray crosses a surface with the unit normal n."""
    return jnp.abs(n.dot(ray.direction))
