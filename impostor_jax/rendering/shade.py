"""Pictures from geometry maps: Lambert's diffuse and Phong's specular reflection.

A light that falls on a pixel's surface from the unit direction l, with the unit normal
n and the unit direction v to the camera, is reflected as

    intensity * (max(0, n.l) + max(0, r.v)^s),    r = 2 n (n.l) - l,

and the sum over the lights scales the color. An edge is blended with the background by
the part of the pixel that is covered, in pixels and so as sharp at every image size.
"""

__all__ = ["AbstractLight", "AmbientLight", "DirectionalLight", "PointLight", "shade"]

import abc
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.arguments import bounded_number, check_direction, float_array
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Scalar, safe_normalize
from impostor_jax.rendering.maps import GeometryMaps


class AbstractLight(eqx.Module):
    """A light; its intensity is what a white surface reflects that faces it."""

    intensity: eqx.AbstractVar[Scalar]

    @abc.abstractmethod
    def towards(self, point: Vec3) -> Vec3 | None:
        """Unit vectors from surface points to the light; None for light from all sides.

        The zero vector, of which nothing is reflected, at the light itself.
        """

    @abc.abstractmethod
    def transformed(self, target_from_source: RigidTransform) -> "AbstractLight":
        """Express the same light in another frame."""


class AmbientLight(AbstractLight):
    """Light from all sides.

    Args:
        intensity: Not negative.
    """

    intensity: Scalar

    def __init__(self, intensity: Any):
        self.intensity = _intensity(intensity)

    @override
    def towards(self, point: Vec3) -> None:
        return None

    @override
    def transformed(self, target_from_source: RigidTransform) -> "AmbientLight":
        return self


class PointLight(AbstractLight):
    """Light from a point, as bright at every distance.

    Args:
        position: (3,), in the world frame, in meters.
        intensity: Not negative.
    """

    position: Float[Array, "3"]
    intensity: Scalar

    def __init__(self, position: Any, intensity: Any):
        self.position = float_array("position", position, (3,), "meters")
        self.intensity = _intensity(intensity)

    @override
    def towards(self, point: Vec3) -> Vec3:
        position = self.position.astype(point.x.dtype)
        return (Vec3.from_array(position) - point).normalize()

    @override
    def transformed(self, target_from_source: RigidTransform) -> "PointLight":
        return PointLight(target_from_source.apply(self.position), self.intensity)


class DirectionalLight(AbstractLight):
    """Light from very far away.

    Args:
        direction: (3,), towards the light, in the world frame; any nonzero length.
        intensity: Not negative.
    """

    direction: Float[Array, "3"]
    intensity: Scalar

    def __init__(self, direction: Any, intensity: Any):
        self.direction = float_array("direction", direction, (3,))
        self.intensity = _intensity(intensity)
        check_direction("direction", self.direction)

    @override
    def towards(self, point: Vec3) -> Vec3:
        direction = self.direction.astype(point.x.dtype)
        return Vec3.from_array(safe_normalize(direction))

    @override
    def transformed(self, target_from_source: RigidTransform) -> "DirectionalLight":
        return DirectionalLight(
            target_from_source.rotate(self.direction), self.intensity
        )


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
    return _shaded(maps, camera, list(lights), color, exponent, background, coverage)


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
    light = _reflected(lights, point, Vec3.from_array(maps.normal), view, exponent)
    color, behind = (
        jnp.broadcast_to(one.astype(dtype), maps.point.shape)
        for one in (color, background)
    )
    surface = color * light[..., None]
    if coverage is None:
        return jnp.where(mask, surface, behind)
    surface, known = _widened(surface, maps.mask)
    part = jnp.where(known, coverage, 0).astype(dtype)[..., None]
    return part * surface + (1 - part) * behind


def _intensity(value: Any) -> Any:
    return bounded_number("intensity", value, "a number, not negative")


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


def _reflected(
    lights: Sequence[AbstractLight], point: Vec3, n: Vec3, v: Vec3, exponent: Any
) -> Float[Array, "h w"]:
    """Light that a white surface sends to the camera."""
    total = jnp.zeros_like(point.x)
    for light in lights:
        intensity = jnp.asarray(light.intensity, total.dtype)
        to_light = light.towards(point)
        if to_light is None:
            total = total + intensity
            continue
        n_l = n.dot(to_light)
        part = jnp.maximum(n_l, 0)
        if exponent is not None:
            r_v = (n * (2 * n_l) - to_light).dot(v)
            shines = (n_l > 0) & (r_v > 0)
            # The derivative of a power of 0 is infinite for an exponent below 1.
            base = jnp.where(shines, r_v, 1)
            power = base ** jnp.asarray(exponent, total.dtype)
            part = part + jnp.where(shines, power, 0)
        total = total + intensity * part
    return total


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
