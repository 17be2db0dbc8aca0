"""Pictures from geometry maps: their surfaces under lights.

An edge is blended with the background by the part of the pixel that is covered, in
pixels and so as sharp at every image size. (`trace` casts rays, and so has shadows,
mirrors and glass.)
"""

__all__ = ["shade"]

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from impostor_jax.arguments import bounded_number, float_array
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.local_world import seen_near
from impostor_jax.rendering.lights import AbstractLight, reflected
from impostor_jax.rendering.maps import GeometryMaps


def shade(
    maps: GeometryMaps,
    camera: AbstractCamera,
    lights: Sequence[AbstractLight],
    color: Any = (1.0, 1.0, 1.0),
    exponent: Any = 30.0,
    background: Any = (0.0, 0.0, 0.0),
    coverage: Float[Array, "h w"] | None = None,
) -> Float[Array, "h w 3"]:
    """Picture of a lit surface, in linear RGB.

    Args:
        maps: With point, normal and mask, as `render` gives them.
        camera: That they were rendered with.
        lights: In the world frame.
        color: Of the surface, (3,) or one for each pixel, (h, w, 3).
        exponent: Of the highlight, which shrinks as it grows; None for no highlight.
        background: Color where nothing is seen, as `color`.
        coverage: Part of each pixel that the surface covers, as `coverage` gives it. An
            edge pixel whose center misses takes the mean of its neighbors that hit. If
            None, a pixel shows what its center sees.

    Returns:
        Colors from 0 up, linear in the light. Nothing is clipped: a color is above 1
        where what is reflected adds up to more. A light behind the surface gives no
        highlight, though the formula would where it is seen at a grazing angle.

    Derivatives:
        Finite in the maps, the lights, the colors, the exponent and the coverage. A
        pixel whose center misses has none in its own point and normal.

    Raises:
        ValueError: A map is missing, or a shape does not fit.
    """
    if maps.point is None or maps.normal is None or maps.mask is None:
        raise ValueError(
            "maps must hold point, normal and mask; render them with "
            'outputs=("point", "normal", "mask")'
        )
    shape = maps.mask.shape
    if coverage is not None and coverage.shape != shape:
        raise ValueError(
            f"coverage must have the shape {shape} of the maps, got {coverage.shape}"
        )
    if exponent is not None:
        exponent = bounded_number("exponent", exponent, "a number, not negative")
    color = _color("color", color, shape)
    background = _color("background", background, shape)
    camera, *lights = seen_near(camera, *lights)
    return _shaded(maps, camera, lights, color, exponent, background, coverage)


@jax.jit
def _shaded(
    maps: Any,
    camera: AbstractCamera,
    lights: list[AbstractLight],
    color: Float[Array, "... 3"],
    exponent: Any,
    background: Float[Array, "... 3"],
    coverage: Float[Array, "h w"] | None,
) -> Float[Array, "h w 3"]:
    if camera.camera_from_world is not None:
        lights = [light.transformed(camera.camera_from_world) for light in lights]
    mask, dtype = maps.mask[..., None], maps.point.dtype
    # Infinite on a miss, where a derivative would be NaN.
    point = Vec3.from_array(jnp.where(mask, maps.point, 0))
    view = _towards_camera(point, camera.is_central)
    light = reflected(lights, point, Vec3.from_array(maps.normal), view, exponent)
    color, behind = (
        jnp.broadcast_to(one.astype(dtype), maps.point.shape)
        for one in (color, background)
    )
    surface = color * light.stack()
    if coverage is None:
        return jnp.where(mask, surface, behind)
    surface, known = _widened(surface, maps.mask)
    part = jnp.where(known, coverage, 0).astype(dtype)[..., None]
    return part * surface + (1 - part) * behind


def _color(name: str, value: Any, shape: tuple[int, ...]) -> Float[Array, "... 3"]:
    """A color, or one for each pixel."""
    array = float_array(name, value, (3,))
    if array.shape[:-1] not in ((), shape):
        raise ValueError(
            f"{name} must have the shape (3,) or {(*shape, 3)}, got {array.shape}"
        )
    return array


def _towards_camera(point: Vec3, is_central: bool) -> Vec3:
    """Unit vectors from points to the camera; along -z for parallel rays."""
    if is_central:
        return (-point).normalize()
    zero = jnp.zeros_like(point.x)
    return Vec3(zero, zero, zero - 1)


def _widened(
    image: Float[Array, "h w 3"], mask: Bool[Array, "h w"]
) -> tuple[Float[Array, "h w 3"], Bool[Array, "h w"]]:
    """The image, continued by one pixel around the mask, and where it is known.

    A pixel off the mask takes the mean of its eight neighbors on it.
    """
    weight = mask.astype(image.dtype)[..., None]
    stacked = jnp.concatenate([image * weight, weight], axis=-1)
    sums = jax.lax.reduce_window(
        stacked, 0.0, jax.lax.add, (3, 3, 1), (1, 1, 1), "SAME"
    )
    count = sums[..., 3:]
    mean = sums[..., :3] / jnp.maximum(count, 1)
    return jnp.where(mask[..., None], image, mean), count[..., 0] > 0
