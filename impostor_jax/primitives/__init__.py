"""Analytic shapes that a ray can be cast at."""

__all__ = [
    "PRIMITIVES",
    "AbstractPrimitive",
    "Box",
    "Cylinder",
    "Frustum",
    "Plane",
    "Sphere",
]

from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.sphere import Sphere

PRIMITIVES: dict[str, type[AbstractPrimitive]] = {
    "box": Box,
    "cylinder": Cylinder,
    "frustum": Frustum,
    "plane": Plane,
    "sphere": Sphere,
}
