"""Spheres, where a user goes and at the limits, alone and among cylinders; and tori."""

__all__ = ["many_spheres", "mixed_primitives", "single_spheres", "single_tori"]

import numpy as np

from impostor_jax.glsl.case import (
    Case,
    camera_on,
    scattered,
    scattered_case,
)
from impostor_jax.glsl.cylinder_cases import random_cylinders
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.torus import Torus


def single_spheres(kind: str) -> list[Case]:
    """One sphere, of many sizes and at many distances."""

    def case(name, distance=10.0, radius=0.05, aside=(0.1, 0.2)):
        """A sphere `distance` radii away, a bit `aside`."""
        center = np.array([*aside, distance])
        camera = camera_on(kind, distance, radius)
        return Case(f"{kind}/{name}", Sphere(center * radius, radius), camera, distance)

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
        camera = camera_on(kind, distance, 0.05)
        return Case(f"{kind}/{name}", torus, camera, distance)

    return [
        case("torus", 0.4),
        case("torus, hardly a hole", 0.99),
        case("torus, far", 0.3, 1e3),
        case("torus, edge on", 0.3, axis=(0.0, 1.0, 0.0), aside=(0.0, 0.0)),
        case("torus, partly out of frame", 0.4, aside=(3.0, 1.5)),
    ]


def many_spheres(kind: str) -> list[Case]:
    """Random spheres that overlap; the closest wins."""
    spheres = Sphere(*scattered(np.random.default_rng(0), kind, 100))
    return [scattered_case(f"{kind}/100 spheres", kind, spheres)]


def mixed_primitives(kind: str) -> list[Case]:
    """Random cylinders and spheres that overlap, a batch of each and a single one."""
    rng = np.random.default_rng(1)
    one = Sphere((0.1, 0.2, 3.0), 0.3)
    cylinders = random_cylinders(rng, kind, 100)
    spheres = Sphere(*scattered(rng, kind, 100))
    several = (one, cylinders, spheres)
    return [scattered_case(f"{kind}/cylinders and spheres", kind, several)]
