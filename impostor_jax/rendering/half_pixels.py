"""Two parts into which a straight line cuts a pixel: their areas and their middles.

The pixel is a unit square around 0, the first part where n . x + s > 0. With a >= b the
sizes of the components of the unit vector n, the line cuts off a triangle at a corner,
or else a trapezoid along a side. Both are written in ratios that stay below 1, so that
a line along a side, b = 0, is no special case.
"""

__all__ = ["Halves", "halves", "reach"]

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.numerics import Numbers, safe_divide


class Halves(NamedTuple):
    """The parts of each pixel.

    Attributes:
        area: Of the first part; that of the second is what it leaves of 1.
        middles: Centroids of the two; that of a part without an area is 0.
    """

    area: Numbers
    middles: tuple[Float[Array, "*batch 2"], Float[Array, "*batch 2"]]


def reach(normal: Float[Array, "*batch 2"]) -> Numbers:
    """Largest distance from the pixel's center of a line that crosses the pixel."""
    return jnp.sum(jnp.abs(normal), axis=-1) / 2


def halves(s: Numbers, normal: Float[Array, "*batch 2"]) -> Halves:
    """Areas and centroids.

    Args:
        s: Distance of the center from the line, in pixels; positive in the first part.
        normal: Unit vectors n, towards the first part.

    Derivatives:
        In s, exact and finite; in the normal none is meant.
    """
    size = jnp.abs(normal)
    is_swapped = size[..., 1] > size[..., 0]
    a, b = jnp.max(size, axis=-1), jnp.min(size, axis=-1)
    a = jnp.where(a > 0, a, 1)
    off = jnp.abs(s)
    # Legs of the triangle at the corner that the line cuts off.
    room = jnp.maximum((a + b) / 2 - off, 0)
    is_triangle = off > (a - b) / 2
    short = room / a
    long = jnp.where(is_triangle, safe_divide(room, b), 0)
    # Its area, or that of a trapezoid, is at most a half.
    lesser = jnp.where(is_triangle, short * long / 2, 0.5 - off / a)
    slope = b / a
    spread = safe_divide(slope, lesser) / 24
    x = jnp.where(is_triangle, 0.5 - short / 3, (1 - lesser) / 2 - slope * spread)
    y = jnp.where(is_triangle, 0.5 - long / 3, 2 * spread)
    ahead = jnp.where(s < 0, 1, -1).astype(s.dtype)
    first, second = jnp.where(is_swapped, y, x), jnp.where(is_swapped, x, y)
    side = jnp.where(normal < 0, -1, 1).astype(s.dtype)
    middle = jnp.stack([first, second], axis=-1) * side * ahead[..., None]
    rest = -middle * (lesser / (1 - lesser))[..., None]
    is_lesser = (s < 0)[..., None]
    none = jnp.zeros_like(middle)
    middle = jnp.where((lesser > 0)[..., None], middle, none)
    return Halves(
        area=jnp.where(s < 0, lesser, 1 - lesser),
        middles=(
            jnp.where(is_lesser, middle, rest),
            jnp.where(is_lesser, rest, middle),
        ),
    )
