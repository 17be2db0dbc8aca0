"""Shapes that a ray can be cast at."""

__all__ = ["PRIMITIVES", "AbstractPrimitive", "Cylinder", "Heightfield", "Sphere"]

from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.sphere import Sphere

PRIMITIVES: dict[str, type[AbstractPrimitive]] = {
    "cylinder": Cylinder,
    "heightfield": Heightfield,
    "sphere": Sphere,
}
