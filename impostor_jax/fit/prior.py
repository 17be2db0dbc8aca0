"""What is known of a shape before the image: normal priors on its parameters."""

__all__ = ["Prior", "prior_residuals"]

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.fit.body import AbstractBody

Numbers = Float[Array, "..."] | Float[np.ndarray, "..."]
Belief = tuple[Numbers, Numbers]


class Prior(eqx.Module):
    """Expected value and standard deviation of each parameter; None where unknown.

    Attributes:
        center: (3,) and a standard deviation in every direction, in meters.
        axis: (3,), of unit length and either sign, and the standard deviation of its
            angle in each of the two directions across it, in radians.
        radius: Of a cylinder or a sphere, in meters.
        radius1: Of a frustum at p1, in meters.
        radius2: Of a frustum at p2, in meters.
        height: In meters.
    """

    center: Belief | None = None
    axis: Belief | None = None
    radius: Belief | None = None
    radius1: Belief | None = None
    radius2: Belief | None = None
    height: Belief | None = None

    def in_camera_frame(self, camera: AbstractCamera) -> "Prior":
        """Express a prior of the world in the frame of a camera."""
        move = camera.camera_from_world
        if move is None:
            return self
        center, axis = self.center, self.axis
        if center is not None:
            center = (move.apply(jnp.asarray(center[0])), center[1])
        if axis is not None:
            axis = (move.rotate(jnp.asarray(axis[0])), axis[1])
        return dataclasses.replace(self, center=center, axis=axis)


def prior_residuals(prior: Prior, body: AbstractBody) -> Float[Array, " n"]:
    """Body less its expected value, in standard deviations."""
    parts = [jnp.zeros(0, body.radius.dtype)]
    for name in (field.name for field in dataclasses.fields(prior)):
        belief = getattr(prior, name)
        if belief is None:
            continue
        value, (expected, deviation) = getattr(body, name), belief
        # Of an axis the length is the sine of the angle, and either sign will do.
        off = jnp.cross(expected, value) if name == "axis" else value - expected
        parts.append(jnp.atleast_1d(off) / deviation)
    return jnp.concatenate(parts)
