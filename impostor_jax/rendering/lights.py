"""Lights, and what of them a surface reflects: Lambert's and Phong's models.

Light that falls on a surface from the unit direction l, with the unit normal n and the
unit direction v to the viewer, is reflected as

    intensity * (max(0, n.l) + max(0, r.v)^s),    r = 2 n (n.l) - l,

and the sum over the lights scales the color. A light behind the surface gives no
highlight, though the formula would where it is seen at a grazing angle.
"""

__all__ = [
    "AbstractLight",
    "AmbientLight",
    "DirectionalLight",
    "PointLight",
    "reflected",
]

import abc
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.arguments import (
    bounded_number,
    check_direction,
    float_array,
    is_concrete,
    one_of,
    place_of,
)
from impostor_jax.geometry.frames import Points, RigidTransform
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, Scalar, safe_divide, safe_normalize

Intensity = Scalar | Float[Array, "3"]
"""One number for white light, or red, green and blue."""


class AbstractLight(eqx.Module):
    """A light.

    Attributes:
        intensity: What a white surface reflects that faces it.
        is_near: Whether the way to it ends there.
    """

    intensity: eqx.AbstractVar[Intensity]
    is_near: ClassVar[bool]

    @abc.abstractmethod
    def towards(self, point: Vec3) -> Vec3 | None:
        """Vectors from surface points to the light; None for light from all sides.

        Of the length of the way to it, or of any length if it is endless.
        """

    @abc.abstractmethod
    def strength(self, to_light: Vec3) -> Numbers | None:
        """What falls on a surface, over the intensity; None if that is 1 everywhere.

        Args:
            to_light: What `towards` gives.
        """

    @abc.abstractmethod
    def transformed(self, target_from_source: RigidTransform) -> "AbstractLight":
        """Express the same light in another frame."""


class AmbientLight(AbstractLight):
    """Light from all sides.

    Args:
        intensity: Not negative: one number, or red, green and blue.
    """

    intensity: Intensity
    is_near: ClassVar[bool] = False

    def __init__(self, intensity: Any):
        self.intensity = _intensity(intensity)

    @override
    def towards(self, point: Vec3) -> None:
        return None

    @override
    def strength(self, to_light: Vec3) -> None:
        return None

    @override
    def transformed(self, target_from_source: RigidTransform) -> "AmbientLight":
        return self


class PointLight(AbstractLight):
    """Light from a point.

    Args:
        position: (3,), in the world frame, in meters.
        intensity: Not negative: one number, or red, green and blue.
        falloff: "none", as bright at every distance; or "inverse_square", where the
            intensity is that at 1 meter.
    """

    position: Points
    intensity: Intensity
    falloff: Literal["none", "inverse_square"] = eqx.field(static=True)
    is_near: ClassVar[bool] = True

    def __init__(self, position: Any, intensity: Any, falloff: str = "none"):
        rounded = float_array("position", position, (3,), "meters")
        self.position = place_of(position, rounded)
        self.intensity = _intensity(intensity)
        one_of("falloff", falloff, ("none", "inverse_square"))
        self.falloff = falloff  # pyright: ignore[reportAttributeAccessIssue]

    @override
    def towards(self, point: Vec3) -> Vec3:
        position = jnp.asarray(self.position, point.x.dtype)
        return Vec3.from_array(position) - point

    @override
    def strength(self, to_light: Vec3) -> Numbers | None:
        if self.falloff == "none":
            return None
        return safe_divide(jnp.ones_like(to_light.x), to_light.dot(to_light))

    @override
    def transformed(self, target_from_source: RigidTransform) -> "PointLight":
        position = target_from_source.apply(self.position)
        return eqx.tree_at(lambda light: light.position, self, position)


class DirectionalLight(AbstractLight):
    """Light from very far away.

    Args:
        direction: (3,), towards the light, in the world frame; any nonzero length.
        intensity: Not negative: one number, or red, green and blue.
    """

    direction: Float[Array, "3"]
    intensity: Intensity
    is_near: ClassVar[bool] = False

    def __init__(self, direction: Any, intensity: Any):
        self.direction = float_array("direction", direction, (3,))
        self.intensity = _intensity(intensity)
        check_direction("direction", self.direction)

    @override
    def towards(self, point: Vec3) -> Vec3:
        x, y, z = safe_normalize(self.direction.astype(point.x.dtype))
        one = jnp.ones_like(point.x)
        return Vec3(x * one, y * one, z * one)

    @override
    def strength(self, to_light: Vec3) -> None:
        return None

    @override
    def transformed(self, target_from_source: RigidTransform) -> "DirectionalLight":
        direction = target_from_source.rotate(self.direction)
        return eqx.tree_at(lambda light: light.direction, self, direction)


def reflected(
    lights: Sequence[AbstractLight],
    point: Vec3,
    n: Vec3,
    v: Vec3,
    exponent: Any,
    hidden: Sequence[Bool[Array, "*batch"] | None] | None = None,
) -> Vec3:
    """Light that a white surface sends to a viewer: red, green and blue.

    Args:
        lights: In the frame of the points.
        point: Of the surface.
        n: Unit normals.
        v: Unit vectors to the viewer.
        exponent: Of the highlight, one or of each point, below 0 where there is none;
            None if there is none anywhere.
        hidden: Of each light, the points that are in its shadow; None for none.
    """
    zero = jnp.zeros_like(point.x)
    total = Vec3(zero, zero, zero)
    for number, light in enumerate(lights):
        part = _reflected_of(light, point, n, v, exponent)
        dark = None if hidden is None else hidden[number]
        if dark is not None:
            part = jnp.where(dark, 0, part)
        intensity = jnp.broadcast_to(jnp.asarray(light.intensity, zero.dtype), 3)
        red, green, blue = intensity
        total = total + Vec3(red * part, green * part, blue * part)
    return total


def _reflected_of(
    light: AbstractLight, point: Vec3, n: Vec3, v: Vec3, exponent: Any
) -> Numbers:
    """Light of intensity 1 that a white surface sends to a viewer."""
    way = light.towards(point)
    if way is None:
        return jnp.ones_like(point.x)
    # The zero vector, of which nothing is reflected, at the light itself.
    to_light = way.normalize()
    n_l = n.dot(to_light)
    part = jnp.maximum(n_l, 0)
    if exponent is not None:
        exponent = jnp.asarray(exponent, n_l.dtype)
        r_v = (n * (2 * n_l) - to_light).dot(v)
        shines = (n_l > 0) & (r_v > 0) & (exponent >= 0)
        # The derivative of a power of 0 is infinite for an exponent below 1.
        power = jnp.where(shines, r_v, 1) ** jnp.where(shines, exponent, 1)
        part = part + jnp.where(shines, power, 0)
    strength = light.strength(way)
    return part if strength is None else part * strength


def _intensity(value: Any) -> Intensity:
    if not isinstance(value, Sequence) and np.ndim(value) == 0:
        return bounded_number("intensity", value, "a number, not negative")
    rgb = float_array("intensity", value, (3,))
    if rgb.ndim > 1 or (is_concrete(rgb) and bool((rgb < 0).any())):
        raise ValueError(
            "intensity must be a number, or red, green and blue, not negative, got "
            f"{value}"
        )
    return rgb
