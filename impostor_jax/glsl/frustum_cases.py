"""Frusta, cones and what is cut from them; cylinders that are open or a sector."""

__all__ = ["single_frusta"]

import math

import numpy as np

from impostor_jax.glsl.case import Case, camera_on
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum


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
        return Case(f"{kind}/{name}", make(center, way), camera, distance)

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
