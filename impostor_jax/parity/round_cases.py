"""Cylinders, spheres, tori and frusta, where a user goes and at the limits."""

__all__ = [
    "many_cylinders",
    "many_spheres",
    "mixed_primitives",
    "single_cylinders",
    "single_frusta",
    "single_spheres",
    "single_tori",
]

import math

import numpy as np

from impostor_jax.parity.case import Case, camera_on, scattered_case, scattered_places
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.torus import Torus


def single_cylinders(kind: str) -> list[Case]:
    """One cylinder, of many shapes and at many distances."""

    def case(name, axis, distance=10.0, radius=0.05, slenderness=3.0, aside=(0.1, 0.2)):
        """A cylinder `distance` radii away, `slenderness` radii high, a bit `aside`."""
        center = np.array([*aside, 0.0]) + np.array([0.0, 0.0, distance])
        cylinder = Cylinder(center * radius, axis, radius, slenderness * radius)
        camera = camera_on(kind, distance, radius)
        return Case(f"{kind}/{name}", cylinder, camera)

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


def many_cylinders(kind: str) -> list[Case]:
    """Random cylinders that overlap; the closest wins."""
    found = []
    for count in (1, 100, 10000):
        cylinders = _random_cylinders(np.random.default_rng(count), kind, count)
        name = f"{kind}/{count} cylinder{'s' if count > 1 else ''}"
        found.append(scattered_case(name, kind, cylinders))
    return found


def single_spheres(kind: str) -> list[Case]:
    """One sphere, of many sizes and at many distances."""

    def case(name, distance=10.0, radius=0.05, aside=(0.1, 0.2)):
        """A sphere `distance` radii away, a bit `aside`."""
        center = np.array([*aside, distance])
        camera = camera_on(kind, distance, radius)
        return Case(f"{kind}/{name}", Sphere(center * radius, radius), camera)

    found = [case(f"sphere, radius {r:g}", radius=r) for r in (1e-4, 1e-2, 1.0, 100.0)]
    # Ahead of the camera, whose distance from the center is then the depth.
    found += [
        case(f"sphere, distance {distance:g}", distance, aside=(0.01, 0.02))
        for distance in (1.01, 1.05, 1.2, 2.0, 100.0, 1e3, 1e4)
    ]
    found += [
        case("sphere, partly out of frame", aside=(3.0, 1.5)),
        case("sphere, far from the axis", 3.0, aside=(2.0, -1.5)),
        case("sphere, reaching behind", 0.5, aside=(1.2, 0.6)),
        case("inside a sphere", 0.3, aside=(0.4, -0.2)),
        case("inside a sphere, near its wall", 0.6, aside=(0.7, -0.38)),
    ]
    return found


def single_tori(kind: str) -> list[Case]:
    """One torus, from thin to almost without a hole."""

    def case(name, minor, distance=10.0, axis=(0.3, -0.6, 0.7), aside=(0.1, 0.2)):
        """A torus `distance` major radii away, a bit `aside`."""
        center = np.array([*aside, distance]) * 0.05
        torus = Torus(center, axis, 0.05, minor * 0.05)
        return Case(f"{kind}/{name}", torus, camera_on(kind, distance, 0.05))

    return [
        case("torus", 0.4),
        case("torus, hardly a hole", 0.99),
        case("torus, far", 0.3, 1e3),
        case("torus, edge on", 0.3, axis=(0.0, 1.0, 0.0), aside=(0.0, 0.0)),
        case("torus, partly out of frame", 0.4, aside=(3.0, 1.5)),
    ]


def many_spheres(kind: str) -> list[Case]:
    """Random spheres that overlap; the closest wins."""
    spheres = Sphere(*scattered_places(np.random.default_rng(0), kind, 100))
    return [scattered_case(f"{kind}/100 spheres", kind, spheres)]


def mixed_primitives(kind: str) -> list[Case]:
    """Random cylinders and spheres that overlap, a batch of each and a single one."""
    rng = np.random.default_rng(1)
    one = Sphere((0.1, 0.2, 3.0), 0.3)
    cylinders = _random_cylinders(rng, kind, 100)
    spheres = Sphere(*scattered_places(rng, kind, 100))
    several = (one, cylinders, spheres)
    return [scattered_case(f"{kind}/cylinders and spheres", kind, several)]


def single_frusta(kind: str) -> list[Case]:
    """One frustum, of many shapes and at many distances."""
    radius, oblique = 0.05, (0.4, 0.6, 0.7)
    across, away = (1.0, 0.2, 0.0), (-0.3, 0.4, -0.8)
    small, large = (0.5, 2.0, across), (2.0, 2 * math.pi + 0.5, across)

    def placed(name, make, axis, distance, slenderness, aside):
        """A body `distance` radii away, `slenderness` radii long, a bit `aside`."""
        center = np.array([*aside, distance]) * radius
        way = slenderness * radius * np.array(axis) / np.linalg.norm(axis)
        camera = camera_on(kind, distance, radius)
        return Case(f"{kind}/{name}", make(center, way), camera)

    def case(name, axis=oblique, distance=10.0, slenderness=3.0, aside=(0.1, 0.2),
             ratio=0.4, sector=(), **openings):  # fmt: skip
        """A frustum that narrows to `ratio` of its radius."""

        def make(center, way):
            ends = center - way / 2, center + way / 2
            return Frustum(*ends, radius, ratio * radius, *sector, **openings)

        return placed(name, make, axis, distance, slenderness, aside)

    def pipe(center, way):
        return Cylinder(center, way, radius, 3 * radius, *large, caps=False)

    return [
        case("frustum"),
        case("frustum, pointed", (0.6, 0.8, 0.1), ratio=0.0),
        case("frustum, nearly a cylinder", ratio=1 + 1e-6),
        case("frustum, far", distance=1e3),
        case("frustum, partly out of frame", aside=(3.0, 1.5)),
        case("frustum, reaching behind", (0.3, 0.1, 1.0), distance=1.2,
             slenderness=20.0, aside=(1.6, 0.8)),
        case("inside a frustum", away, distance=0.5, slenderness=8.0),
        case("sector of less than half a turn", sector=small),
        case("sector of more than half a turn", sector=large),
        case("frustum, open", away, caps=False),
        placed("sector of a cylinder, open", pipe, away, 10.0, 3.0, (0.1, 0.2)),
    ]  # fmt: skip


def _random_cylinders(rng: np.random.Generator, kind: str, count: int) -> Cylinder:
    """A batch of cylinders in front of a camera, in every direction."""
    center, radius = scattered_places(rng, kind, count)
    axis = rng.normal(size=(count, 3))
    height = radius * np.exp(rng.uniform(np.log(0.5), np.log(10), count))
    return Cylinder(center, axis, radius, height)
