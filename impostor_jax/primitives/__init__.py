"""Analytic shapes that a ray can be cast at."""

__all__ = ["PRIMITIVES", "AbstractPrimitive", "Cylinder", "Frustum", "Sphere"]

from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere

PRIMITIVES: dict[str, type[AbstractPrimitive]] = {
    "cylinder": Cylinder,
    "frustum": Frustum,
    "sphere": Sphere,
}
