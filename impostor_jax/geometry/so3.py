"""Rotations and directions."""

__all__ = ["tangent_basis"]

import jax.numpy as jnp
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
