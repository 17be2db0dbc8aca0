"""Box in the image around any shape, from the hull that holds it."""

__all__ = ["ImageBounds", "image_bounds"]

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.numerics import eps
from impostor_jax.primitives.base import AbstractPrimitive

Corner = Float[Array, "*batch 2"]


class ImageBounds(eqx.Module):
    """Box in the plane z = 1, or across parallel rays, that holds a shape's image.

    Attributes:
        low: Smallest x and y; `+inf` of a shape that is wholly behind the camera.
        high: Largest x and y.
    """

    low: Corner
    high: Corner


def image_bounds(primitive: AbstractPrimitive, is_central: bool) -> ImageBounds:
    """Box around the image of a shape, or of each of a batch.

    Args:
        primitive: In the camera frame.
        is_central: Whether the camera's rays start in its origin; else along z.

    Returns:
        Wider than the outline by a few roundings of the rays. Endless in every
        direction where the shape reaches behind the camera, or is not bounded.
    """
    hull = primitive.hull
    if hull is None:
        everywhere = jnp.full((*primitive.batch_shape, 2), jnp.inf, primitive.dtype)
        return ImageBounds(-everywhere, everywhere)
    if is_central:
        reach, nearest, farthest = hull.reach()
        reach = reach + eps(reach.dtype, 8) * (1 + jnp.abs(reach))
        reach = jnp.where((nearest > 0)[..., None], reach, jnp.inf)
        low, high = -reach[..., :2], reach[..., 2:]
    else:
        # Whether a ray from afar meets a shape is rounded as its depth is.
        low, high = hull.box()
        low, high, farthest = low[..., :2], high[..., :2], high[..., 2]
    is_ahead = (farthest > 0)[..., None]
    return ImageBounds(
        low=jnp.where(is_ahead, low, jnp.inf), high=jnp.where(is_ahead, high, -jnp.inf)
    )
