"""What every outline promises: a closed curve on a convex body.

To first order an outline moves as the body's points that make it do: it glides over the
body only along the rays or along itself. So a point of the curve is found in two parts:
its place on the body, which is held constant, and where the body has that place.
"""

__all__ = ["AbstractOutline", "Place"]

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from impostor_jax.compiling import compiled
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import product

Place = tuple[Float[Array, "*batch"], Float[Array, "*batch"], Float[Array, "*batch"]]
"""Coordinates of a point on a body, along the last three of its `vectors`."""


class AbstractOutline(eqx.Module):
    """Closed curve on a convex body whose image is the body's outline.

    It runs counterclockwise as the camera sees it. Make it with `outline`. Lengths are
    in meters, in the camera frame; a camera's `project` brings all points into its
    image, through a lens too.

    Attributes:
        clearance: Distance between camera and body at least; negative inside.

    Derivatives:
        A point keeps its place on the body. That is exact for how the outline moves
        along its normal.
    """

    clearance: eqx.AbstractVar[Float[Array, ""]]

    @property
    @abc.abstractmethod
    def radius(self) -> Float[Array, ""]:
        """Radius of the body."""

    @property
    @abc.abstractmethod
    def deepest(self) -> Vec3:
        """Point of the body with the largest depth."""

    @abc.abstractmethod
    def vectors(self) -> Float[Array, "4 3"]:
        """Center of the body, and three vectors that turn and grow with it."""

    @abc.abstractmethod
    def place(self, parameter: Float[Array, "*batch"]) -> Place:
        """Where on the body a point of the curve is; `parameter` is in [0, 4]."""

    @property
    def inside(self) -> Bool[Array, ""]:
        """Whether the camera is in the body and sees no outline."""
        return self.clearance < 0

    @compiled
    def at(self, parameter: Float[Array, "*batch"]) -> Float[Array, "*batch 3"]:
        """Point of the curve; `parameter` as in `place`."""
        return self.point(*self.place(parameter))

    def point(
        self,
        first: Float[Array, "*batch"],
        second: Float[Array, "*batch"],
        third: Float[Array, "*batch"],
    ) -> Float[Array, "*batch 3"]:
        """Point of the body at a place, as `place` gives it, that is held constant."""
        place = jnp.stack([jnp.ones_like(first), first, second, third], axis=-1)
        place = jax.lax.stop_gradient(place)
        # One product, whose derivative is one product too.
        return product(place, self.vectors())

    def tangent(self, parameter: Float[Array, "*batch"]) -> Float[Array, "*batch 3"]:
        """Derivative of the point of the curve by the parameter, the body held."""
        _, change = jax.jvp(self.place, (parameter,), (jnp.ones_like(parameter),))
        place = jnp.stack([jnp.zeros_like(parameter), *change], axis=-1)
        return product(place, self.vectors())

    def points(self, count: int = 360) -> Float[Array, "{count} 3"]:
        """Points of the closed curve in order, at equal steps of the parameter.

        `camera.project` brings them into an image, through a lens too.
        """
        steps = jnp.arange(count, dtype=self.clearance.dtype)
        return self.at(steps * (4 / count))
