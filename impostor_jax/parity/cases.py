"""Scenes that JAX and the drivers are compared on: where a user goes, and limits."""

__all__ = ["CAMERAS", "cases", "select"]

from collections.abc import Sequence
from fnmatch import fnmatchcase

from impostor_jax.arguments import one_of
from impostor_jax.parity.case import Case
from impostor_jax.parity.flat_cases import (
    all_shapes,
    single_boxes,
    single_heightfields,
    single_planes,
    triangles,
)
from impostor_jax.parity.round_cases import (
    many_cylinders,
    many_spheres,
    mixed_primitives,
    single_cylinders,
    single_frusta,
    single_spheres,
    single_tori,
)
from impostor_jax.parity.solid_cases import many_solids, single_solids
from impostor_jax.parity.traced import TracedCase
from impostor_jax.parity.traced_cases import traced

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
    triangles,
    single_heightfields,
    all_shapes,
    single_solids,
    many_solids,
    traced,
)
"""What makes the cases of one kind of camera."""


def cases(camera: str = "all") -> list[Case | TracedCase]:
    """All scenes, for one kind of camera or for "all"."""
    one_of("camera", camera, (*CAMERAS, "all"))
    kinds = CAMERAS if camera == "all" else (camera,)
    return [case for kind in kinds for make in FAMILIES for case in make(kind)]


def select(
    camera: str = "all", patterns: Sequence[str] = ("all",)
) -> list[Case | TracedCase]:
    """Cases of one kind of camera, or "all", whose names match a pattern.

    Raises:
        ValueError: The camera is unknown, or no case matches a pattern.
    """
    found, kept = cases(camera), []
    for pattern in patterns:
        wanted = "*" if pattern == "all" else pattern
        matching = [case for case in found if fnmatchcase(case.name, wanted)]
        if not matching:
            names = ", ".join(case.name for case in found)
            raise ValueError(f"cases must match one of {names}; got {pattern!r}")
        kept += [case for case in matching if case not in kept]
    return kept
