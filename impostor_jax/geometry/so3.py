"""Moving a unit vector on the sphere by two tangent coordinates, in radians."""

__all__ = ["move_on_sphere", "tangent_basis"]

import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.numerics import eps, safe_divide, safe_sqrt


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


def move_on_sphere(
    axis: Float[Array, "3"], tangent: Float[Array, "2"]
) -> Float[Array, "3"]:
    """Unit vector at the end of the great circle that leaves `axis` along `tangent`.

    Args:
        axis: Unit vector.
        tangent: Angles in radians along the two vectors of `tangent_basis(axis)`.
    """
    squared = jnp.sum(tangent * tangent)
    # Below this the series is exact to rounding, and its derivative exists at 0.
    small = squared < eps(squared.dtype) ** 0.5
    angle = safe_sqrt(jnp.where(small, 1, squared))
    cosine = jnp.where(small, 1 - squared / 2 + squared**2 / 24, jnp.cos(angle))
    sinc = jnp.where(small, 1 - squared / 6, safe_divide(jnp.sin(angle), angle))
    first, second = tangent_basis(axis)
    moved = cosine * axis + sinc * (tangent[0] * first + tangent[1] * second)
    return moved / jnp.sqrt(jnp.sum(moved * moved))
