"""Rotations and directions."""

__all__ = ["directions_across", "rotation_by", "tangent_basis", "turn_of"]

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def tangent_basis(axis: Float[Array, "3"]) -> Float[Array, "2 3"]:
    """Two unit vectors that make a right-handed frame with the unit vector `axis`.

    They jump only where the z component changes sign.

    References:
        Duff et al. (2017), "Building an Orthonormal Basis, Revisited", listing 3.
    """
    x, y, z = axis[0], axis[1], axis[2]
    sign = jnp.where(z < 0, -1, 1).astype(axis.dtype)
    a = -1 / (sign + z)
    b = x * y * a
    first = jnp.stack([1 + sign * x * x * a, sign * b, -sign * x])
    second = jnp.stack([b, sign + y * y * a, -y])
    return jnp.stack([first, second])


def rotation_by(turn: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Rotation about a vector, by twice the arctangent of half its length.

    That is its length to third order, and smooth at 0, where the exponential has a
    square root.

    References:
        Cayley's transform; half the vector is that of Gibbs.
    """
    x, y, z = turn[0] / 2, turn[1] / 2, turn[2] / 2
    zero = jnp.zeros_like(x)
    cross = jnp.stack(
        [jnp.stack([zero, -z, y]), jnp.stack([z, zero, -x]), jnp.stack([-y, x, zero])]
    )
    half = turn / 2
    squares = jnp.sum(half**2)
    outer = half[:, None] * half[None]
    eye = jnp.eye(3, dtype=turn.dtype)
    return ((1 - squares) * eye + 2 * cross + 2 * outer) / (1 + squares)


def turn_of(rotation: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """The vector of `rotation_by`; infinite for a half turn."""
    r = rotation
    twice = jnp.stack([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    return 2 * twice / (1 + r[0, 0] + r[1, 1] + r[2, 2])


def directions_across(axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2 3"]:
    """Two unit vectors across an axis, and across each other, without a device."""
    x, y, z = axis.tolist()
    least = min(abs(x), abs(y), abs(z))
    # np.cross takes a tenth of a millisecond, and each wall asks several times.
    if abs(x) == least:
        length = math.hypot(y, z)
        first = (0.0, z / length, -y / length)
    elif abs(y) == least:
        length = math.hypot(x, z)
        first = (-z / length, 0.0, x / length)
    else:
        length = math.hypot(x, y)
        first = (y / length, -x / length, 0.0)
    u, v, w = first
    return np.array([first, (y * w - z * v, z * u - x * w, x * v - y * u)])
