"""Boxes, planes, triangles and heightfields, and a scene of every shape."""

__all__ = [
    "all_shapes",
    "icosahedron",
    "random_heights",
    "seen_pose",
    "single_boxes",
    "single_heightfields",
    "single_planes",
    "triangles",
]

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.io.mesh_surface import surface_of
from impostor_jax.opencv import cv2
from impostor_jax.parity.case import Case, camera_of_kind, camera_on
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.terrain import Terrain
from impostor_jax.primitives.triangle import Triangle

OBLIQUE = (0.5, 0.7, 0.3)
"""Rotation vector of a box whose faces all lean."""

UNIT = 0.5
"""Length in meters that is seen as large as the radius of another case's primitive."""

GENTLE, STEEP = 0.05, 0.4
"""Standard deviation of a sample's height in meters; the samples are 0.25 m apart."""


def single_boxes(kind: str) -> list[Case]:
    """One box, of many proportions and at many distances."""
    unit = 0.05

    def case(name, turn=OBLIQUE, distance=10.0, size=(2.0, 1.4, 2.6), aside=(0.1, 0.2)):
        """A box `distance` units away, a bit `aside`, of a `size` in units."""
        center = np.array([*aside, distance]) * unit
        box = Box(center, _rotation(turn), np.array(size) * unit)
        return Case(f"{kind}/{name}", box, camera_on(kind, distance, unit))

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
        return Case(f"{kind}/{name}", Plane(point, normal), camera)

    return [
        case("floor", (0.0, 0.5, 3.0), (0.1, -1.0, -0.8)),
        case("wall", (0.3, 0.1, 2.0), (0.2, 0.1, -1.0)),
        # Its horizon is in the middle of the image; nearly along all parallel rays.
        case("plane, grazing", (0.0, 0.02, 1.0), (0.01, 1.0, -1e-3)),
    ]


def triangles(kind: str) -> list[Case]:
    """One triangle, under many angles and at many distances, and meshes of them."""
    unit = 0.05
    corners = np.array([(-1.2, -0.7, 0.2), (1.3, -0.4, -0.3), (-0.2, 1.1, 0.1)])

    def case(
        name, distance=10.0, turn=(0.3, -0.5, 0.2), aside=(0.1, 0.2), given=corners
    ):
        """Corners `distance` units away, a bit `aside`, turned."""
        placed = given @ _rotation(turn).T + (*aside, distance)
        camera = camera_on(kind, distance, unit)
        return Case(f"{kind}/{name}", Triangle(placed * unit), camera)

    return [
        case("triangle"),
        case("triangle, from behind", turn=(0.3, 2.6, 0.2)),
        case("triangle, far", 1e3),
        case("triangle, partly out of frame", aside=(2.4, 1.2)),
        case("triangle, reaching behind", 1.2, (1.2, 0.3, 0.5), (0.3, 0.4),
             4 * corners),
        case("triangle, nearly edge on", turn=(1.4, 0.0, 0.3)),
        case("needle", given=corners * (1.5, 0.05, 1.0)),
        case("icosahedron", given=icosahedron()),
        case("icosahedron, around the camera", 0.3, given=1.2 * icosahedron()),
    ]  # fmt: skip


def icosahedron() -> Float[np.ndarray, "20 3 3"]:
    """Faces of radius 1, whose normals point outward."""
    # The coarsest mesh of a ball.
    corners, faces = surface_of(Sphere((0.0, 0.0, 0.0), 1.0), tolerance=1.0)
    return corners[faces]


def single_heightfields(kind: str) -> list[Case]:
    """One heightfield, under many angles and at many distances."""

    def placed(name, field, elevation, center, heading, scale=1.0):
        """What `field` makes of a pose; `center` is in units of `scale`."""
        pose = seen_pose(elevation, heading, scale * np.array(center))
        camera = camera_on(kind, center[2] / UNIT, scale * UNIT)
        return Case(f"{kind}/{name}", field(pose), camera)

    def case(name, elevation=50.0, center=(0.1, 0.05, 6.0), heading=25.0, relief=GENTLE,
             interpolation="bilinear"):  # fmt: skip
        """A heightfield of 2 m by 1.6 m, of one shape of grid, which compiles once."""

        def field(pose):
            heights = relief * random_heights((9, 7))
            extent = ((-1.0, 1.0), (-0.8, 0.8))
            return Heightfield(heights, extent, interpolation, world_from_field=pose)

        return placed(name, field, elevation, center, heading)

    def terrain(pose):
        x, z = np.meshgrid(np.linspace(-20, 20, 33), np.linspace(-15, 15, 25))
        heights = Terrain()(jnp.asarray(x), jnp.asarray(z)).T
        return Heightfield(heights, ((-20, 20), (-15, 15)), world_from_field=pose)

    def bicubic(which="", **view):
        return case(f"bicubic heightfield{which}", interpolation="bicubic", **view)

    return [
        case("heightfield"),
        case("heightfield, steep", relief=STEEP),
        case("heightfield, grazing", 3.0),
        case("heightfield, flat", 30.0, relief=0.0),
        case("heightfield, from below", -35.0),
        case("heightfield, straight down", 90.0, heading=0.0),
        case("heightfield, along its grid", 10.0, (0.0, 0.0, 6.0), 0.0, STEEP),
        case("heightfield, far", center=(0.1, 0.05, 60.0)),
        case("heightfield, partly out of frame", center=(1.4, 0.9, 6.0)),
        case("heightfield, reaching behind", 15.0, (0.1, 0.7, 0.3)),
        case("heightfield, reaching behind, from below", -10.0, (0.1, -0.5, 0.3)),
        case("heightfield, among its peaks", 10.0, (0.1, 0.1, 0.2), relief=STEEP),
        bicubic(),
        bicubic(", steep", relief=0.75 * STEEP),
        bicubic(", grazing", elevation=4.0, heading=40.0, relief=0.6 * GENTLE),
        bicubic(", among its peaks", elevation=10.0, center=(0.1, 0.1, 0.2),
                relief=STEEP),
        placed("terrain, sampled", terrain, 35.0, (0.1, 0.1, 6.0), 25.0, 20.0),
    ]  # fmt: skip


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
    return [Case(f"{kind}/ten shapes", shapes, camera)]


def random_heights(shape: tuple[int, int]) -> Float[np.ndarray, "n m"]:
    """Heights that are as good as independent, of standard deviation 1."""
    return np.random.default_rng(0).normal(size=shape)


def seen_pose(
    elevation: float, heading: float, center: Float[np.ndarray, "3"]
) -> RigidTransform:
    """Pose of a field whose middle, at `center`, is looked down at.

    Args:
        elevation: Angle between the optical axis and the field's ground, in degrees;
            negative where the field is seen from below.
        heading: Turn of the field about its y axis, in degrees.
        center: In the camera frame, in meters.
    """
    # Rounded, so that a right angle is one.
    (c, s), (p, q) = (
        np.round([math.cos(math.radians(a)), math.sin(math.radians(a))], 12)
        for a in (elevation, heading)
    )
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, -c, s], [0.0, -s, -c]])
    turn = np.array([[p, 0.0, q], [0.0, 1.0, 0.0], [-q, 0.0, p]])
    return RigidTransform(tilt @ turn, center)


def _rotation(vector: tuple[float, float, float]) -> np.ndarray:
    return cv2.Rodrigues(np.array(vector))[0]
