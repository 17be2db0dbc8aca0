"""Where a ray meets a smooth surface: how the hit moves, and which way it faces.

The hit point p satisfies F(p, parameters) = 0. With n the gradient of F in p and d the
ray's direction, dt = -(dF at the held t) / (n . d), whatever formula t came from:
finite on every ray, and the same in forward and reverse mode. So a primitive says how t
is found and what F is (`implicit_hit`), and derives nothing.
"""

__all__ = ["facing", "hit_tangent", "implicit_hit", "within_range"]

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import zero_from_primal
from jaxtyping import Array, Bool, Float

from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import smallest_slope

Values = TypeVar("Values")


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def implicit_hit(
    trace: Callable[[Ray, Any], tuple[Float[Array, "*batch"], Any]],
    equation: Callable[[Vec3, Any, Any], tuple[Array, Array]],
    ray: Ray,
    shape: Any,
) -> tuple[Float[Array, "*batch"], Any]:
    """First hit that a function finds, with the derivative of the surface's equation.

    Args:
        trace: From ray and shape to the ray parameter of the hit, `+inf` on a miss, and
            what tells the piece of the surface, in whole numbers or flags. It need not
            have a derivative.
        equation: From a point, what tells the piece, and the shape to F, whose gradient
            is about a unit vector, and to the radius of curvature there, 1 of what is
            flat. Its derivatives are finite at any point.
        ray: That is cast.
        shape: What it is cast at: a tree of numbers and vectors, each of one shape or
            of as many as there are rays.

    Returns:
        What `trace` does. The derivative is 0 on a miss and as `hit_tangent` and
        `within_range` say where the ray grazes.
    """
    return trace(ray, shape)


@implicit_hit.defjvp
def _implicit_hit_jvp(trace, equation, primals, tangents):
    t, piece = implicit_hit(trace, equation, *primals)
    d_t = _implicit_tangent(equation, t, piece, primals, tangents)
    return (t, piece), (d_t, jax.tree.map(zero_from_primal, piece))


@partial(jax.jit, static_argnums=0)
def _implicit_tangent(equation, hit, piece, primals, tangents):
    mask = jnp.isfinite(hit)
    t = jnp.where(mask, hit, 0)

    def slope(t: Float[Array, "*batch"], ray: Ray, shape: Any) -> tuple[Array, Array]:
        """Of F along the ray, and the radius of curvature."""
        _, n_d, radius = jax.jvp(
            lambda p: equation(p, piece, shape),
            (ray.at(t),),
            (ray.direction,),
            has_aux=True,
        )
        return n_d, radius

    p, d = primals[0].at(t), primals[0].direction
    n_d, radius = slope(t, *primals)
    squares = p.dot(p) + t * t * d.dot(d)
    t, primals = within_range((t, primals), squares, radius, n_d)
    moves = jax.tree.map(lambda x, dx: jnp.broadcast_to(dx, x.shape), primals, tangents)
    _, change, _ = jax.jvp(
        lambda ray, shape: equation(ray.at(t), piece, shape),
        primals,
        moves,
        has_aux=True,
    )
    return hit_tangent(-change, slope(t, *primals)[0], mask)


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
    divisor = radius * jnp.abs(n_d) ** 3
    bounded = 1 + squares < divisor * (float(np.finfo(n_d.dtype).max) / 1024)
    return jax.tree.map(
        lambda x: jnp.where(bounded, x, jax.lax.stop_gradient(x)), values
    )
