"""Scenes whose traced pictures are compared: shadows, mirrors and glass."""

__all__ = ["traced"]

import math
from collections.abc import Sequence

import numpy as np

from impostor_jax.parity.case import camera_of_kind
from impostor_jax.parity.flat_cases import seen_pose
from impostor_jax.parity.solid_cases import bored_can
from impostor_jax.parity.traced import TracedCase
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.torus import Torus
from impostor_jax.primitives.triangle import Triangle
from impostor_jax.rendering.lights import (
    AbstractLight,
    AmbientLight,
    DirectionalLight,
    PointLight,
)
from impostor_jax.rendering.material import Material

FLOOR = Plane((0.0, 0.5, 0.0), (0.0, -1.0, 0.0))
LIGHTS = (
    AmbientLight(0.1),
    PointLight((1.0, -2.0, 1.0), (3.0, 2.5, 2.0), "inverse_square"),
    DirectionalLight((-1.0, -2.0, -1.0), 0.4),
)
SKY = (0.2, 0.3, 0.5)

_Traced = tuple[
    Sequence[AbstractPrimitive],
    Sequence[Material],
    Sequence[AbstractLight],
    tuple[float, float, float],
]
"""Shapes, materials, lights and background."""


def traced(kind: str) -> list[TracedCase]:
    """Scenes that are traced."""
    focal = 130.0 if kind == "perspective" else 60.0
    camera = camera_of_kind(kind, focal)
    scenes = {
        "published scene": _published(),
        "cans, balls and a mirror": _mirrors(),
        "glass ball and box": _glass(),
        "shapes of glass": _all_of_glass(),
        "solids of solids": _solids(),
    }
    bounds = {
        # The floor is 5000 of the others' radii in size: JAX itself is 4.5e-5 from
        # double precision at the 99.9th percentile, and 5e-4 at the worst pixel.
        "published scene": (6e-5, 3e-4),
        # A curved mirror magnifies rounding: JAX is 1.5e-6 from double precision.
        "cans, balls and a mirror": (2e-6, 1e-4),
        # As does a lens: JAX is 1.4e-6 from it.
        "solids of solids": (2e-6, 1e-4),
    }
    return [
        TracedCase(
            f"{kind}/traced, {name}", *scene, camera, *bounds.get(name, (1e-6, 1e-4))
        )
        for name, scene in scenes.items()
    ]


def _published() -> _Traced:
    """The scene that the published tracer is shown with, its y axis downwards."""
    shapes = [
        Sphere((0.0, 1.0, 3.0), 1.0),
        Sphere((-2.0, -1.0, 3.0), 1.0),
        Sphere((2.0, -1.0, 3.0), 1.0),
        Sphere((0.0, 5001.0, 0.0), 5000.0),
    ]
    materials = [
        Material((1.0, 0.0, 0.0), 500.0, 0.2),
        Material((0.0, 0.0, 1.0), 500.0, 0.3),
        Material((0.0, 1.0, 0.0), 10.0, 0.4),
        Material((1.0, 1.0, 0.0), 1000.0, 0.5),
    ]
    lights = [
        AmbientLight(0.2),
        PointLight((2.0, -1.0, 0.0), 0.6),
        DirectionalLight((1.0, -4.0, 4.0), 0.2),
    ]
    return shapes, materials, lights, (0.0, 0.0, 0.0)


def _mirrors() -> _Traced:
    shapes = [
        FLOOR,
        Cylinder((-0.5, 0.2, 2.2), (0.0, 1.0, 0.0), 0.15, 0.6),
        Cylinder((0.5, 0.3, 2.0), (0.3, 0.2, 1.0), 0.2, 0.5),
        Sphere((0.0, 0.25, 2.0), 0.25),
        Sphere((0.2, -0.3, 2.5), 0.2),
        Box((0.0, 0.0, 3.2), _turned(0.3), (2.0, 1.0, 0.1)),
    ]
    materials = [
        Material((0.8, 0.8, 0.7)),
        Material((0.9, 0.2, 0.1), 30.0),
        Material((0.2, 0.4, 0.9), 80.0, 0.2),
        Material((0.3, 0.8, 0.3), 20.0),
        Material((0.9, 0.9, 0.9), 100.0, 0.6),
        Material((1.0, 1.0, 1.0), None, 0.9),
    ]
    return shapes, materials, LIGHTS, SKY


def _glass() -> _Traced:
    shapes = [
        FLOOR,
        Sphere((-0.3, 0.1, 2.0), 0.35),
        Box((0.4, 0.1, 2.2), _turned(0.6), (0.4, 0.5, 0.4)),
        Cylinder((0.0, 0.2, 3.0), (0.0, 1.0, 0.1), 0.2, 0.5),
    ]
    materials = [
        Material((0.8, 0.7, 0.6)),
        Material((1.0, 1.0, 1.0), 100.0, None, 0.9, 1.5, True),
        Material((1.0, 1.0, 1.0), None, 0.05, 0.9, 1.3),
        Material((0.9, 0.2, 0.1), 50.0, 0.2),
    ]
    return shapes, materials, LIGHTS, SKY


def _all_of_glass() -> _Traced:
    """All but a heightfield as of glass, what has no inside, too."""
    up = (0.0, -1.0, 0.2)
    shapes = [
        FLOOR,
        Sphere((-0.7, -0.3, 2.0), 0.25),
        Box((-0.1, -0.4, 2.2), _turned(0.6), (0.3, 0.3, 0.3)),
        Cylinder((0.5, -0.4, 2.0), up, 0.15, 0.4),
        Frustum((-0.6, 0.4, 2.0), (-0.6, 0.1, 2.1), 0.25, 0.1),
        Frustum((0.7, 0.3, 2.0), (0.7, 0.0, 2.1), 0.25, 0.2, -2.0, 1.5),
        Torus((0.1, 0.2, 2.0), (0.0, 1.0, 1.0), 0.2, 0.07),
        Triangle([[-1.0, 0.45, 3.0], [1.0, 0.45, 3.0], [0.0, -0.8, 3.2]]),
    ]
    glass = Material((0.9, 1.0, 0.9), 60.0, 0.1, 0.7, 1.4)
    materials = [Material((0.8, 0.7, 0.6)), *[glass] * (len(shapes) - 1)]
    return shapes, materials, LIGHTS, SKY


def _solids() -> _Traced:
    """A mirror, a lens, and what throws a shadow on its own inside."""
    pose = seen_pose(50.0, 20.0, np.array((-0.5, 0.1, 2.2)))
    can = bored_can(0.6).transformed(pose)
    block = Box((0.55, 0.2, 2.3), _turned(0.5), (0.5, 0.6, 0.5))
    ends = Sphere((0.0, 0.0, 1.7), 0.4), Sphere((0.05, 0.0, 2.2), 0.4)
    shapes = [
        FLOOR,
        can,
        block - Sphere((0.45, 0.0, 2.0), 0.3),
        ends[0] & ends[1],
        Sphere((0.1, -0.35, 2.6), 0.2),
    ]
    materials = [
        Material((0.8, 0.8, 0.7)),
        Material((0.9, 0.3, 0.2), 30.0, 0.2),
        Material((0.9, 0.9, 0.9), 60.0, 0.6),
        Material((0.9, 1.0, 0.9), 60.0, None, 0.9, 1.4),
        Material((0.2, 0.4, 0.9), 20.0),
    ]
    return shapes, materials, LIGHTS, SKY


def _turned(angle: float) -> list[list[float]]:
    """Rotation about the y axis."""
    c, s = math.cos(angle), math.sin(angle)
    return [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
