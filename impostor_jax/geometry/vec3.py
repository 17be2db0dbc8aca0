"""A vector as three arrays.

The pixel loop keeps x, y and z in arrays of their own (structure of arrays): a formula
written for one ray is elementwise over any batch, and XLA fuses it into one loop.
Measured on 640x480 rays: 0.9 ms against 14 ms for arrays of shape (H, W, 3).
"""

__all__ = ["Vec3", "unit"]

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.numerics import eps, safe_divide, safe_sqrt


class Vec3(eqx.Module):
    """Three components of one shape; arithmetic is elementwise."""

    x: Float[Array, "*batch"]
    y: Float[Array, "*batch"]
    z: Float[Array, "*batch"]

    @staticmethod
    def from_array(
        vectors: Float[Array, "*batch 3"] | Float[np.ndarray, "*batch 3"],
    ) -> "Vec3":
        """Take the last axis apart."""
        vectors = jnp.asarray(vectors)
        return Vec3(vectors[..., 0], vectors[..., 1], vectors[..., 2])

    def stack(self) -> Float[Array, "*batch 3"]:
        """Put the components side by side in a last axis.

        Chosen by an index and not concatenated, since XLA fuses this into one loop with
        what made the components: 1.9 ms against 2.4 ms for a whole 640x480 normal map.
        """
        component = jnp.arange(3).reshape((1,) * self.x.ndim + (3,))
        x, y, z = self.x[..., None], self.y[..., None], self.z[..., None]
        return jnp.where(component == 0, x, jnp.where(component == 1, y, z))

    def planes(self) -> Float[Array, " 3 *batch"]:
        """Put the components one after the other in a first axis.

        Chosen by an index as `stack` does, so that what made them is compiled once and
        not once for each; it is computed three times in either way.
        """
        component = jnp.arange(3).reshape((3,) + (1,) * self.x.ndim)
        x, y, z = self.x[None], self.y[None], self.z[None]
        return jnp.where(component == 0, x, jnp.where(component == 1, y, z))

    def __add__(self, other: "Vec3") -> "Vec3":
        return Vec3(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: "Vec3") -> "Vec3":
        return Vec3(self.x - other.x, self.y - other.y, self.z - other.z)

    def __neg__(self) -> "Vec3":
        return Vec3(-self.x, -self.y, -self.z)

    def __mul__(self, factor: float | Float[Array, "*#batch"]) -> "Vec3":
        return Vec3(self.x * factor, self.y * factor, self.z * factor)

    def dot(self, other: "Vec3") -> Float[Array, "*batch"]:
        """Scalar product."""
        return self.x * other.x + self.y * other.y + self.z * other.z

    def cross(self, other: "Vec3") -> "Vec3":
        """Vector product."""
        return Vec3(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )

    def norm(self) -> Float[Array, "*batch"]:
        """Length; its derivative at the zero vector is 0."""
        return safe_sqrt(self.dot(self))

    def length(self) -> Float[Array, "*batch"]:
        """`norm` of a vector of any size: no square under- or overflows."""
        largest = jnp.maximum(jnp.maximum(abs(self.x), abs(self.y)), abs(self.z))
        largest = jax.lax.stop_gradient(jnp.where(largest > 0, largest, 1))
        return (self * (1 / largest)).norm() * largest

    def normalize(self) -> "Vec3":
        """Scale to length 1; the zero vector stays as it is, with derivative 0."""
        length = self.norm()
        return self * safe_divide(jnp.ones_like(length), length)

    def unit(self) -> "Vec3":
        """Direction of what was made a unit vector, and an optimizer may have changed.

        What is of length 1 to rounding keeps every bit, so that this may be asked of it
        again and again. The derivative is the direction's: 0 along the vector.
        """
        return _unit(self)

    def where(self, mask, other: "Vec3") -> "Vec3":
        """Take this vector where `mask` holds and `other` elsewhere."""
        return Vec3(
            jnp.where(mask, self.x, other.x),
            jnp.where(mask, self.y, other.y),
            jnp.where(mask, self.z, other.z),
        )


@jax.jit
def unit(vectors: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """`Vec3.unit` of arrays."""
    return Vec3.from_array(vectors).unit().stack()


def _to_unit(v: Vec3) -> Float[Array, "*batch"]:
    """What brings a vector to length 1; exactly 1 where rounding alone is missing."""
    squares = v.dot(v)
    # A unit vector that was made one, or rotated, is within 8 of these.
    is_unit = jnp.abs(squares - 1) <= eps(squares.dtype, 16)
    return jnp.where(is_unit | (squares == 0), 1, jax.lax.rsqrt(squares))


@jax.custom_jvp
def _unit(v: Vec3) -> Vec3:
    return v * _to_unit(v)


@_unit.defjvp
def _unit_jvp(primals, tangents):
    (v,), (change,) = primals, tangents
    u = _unit(v)
    return u, (change - u * u.dot(change)) * _to_unit(v)
