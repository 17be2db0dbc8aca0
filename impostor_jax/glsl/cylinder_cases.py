"""Cylinders, where a user goes and at the limits."""

__all__ = ["many_cylinders", "random_cylinders", "single_cylinders"]

import math

import numpy as np

from impostor_jax.glsl.case import (
    Case,
    camera_on,
    scattered,
    scattered_case,
)
from impostor_jax.primitives.cylinder import Cylinder


def single_cylinders(kind: str) -> list[Case]:
    """One cylinder, of many shapes and at many distances."""

    def case(name, axis, distance=10.0, radius=0.05, slenderness=3.0, aside=(0.1, 0.2)):
        """A cylinder `distance` radii away, `slenderness` radii high, a bit `aside`."""
        center = np.array([*aside, 0.0]) + np.array([0.0, 0.0, distance])
        cylinder = Cylinder(center * radius, axis, radius, slenderness * radius)
        camera = camera_on(kind, distance, radius)
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


def many_cylinders(kind: str) -> list[Case]:
    """Random cylinders that overlap; the closest wins."""
    found = []
    for count in (1, 100, 10000):
        cylinders = random_cylinders(np.random.default_rng(count), kind, count)
        name = f"{kind}/{count} cylinder{'s' if count > 1 else ''}"
        found.append(scattered_case(name, kind, cylinders))
    return found


def random_cylinders(rng: np.random.Generator, kind: str, count: int) -> Cylinder:
    """A batch of cylinders in front of a camera, in every direction."""
    center, radius = scattered(rng, kind, count)
    axis = rng.normal(size=(count, 3))
    height = radius * np.exp(rng.uniform(np.log(0.5), np.log(10), count))
    return Cylinder(center, axis, radius, height)
