"""Shapes that a ray can be cast at."""

__all__ = [
    "PRIMITIVES",
    "AbstractPrimitive",
    "Box",
    "Cylinder",
    "Frustum",
    "Heightfield",
    "Plane",
    "Solid",
    "Sphere",
    "Torus",
    "Triangle",
]

from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.solid import Solid
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.torus import Torus
from impostor_jax.primitives.triangle import Triangle

PRIMITIVES: dict[str, type[AbstractPrimitive]] = {
    "box": Box,
    "cylinder": Cylinder,
    "frustum": Frustum,
    "heightfield": Heightfield,
    "plane": Plane,
    "sphere": Sphere,
    "torus": Torus,
    "triangle": Triangle,
}
