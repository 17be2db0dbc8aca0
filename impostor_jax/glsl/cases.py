"""Scenes that JAX and the drivers are compared on: where a user goes, and limits."""

__all__ = ["CAMERAS", "Case", "cases"]

import dataclasses
import math

import numpy as np

from impostor_jax.arguments import one_of
from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.primitives.cylinder import Cylinder

CAMERAS = ("perspective", "orthographic")

WIDTH, HEIGHT = 160, 120

RADIUS_PX = 24.0
"""Radius in the image, where the distance lets it be seen whole."""


@dataclasses.dataclass(frozen=True)
class Case:
    """A scene with its camera.

    Attributes:
        name: "camera/scene".
        cylinders: One or several, in the camera frame.
        camera: The camera.
        distance_over_radius: Depth of the nearest center over its radius.
    """

    name: str
    cylinders: Cylinder
    camera: PinholeCamera | OrthographicCamera
    distance_over_radius: float


def cases(camera: str = "all") -> list[Case]:
    """All scenes, for one kind of camera or for "all"."""
    one_of("camera", camera, (*CAMERAS, "all"))
    kinds = CAMERAS if camera == "all" else (camera,)
    return [case for kind in kinds for case in (*_single(kind), *_many(kind))]


def _single(kind: str) -> list[Case]:
    def case(name, axis, distance=10.0, radius=0.05, slenderness=3.0, aside=(0.1, 0.2)):
        """A cylinder `distance` radii away, `slenderness` radii high, a bit `aside`."""
        center = np.array([*aside, 0.0]) + np.array([0.0, 0.0, distance])
        cylinder = Cylinder(center * radius, axis, radius, slenderness * radius)
        # From inside as wide a view as from one radius away.
        focal = RADIUS_PX * (max(distance, 1) if kind == "perspective" else 1 / radius)
        camera = _camera(kind, focal)
        return Case(f"{kind}/{name}", cylinder, camera, distance)

    across, along, oblique = (0.6, 0.8, 0.0), (0.0, 0.0, 1.0), (0.4, 0.6, 0.7)
    nearly = (math.sin(1e-3) * 0.6, math.sin(1e-3) * 0.8, math.cos(1e-3))
    found = [
        case("across", across),
        case("along", along),
        case("along, on its axis", along, aside=(0.0, 0.0)),
        case("nearly along", nearly),
        case("oblique", oblique),
        case("disc", oblique, slenderness=0.02),
        case("disc, edge on", across, slenderness=0.02),
        case("rod", oblique, slenderness=200.0, distance=150.0),
        case("rod, nearly along", nearly, slenderness=200.0, distance=150.0),
        case("partly out of frame", oblique, aside=(3.0, 1.5)),
    ]
    found += [
        case(f"radius {radius:g}", oblique, radius=radius)
        for radius in (1e-4, 1e-2, 1.0, 100.0)
    ]
    found += [
        case(f"distance {distance:g}", across, distance=distance, slenderness=2.0)
        for distance in (1.01, 1.05, 1.2, 2.0, 100.0, 1e3, 1e4)
    ]
    # Around the camera or beside it: behind it too, so that no billboard can be tight.
    found += [
        case("near, reaching behind", (0.3, 0.1, 1.0), distance=1.2, slenderness=20.0,
             aside=(1.6, 0.8)),
        case("between the cap planes", (0.0, 1.0, 0.1), distance=1.5, slenderness=40.0),
        case("inside", across, distance=0.3, slenderness=6.0),
        case("inside, along", along, distance=2.0, slenderness=6.0),
        case("inside, oblique", oblique, distance=0.5, slenderness=8.0),
    ]  # fmt: skip
    return found


def _many(kind: str) -> list[Case]:
    """Random cylinders that overlap; the closest wins."""
    found = []
    for count in (1, 100, 10000):
        rng = np.random.default_rng(count)
        # More of them are smaller, so that many are seen.
        radius = np.exp(rng.uniform(np.log(0.05), np.log(0.2), count)) / count**0.25
        z = rng.uniform(2.0, 6.0, count)
        x, y = rng.uniform(-0.6, 0.6, count), rng.uniform(-0.5, 0.5, count)
        if kind == "perspective":
            x, y, radius = x * z, y * z, radius * z
        axis = rng.normal(size=(count, 3))
        height = radius * np.exp(rng.uniform(np.log(0.5), np.log(10), count))
        cylinders = Cylinder(np.stack([x, y, z], axis=-1), axis, radius, height)
        focal = 110.0 if kind == "perspective" else 100.0
        name = f"{kind}/{count} cylinder{'s' if count > 1 else ''}"
        nearest = float(np.min(z / radius))
        # Finer, since edges fill most of an image of so many.
        found.append(Case(name, cylinders, _camera(kind, 2 * focal, 2), nearest))
    return found


def _camera(
    kind: str, focal: float, finer: int = 1
) -> PinholeCamera | OrthographicCamera:
    camera = PinholeCamera if kind == "perspective" else OrthographicCamera
    width, height = finer * WIDTH, finer * HEIGHT
    return camera(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)
