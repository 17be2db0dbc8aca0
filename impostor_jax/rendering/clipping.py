"""Near and far: what of a scene a camera sees, by its depth.

The parameter of a camera's ray is the depth of its points. So each ray is made to start
at the near depth, by a sum of two terms, and what it meets is told from its own origin
again: a solid that is cut open there is seen from inside, like any that a camera is in.
What is met beyond the far depth is not seen, nor what lies behind that.
"""

__all__ = ["Clipping", "clipping_of"]

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from impostor_jax.arguments import is_concrete, real_number
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Scalar


class Clipping(eqx.Module):
    """The depths between which surfaces are seen.

    Attributes:
        near: Depth at which rays start; None for their origins.
        far: Depth beyond which nothing is seen; None where there is no end.
        by_range: Whether the depth is the range, as of a spherical projection.

    Derivatives:
        None in either depth: what is seen does not move with them.
    """

    near: Scalar | None
    far: Scalar | None
    by_range: bool = eqx.field(static=True)

    def started(self, ray: Ray) -> Ray:
        """A camera's rays, from the near depth on."""
        if self.near is None:
            return ray
        return Ray(ray.at(_like(self.near, ray.direction.z)), ray.direction)

    def depth(self, t: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Depths of what those rays meet, told from the camera; `+inf` where none."""
        if self.near is not None:
            t = t + _like(self.near, t)
        return t if self.far is None else jnp.where(t > _like(self.far, t), jnp.inf, t)

    def is_beyond(self, point: Vec3) -> Bool[Array, "*batch"]:
        """Whether points of the camera frame lie beyond the far depth."""
        depth = point.norm() if self.by_range else point.z
        if self.far is None:
            return jnp.zeros(depth.shape, bool)
        return depth > _like(self.far, depth)


def clipping_of(near: Any, far: Any, camera: AbstractCamera) -> Clipping | None:
    """Read the arguments `near` and `far`; None where neither takes anything away.

    Args:
        near: Depth in meters, not negative; None for none. It may be traced.
        far: Depth in meters, more than `near`; None or infinity for none. Likewise.
        camera: Of whose images it is the depth.

    Raises:
        ValueError: A depth is out of range.
    """
    if far is not None and not (isinstance(far, float) and far == math.inf):
        far = real_number("far", far, positive=True, unit="meters")
    else:
        far = None
    if near is not None:
        near = real_number("near", near, unit="meters")
        if is_concrete(near) and near < 0:
            raise ValueError(
                "near must not be negative, since rays start at depth 0, got "
                f"{near} meters; a camera farther back sees what is behind this one"
            )
    if near is None and far is None:
        return None
    if None not in (near, far) and is_concrete((near, far)) and far <= near:
        raise ValueError(f"far must be more than near, {near} meters, got {far}")
    # A whole number that is traced becomes a real one.
    near, far = (x if x is None or is_concrete(x) else x * 1.0 for x in (near, far))
    return Clipping(near, far, camera.projection == "spherical")


def _like(depth: Scalar, values: Array) -> Float[Array, ""]:
    """A depth in the type of some numbers, held."""
    return jax.lax.stop_gradient(jnp.asarray(depth, values.dtype))
