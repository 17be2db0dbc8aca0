"""Analytic shapes that a ray can be cast at."""

__all__ = ["PRIMITIVES", "AbstractPrimitive", "Cylinder"]

from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder

PRIMITIVES: dict[str, type[AbstractPrimitive]] = {"cylinder": Cylinder}
