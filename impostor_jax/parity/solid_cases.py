"""Solids made of solids: bores, steps, flush faces, and nests of all shapes."""

__all__ = ["bored_can", "many_solids", "single_solids"]

import numpy as np

from impostor_jax.parity.case import Case, camera_on, scattered_case, scattered_places
from impostor_jax.parity.flat_cases import random_heights, seen_pose
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.solid import difference, intersection, union
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.torus import Torus

UNIT = 0.5
"""Length in meters that is seen as large as the radius of another case's primitive."""

UP, ACROSS = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)


def single_solids(kind: str) -> list[Case]:
    """One solid, of many structures and at many distances."""

    def case(name, solid, distance=8.0, elevation=40.0, aside=(0.1, 0.2)):
        """A solid around the origin in meters, looked down at."""
        center = np.array([*aside, distance]) * UNIT
        placed = solid.transformed(seen_pose(elevation, 25.0, center))
        return Case(f"{kind}/{name}", placed, camera_on(kind, distance, UNIT))

    return [
        case("bored can", bored_can()),
        case("bored can, far", bored_can(), 1e3),
        case("bored can, reaching behind", bored_can(3.0), 1.2, 10.0, (1.3, 0.4)),
        # In the bore, and in what is left around it.
        case("inside a bore", bored_can(3.0), 0.1, 80.0, (0.1, 0.1)),
        case("inside a solid", bored_can(3.0), 0.1, 80.0, (0.7, 0.1)),
        case("stepped shaft", _stepped_shaft()),
        case("flush faces", _flush_faces()),
        case("sector in a solid", _cut_cheese()),
        case("all shapes in a solid", _all_in_one()),
        case("half-spaces", _half_spaces()),
        case("ground with a pit", _pit()),
    ]


def many_solids(kind: str) -> list[Case]:
    """Solids of two structures that overlap, and a ball."""
    center, radius = scattered_places(np.random.default_rng(2), kind, 60)
    axis = np.random.default_rng(3).normal(size=(60, 3))
    can = Cylinder(center[:30], axis[:30], radius[:30], 2 * radius[:30])
    bore = Cylinder(center[:30], axis[:30], 0.6 * radius[:30], 2 * radius[:30])
    ball = Sphere(center[30:], radius[30:])
    cut = Plane(center[30:], axis[30:])
    several = (can - bore, Sphere((0.1, 0.2, 3.0), 0.3), ball & cut)
    return [scattered_case(f"{kind}/bored cans and half balls", kind, several)]


def bored_can(height: float = 1.0) -> AbstractPrimitive:
    """A can with a bore that is cut exactly to its ends."""
    place = np.zeros(3), UP
    return Cylinder(*place, 0.45, height) - Cylinder(*place, 0.3, height)


def _stepped_shaft() -> AbstractPrimitive:
    """Steps that touch, and a groove."""
    steps = [
        Cylinder((0.0, y, 0.0), UP, radius, 0.3)
        for y, radius in ((-0.3, 0.45), (0.0, 0.3), (0.3, 0.2))
    ]
    return union(*steps) - Torus((0.0, 0.0, 0.0), UP, 0.32, 0.08)


def _flush_faces() -> AbstractPrimitive:
    """Two blocks that share a face, with a slot as wide as one of them is high."""
    turn = np.eye(3)
    blocks = [Box((x, 0.0, 0.0), turn, (0.5, 0.6, 0.7)) for x in (-0.25, 0.25)]
    slot = Box((0.1, 0.15, 0.0), turn, (0.3, 0.3, 0.7))
    return difference(union(*blocks), slot)


def _cut_cheese() -> AbstractPrimitive:
    """A wheel without a piece, less a piece of another's size, plus a wedge."""
    wheel = Cylinder(np.zeros(3), UP, 0.5, 0.4, 0.6, 5.2, ACROSS)
    piece = Cylinder((0.0, 0.1, 0.0), UP, 0.4, 0.2, 2.0, 3.4, ACROSS)
    wedge = Frustum((0, -0.2, 0), (0, 0.4, 0), 0.4, 0.1, -0.4, 0.4, ACROSS)
    return wheel - piece | wedge


def _all_in_one() -> AbstractPrimitive:
    """All shapes but a heightfield, nested three deep."""
    body = Box((0, 0, 0), np.eye(3), (0.8, 0.6, 0.9)) | Torus((0, 0, 0), UP, 0.5, 0.12)
    hole = union(
        Sphere((0.2, 0.3, 0.3), 0.3),
        Frustum((-0.6, 0.1, 0.0), (0.6, 0.1, 0.1), 0.1, 0.2),
        Cylinder((0.0, 0.0, -0.2), UP, 0.1, 2.0),
    )
    half = Cylinder((0.1, 0.3, 0.2), (0.2, 1.0, -0.3), 0.3, 0.5, 0.4, 4.0, ACROSS)
    cut = Plane((0.0, 0.45, 0.0), (0.2, 1.0, 0.3))
    return intersection(body - hole | half, cut)


def _half_spaces() -> AbstractPrimitive:
    """A ball and a hollow in a floor without end, cut off beyond a wall."""
    floor, wall = Plane(np.zeros(3), UP), Plane((0.0, 0.0, -0.5), (0.1, 0.0, -1.0))
    hollow = Sphere((-0.4, 0.0, 0.1), 0.3)
    return (floor - hollow | Sphere((0.4, 0.1, 0.0), 0.3)) & wall


def _pit() -> AbstractPrimitive:
    """Ground with a pit."""
    # Few samples: the condition of a pixel is that in each of them.
    heights, extent = 0.1 * random_heights((4, 3)), ((-0.7, 0.7), (-0.5, 0.5))
    return Heightfield(heights, extent) - Sphere((-0.2, 0.0, 0.1), 0.3)
