"""Which depths of a scene are those of a surface."""

__all__ = ["has_surface"]

import jax.numpy as jnp
from jaxtyping import Array, Bool

from impostor_jax.numerics import Numbers


def has_surface(depth: Numbers) -> Bool[Array, "*batch"]:
    """Whether a depth is one that a sensor can read."""
    return jnp.isfinite(depth) & (depth > 0)
