"""Scenes that JAX and the drivers are compared on: where a user goes, and limits."""

__all__ = ["CAMERAS", "cases"]

from impostor_jax.arguments import one_of
from impostor_jax.glsl.case import Case
from impostor_jax.glsl.cylinder_cases import many_cylinders, single_cylinders
from impostor_jax.glsl.flat_cases import all_shapes, single_boxes, single_planes
from impostor_jax.glsl.frustum_cases import single_frusta
from impostor_jax.glsl.heightfield_cases import single_heightfields
from impostor_jax.glsl.sphere_cases import (
    many_spheres,
    mixed_primitives,
    single_spheres,
    single_tori,
)

CAMERAS = ("perspective", "orthographic")

FAMILIES = (
    single_cylinders,
    many_cylinders,
    single_spheres,
    many_spheres,
    mixed_primitives,
    single_tori,
    single_frusta,
    single_boxes,
    single_planes,
    single_heightfields,
    all_shapes,
)
"""What makes the cases of one kind of camera."""


def cases(camera: str = "all") -> list[Case]:
    """All scenes, for one kind of camera or for "all"."""
    one_of("camera", camera, (*CAMERAS, "all"))
    kinds = CAMERAS if camera == "all" else (camera,)
    return [case for kind in kinds for make in FAMILIES for case in make(kind)]
