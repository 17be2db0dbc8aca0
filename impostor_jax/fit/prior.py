"""What is known of a cylinder before the image: normal priors on its parameters."""

__all__ = ["Prior", "prior_residuals"]

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.primitives.cylinder import Cylinder

Belief = tuple[Float[Array, "..."], Float[Array, ""]]


class Prior(eqx.Module):
    """Expected value and standard deviation of each parameter; None where unknown.

    Attributes:
        center: (3,) and a deviation in every direction, in meters.
        axis: (3,), of unit length and either sign, and the deviation of its angle in
            each of the two directions across it, in radians.
        radius: In meters.
        height: In meters.
    """

    center: Belief | None = None
    axis: Belief | None = None
    radius: Belief | None = None
    height: Belief | None = None

    def in_camera_frame(self, camera: AbstractCamera) -> "Prior":
        """Express a prior of the world in the frame of a camera."""
        move = camera.camera_from_world
        if move is None:
            return self
        center, axis = self.center, self.axis
        if center is not None:
            center = (move.apply(center[0]), center[1])
        if axis is not None:
            axis = (move.rotate(axis[0]), axis[1])
        return Prior(center, axis, self.radius, self.height)


def prior_residuals(prior: Prior, cylinder: Cylinder) -> Float[Array, " n"]:
    """Cylinder less its expected value, in standard deviations."""
    parts = [jnp.zeros(0, cylinder.radius.dtype)]
    if prior.center is not None:
        parts.append((cylinder.center - prior.center[0]) / prior.center[1])
    if prior.axis is not None:
        # Its length is the sine of the angle, and either sign of the axis will do.
        parts.append(jnp.cross(prior.axis[0], cylinder.axis) / prior.axis[1])
    if prior.radius is not None:
        parts.append(((cylinder.radius - prior.radius[0]) / prior.radius[1])[None])
    if prior.height is not None:
        parts.append(((cylinder.height - prior.height[0]) / prior.height[1])[None])
    return jnp.concatenate(parts)
