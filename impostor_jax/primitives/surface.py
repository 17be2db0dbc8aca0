"""Where a ray meets a smooth surface: how the hit moves, and which way it faces.

The hit point p satisfies F(p, parameters) = 0. With n the gradient of F in p and d the
ray's direction, dt = -(dF at the held t) / (n . d), whatever formula t came from:
finite on every ray, and the same in forward and reverse mode.
"""

__all__ = ["facing", "hit_tangent", "within_range"]

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import smallest_slope

Values = TypeVar("Values")


def facing(n: Vec3, direction: Vec3, mask: Bool[Array, "*batch"]) -> Vec3:
    """Turn a normal against the ray's direction; zero where nothing is hit."""
    sign = jnp.where(n.dot(direction) > 0, -1.0, 1.0)
    return n * jnp.where(mask, sign, 0.0)


def hit_tangent(
    change: Float[Array, "*batch"],
    n_d: Float[Array, "*batch"],
    mask: Bool[Array, "*batch"],
) -> Float[Array, "*batch"]:
    """Change of the ray parameter: `change / n_d`; 0 on a miss and where n_d is 0.

    Args:
        change: -dF at the held t.
        n_d: Gradient of F times the ray's direction.
        mask: Whether the ray hits.
    """
    usable = mask & (jnp.abs(n_d) > smallest_slope(n_d.dtype))
    return jnp.where(usable, change / jnp.where(usable, n_d, 1), 0)


def within_range(
    values: Values,
    squares: Float[Array, "*batch"],
    radius: Float[Array, "*#batch"],
    n_d: Float[Array, "*batch"],
) -> Values:
    """Hold `values` constant where second derivatives of the hit leave the range.

    They grow as the lengths squared over r (n.d)^3; where that is more than a
    thousandth of the largest number, they are 0.

    Args:
        values: What the first derivative is made from.
        squares: Sum of the squares of the lengths involved.
        radius: Of the curvature; 1 for a plane.
        n_d: Unit normal times the ray's direction.
    """
    bend = radius * jnp.abs(n_d) ** 3
    bounded = 1 + squares < bend * (float(np.finfo(n_d.dtype).max) / 1024)
    return jax.tree.map(
        lambda x: jnp.where(bounded, x, jax.lax.stop_gradient(x)), values
    )
