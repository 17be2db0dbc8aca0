"""Boxes and planes, and a scene of every shape."""

__all__ = ["all_shapes", "single_boxes", "single_planes"]

import cv2
import numpy as np

from impostor_jax.glsl.case import Case, camera_of_kind, camera_on
from impostor_jax.glsl.heightfield_cases import random_heights, seen_pose
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.sphere import Sphere

OBLIQUE = (0.5, 0.7, 0.3)
"""Rotation vector of a box whose faces all lean."""


def single_boxes(kind: str) -> list[Case]:
    """One box, of many proportions and at many distances."""
    unit = 0.05

    def case(name, turn=OBLIQUE, distance=10.0, size=(2.0, 1.4, 2.6), aside=(0.1, 0.2)):
        """A box `distance` units away, a bit `aside`, of a `size` in units."""
        center = np.array([*aside, distance]) * unit
        box = Box(center, _rotation(turn), np.array(size) * unit)
        return Case(f"{kind}/{name}", box, camera_on(kind, distance, unit), distance)

    return [
        case("box"),
        case("box, far", (-0.9, 0.2, 0.4), distance=1e3),
        case("box, reaching behind", distance=1.2, size=(1.0, 1.4, 20.0),
             aside=(1.6, 0.8)),
        case("inside a box", distance=0.5, size=(2.0, 3.0, 8.0)),
        case("sheet", size=(3.0, 2.0, 0.01)),
        case("sheet, edge on", (0.0, 0.0, 0.3), size=(0.05, 4.0, 3.0),
             aside=(0.0, 0.0)),
    ]  # fmt: skip


def single_planes(kind: str) -> list[Case]:
    """One plane, from facing the camera to its horizon."""
    camera = camera_of_kind(kind, 110.0 if kind == "perspective" else 50.0)

    def case(name, point, normal):
        # Something without end is many times larger than its distance.
        return Case(f"{kind}/{name}", Plane(point, normal), camera, 0.0)

    return [
        case("floor", (0.0, 0.5, 3.0), (0.1, -1.0, -0.8)),
        case("wall", (0.3, 0.1, 2.0), (0.2, 0.1, -1.0)),
        # Its horizon is in the middle of the image; nearly along all parallel rays.
        case("plane, grazing", (0.0, 0.02, 1.0), (0.01, 1.0, -1e-3)),
    ]


def all_shapes(kind: str) -> list[Case]:
    """Ten shapes of every type that overlap, in front of a wall and on rough ground."""
    across = (1.0, 0.0, 0.0)
    ground = Heightfield(
        0.04 * random_heights((9, 7)),
        ((-1.5, 1.5), (-2.0, 2.0)),
        world_from_field=seen_pose(15.0, 10.0, np.array((0.0, 0.5, 3.0))),
    )
    shapes = (
        ground,
        Cylinder((-0.5, 0.1, 2.4), (0.3, 1.0, 0.2), 0.2, 0.9),
        Box((0.4, 0.3, 2.2), _rotation(OBLIQUE), (0.4, 0.5, 0.6)),
        Sphere((-0.1, 0.2, 2.3), 0.25),
        Frustum((0.1, 0.5, 2.0), (0.15, -0.3, 2.4), 0.3, 0.0),
        Frustum((-0.5, -0.3, 2.0), (-0.1, -0.2, 2.6), 0.1, 0.25, 0.5, 2.0, across),
        Cylinder(
            (0.5, -0.2, 2.1), (0.6, 0.7, 0.3), 0.2, 0.5, 0.4, 4.2, across, caps=False
        ),
        Plane((0.0, 0.0, 4.0), (0.3, 0.0, -1.0)),
        Box((-0.2, 0.0, 3.0), _rotation((0.0, 0.4, 0.0)), (1.6, 0.5, 0.05)),
        Frustum((-0.7, 0.3, 2.0), (-0.3, 0.5, 1.8), 0.15, 0.08, caps=False),
    )
    camera = camera_of_kind(kind, 150.0 if kind == "perspective" else 70.0)
    return [Case(f"{kind}/ten shapes", shapes, camera, 0.0)]


def _rotation(vector: tuple[float, float, float]) -> np.ndarray:
    return cv2.Rodrigues(np.array(vector))[0]
