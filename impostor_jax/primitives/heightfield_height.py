"""Height and slope of a heightfield's surface at points of its own frame."""

__all__ = ["Function", "as_tree", "function_surface", "grid_surface"]

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from impostor_jax.numerics import Numbers
from impostor_jax.primitives.heightfield_grid import control_points, surface

Function = Callable[[Any, Any], Any]


def function_surface(
    function: Function, x: Numbers, z: Numbers
) -> tuple[Numbers, Numbers, Numbers]:
    """Height of an elementwise function, and its derivatives in x and z."""
    one, none = jnp.ones_like(x), jnp.zeros_like(x)
    height, by_x = jax.jvp(function, (x, z), (one, none))
    _, by_z = jax.jvp(function, (x, z), (none, one))
    return height, by_x, by_z


def grid_surface(
    grid: Float[Array, "n m"],
    extent: Float[Array, "2 2"],
    interpolation: str,
    x: Numbers,
    z: Numbers,
) -> tuple[Numbers, Numbers, Numbers]:
    """Height of a grid, and its derivatives in x and z."""
    rows, cols = grid.shape[0] - 1, grid.shape[1] - 1
    (x0, x1), (z0, z1) = extent
    per_x, per_z = rows / (x1 - x0), cols / (z1 - z0)
    i, u = _place((x - x0) * per_x, rows)
    j, v = _place((z - z0) * per_z, cols)
    points = control_points(grid, interpolation, i, j)
    height, by_u, by_v = surface(points, u, v)
    return height, by_u * per_x, by_v * per_z


def _place(x: Numbers, count: int) -> tuple[Int[Array, "*batch"], Numbers]:
    """Number of the patch that holds x, and the place in it."""
    i = jnp.clip(jnp.floor(jax.lax.stop_gradient(x)), 0, count - 1)
    return i.astype(jnp.int32), x - i


class _Function(eqx.Module):
    """A callable taken apart into its arrays and numbers, and the rest."""

    leaves: Any
    rest: Any = eqx.field(static=True)

    def __call__(self, x: Numbers, z: Numbers) -> Numbers:
        """Call what was taken apart."""
        return eqx.combine(self.leaves, self.rest)(x, z)


def as_tree(function: Function) -> Function:
    """The function itself if it is a tree of arrays; else one whose rest is static."""
    leaves, rest = eqx.partition(function, eqx.is_array_like)
    return _Function(leaves, rest) if jax.tree.leaves(rest) else function
