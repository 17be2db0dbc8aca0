"""A fractal terrain: octaves of products of sines, each smaller and finer.

    height(x, z) = amplitude * sum_i gain^i sin(f_i x) sin(f_i z),
    f_i = frequency * lacunarity^i

An example of a height that is a function: its fields are leaves, so depth is
differentiable in them.
"""

__all__ = ["Terrain"]

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.numerics import Scalar


class Terrain(eqx.Module):
    """Sum of octaves over the plane y = 0.

    The defaults are those of the terrain that the marching settings of
    experiments/marching_trade were made for.

    Attributes:
        amplitude: Height of the first octave, in meters.
        frequency: Of the first octave, in radians per meter.
        gain: Amplitude of an octave over that of the one before.
        lacunarity: Frequency of an octave over that of the one before.
        octaves: Their number.
    """

    amplitude: Scalar = 5.0
    frequency: Scalar = 0.2
    gain: Scalar = 0.5
    lacunarity: Scalar = 2.07
    octaves: int = eqx.field(default=10, static=True)

    def __call__(
        self, x: Float[Array, "*batch"], z: Float[Array, "*batch"]
    ) -> Float[Array, "*batch"]:
        """Height at (x, z), in meters."""
        # All octaves in one array: ten sines written one by one compile slowly.
        order = jnp.arange(self.octaves).reshape((-1,) + (1,) * x.ndim)
        order = order.astype(x.dtype)
        size = self.amplitude * self.gain**order
        f = self.frequency * self.lacunarity**order
        return jnp.sum(size * jnp.sin(f * x[None]) * jnp.sin(f * z[None]), axis=0)

    @property
    def lipschitz(self) -> Scalar:
        """Bound of the slope: no octave is steeper than amplitude times frequency."""
        ratio = self.gain * self.lacunarity
        return self.amplitude * self.frequency * self._sum(ratio)

    @property
    def curvature(self) -> Scalar:
        """Bound of the second derivative along a horizontal direction, in 1/m.

        That of sin(x) sin(z) has the eigenvalues -cos(x - z) and cos(x + z), so no
        octave bends more than amplitude times frequency squared.
        """
        ratio = self.gain * self.lacunarity**2
        return self.amplitude * self.frequency**2 * self._sum(ratio)

    def _sum(self, ratio: Scalar) -> Scalar:
        return sum(ratio**i for i in range(self.octaves))
