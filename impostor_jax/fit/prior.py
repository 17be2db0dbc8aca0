"""What is known of a shape before the image: normal priors on its parameters."""

__all__ = ["Prior", "prior_residuals", "scale_left"]

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.body import AbstractBody
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.sensor.bias import Bias

Numbers = Float[Array, "..."] | Float[np.ndarray, "..."]
Belief = tuple[Numbers, Numbers]

OWN = {"size": "edges"}
"""Names that a body has for what a caller calls otherwise."""


class Prior(eqx.Module):
    """Expected value and standard deviation of each parameter; None where unknown.

    Attributes:
        center: (3,) and a standard deviation in every direction, in meters.
        axis: (3,), of unit length and either sign, and the standard deviation of its
            angle in each of the two directions across it, in radians.
        radius: Of a cylinder or a sphere, in meters.
        radius1: Of a frustum at p1, in meters.
        radius2: Of a frustum at p2, in meters.
        outer_radius: Of a tube, in meters.
        inner_radius: Of its bore, in meters.
        height: In meters.
        size: Of a box, along its edges, in meters.
    """

    center: Belief | None = None
    axis: Belief | None = None
    radius: Belief | None = None
    radius1: Belief | None = None
    radius2: Belief | None = None
    outer_radius: Belief | None = None
    inner_radius: Belief | None = None
    height: Belief | None = None
    size: Belief | None = None

    @property
    def tells(self) -> Bool[Array, ""]:
        """Whether anything is expected."""
        beliefs = (getattr(self, field.name) for field in dataclasses.fields(self))
        widths = [jnp.asarray(belief[1]) for belief in beliefs if belief is not None]
        return jnp.any(jnp.isfinite(jnp.stack(widths))) if widths else jnp.array(False)

    def transformed(self, target_from_source: RigidTransform) -> "Prior":
        """Express the same in another frame, as of a camera."""
        move = target_from_source
        center, axis = self.center, self.axis
        if center is not None:
            center = (move.apply(jnp.asarray(center[0])), center[1])
        if axis is not None:
            axis = (move.rotate(jnp.asarray(axis[0])), axis[1])
        return dataclasses.replace(self, center=center, axis=axis)


def prior_residuals(
    prior: Prior, body: AbstractBody, bias: Bias | None = None
) -> Float[Array, " n"]:
    """Body less its expected value, in standard deviations.

    Where all depths share an error of scale, a body is as the sensor shows it: larger
    than it is, and farther away, by a factor that nobody knows. The residuals share its
    error, of which they are whitened.

    Args:
        prior: In the frame of the body.
        body: The body.
        bias: Of the sensor; None, as if it had none.
    """
    if bias is None or not bias.scales:
        return _residuals(prior, body)
    residual, slope = _by_scale(prior, body, bias)
    squares = jnp.sum(slope**2)
    # Times the inverse root of I + slope slope^T.
    root = jnp.sqrt(1 + squares)
    return residual - slope * (jnp.sum(slope * residual) / (root * (1 + root)))


def scale_left(
    prior: Prior, body: AbstractBody, bias: Bias
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """How much larger a body is than the sensor shows it, and how sure that is.

    Returns:
        The expected value of the logarithm of the factor, and its standard deviation
        where the body that is shown is known.
    """
    residual, slope = _by_scale(prior, body, bias)
    deviation, variance = bias.scale_at(body.center[2]), 1 + jnp.sum(slope**2)
    expected = -deviation * jnp.sum(slope * residual) / variance
    return expected, deviation * jax.lax.rsqrt(variance)


def _by_scale(
    prior: Prior, body: AbstractBody, bias: Bias
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Residuals, and their change by a standard deviation of the scale."""
    deviation = bias.scale_at(body.center[2])
    return jax.jvp(
        lambda change: _residuals(prior, body.magnified(change)),
        (jnp.zeros_like(deviation),),
        (deviation,),
    )


def _residuals(prior: Prior, body: AbstractBody) -> Float[Array, " n"]:
    parts = [jnp.zeros(0, body.radius.dtype)]
    for name in (field.name for field in dataclasses.fields(prior)):
        belief = getattr(prior, name)
        if belief is None:
            continue
        value, (expected, deviation) = getattr(body, OWN.get(name, name)), belief
        # Of an axis the length is the sine of the angle, and either sign will do.
        off = jnp.cross(expected, value) if name == "axis" else value - expected
        parts.append(jnp.atleast_1d(off) / deviation)
    return jnp.concatenate(parts)
