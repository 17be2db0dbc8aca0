"""Solids that are put on a table, each known by its farthest point in a direction.

What is not convex counts as its hull where distances are taken.
"""

__all__ = ["Cluster", "Cuboid", "Object", "Point", "Round", "Solid", "across_to"]

import abc
import dataclasses
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere

Point = Float[np.ndarray, "3"]


class Solid(abc.ABC):
    """What others must keep clear of; a primitive of the package shows it."""

    primitive: ClassVar[type[AbstractPrimitive]]

    @property
    @abc.abstractmethod
    def is_convex(self) -> bool:
        """Whether it is its own hull."""

    @property
    @abc.abstractmethod
    def middle(self) -> Point:
        """A point within."""

    @property
    @abc.abstractmethod
    def reach(self) -> float:
        """Radius of a ball around the middle that holds it."""

    @abc.abstractmethod
    def farthest(self, direction: Point) -> Point:
        """The point of it that is farthest in a direction, of any length but 0."""

    @abc.abstractmethod
    def moved(self, by: Point) -> "Solid":
        """The same solid elsewhere."""

    @abc.abstractmethod
    def arguments(self) -> dict[str, Any]:
        """Those of its primitive, of one shape or of a batch of them."""


@dataclasses.dataclass(frozen=True)
class Object(Solid):
    """A thing that is no cylinder.

    Attributes:
        kind: What it is, for a reader.
    """

    kind: str

    @abc.abstractmethod
    def transformed(self, rotation: Float[np.ndarray, "3 3"], by: Point) -> "Object":
        """The same thing turned, and then moved."""

    def record(self) -> dict[str, Any]:
        """The kind, the name of the primitive, and its arguments, for a JSON file."""
        values = {
            name: np.asarray(value).tolist() for name, value in self.arguments().items()
        }
        return {"kind": self.kind, "type": self.primitive.__name__.lower(), **values}

    @override
    def moved(self, by: Point) -> "Object":
        return self.transformed(np.eye(3), by)


@dataclasses.dataclass(frozen=True)
class Cuboid(Object):
    """A box.

    Attributes:
        center: In meters.
        rotation: Its columns are the directions of the edges.
        size: Lengths of these, in meters.
    """

    center: Point
    rotation: Float[np.ndarray, "3 3"]
    size: Point
    primitive = Box

    @property
    @override
    def is_convex(self) -> bool:
        return True

    @property
    @override
    def middle(self) -> Point:
        return self.center

    @property
    @override
    def reach(self) -> float:
        return float(np.linalg.norm(self.size)) / 2

    @override
    def farthest(self, direction: Point) -> Point:
        side = np.where(direction @ self.rotation > 0, 0.5, -0.5)
        return self.center + self.rotation @ (side * self.size)

    @override
    def transformed(self, rotation: Float[np.ndarray, "3 3"], by: Point) -> "Cuboid":
        center, turned = rotation @ self.center + by, rotation @ self.rotation
        return dataclasses.replace(self, center=center, rotation=turned)

    @override
    def arguments(self) -> dict[str, Any]:
        return {"center": self.center, "rotation": self.rotation, "size": self.size}


@dataclasses.dataclass(frozen=True)
class Round(Object):
    """A frustum of a cone.

    Attributes:
        p1: Middle of the one end, in meters.
        p2: Middle of the other.
        radius1: At p1, in meters.
        radius2: At p2.
    """

    p1: Point
    p2: Point
    radius1: float
    radius2: float
    primitive = Frustum

    @property
    @override
    def is_convex(self) -> bool:
        return True

    @property
    @override
    def middle(self) -> Point:
        return (self.p1 + self.p2) / 2

    @property
    @override
    def reach(self) -> float:
        half = float(np.linalg.norm(self.p2 - self.p1)) / 2
        return float(np.hypot(half, max(self.radius1, self.radius2)))

    @override
    def farthest(self, direction: Point) -> Point:
        across = across_to(self.p2 - self.p1, direction)
        p1, p2 = self.p1 + self.radius1 * across, self.p2 + self.radius2 * across
        return p2 if direction @ p2 > direction @ p1 else p1

    @override
    def transformed(self, rotation: Float[np.ndarray, "3 3"], by: Point) -> "Round":
        p1, p2 = (rotation @ point + by for point in (self.p1, self.p2))
        return dataclasses.replace(self, p1=p1, p2=p2)

    @override
    def arguments(self) -> dict[str, Any]:
        names = ("p1", "p2", "radius1", "radius2")
        return {name: getattr(self, name) for name in names}


@dataclasses.dataclass(frozen=True)
class Cluster(Object):
    """One ball, or a body that is made of many.

    Attributes:
        center: In meters.
        radius: In meters.
    """

    center: Float[np.ndarray, "n 3"]
    radius: Float[np.ndarray, " n"]
    primitive = Sphere

    @property
    @override
    def is_convex(self) -> bool:
        return len(self.radius) == 1

    @property
    @override
    def middle(self) -> Point:
        return self.center.mean(axis=0)

    @property
    @override
    def reach(self) -> float:
        away = np.linalg.norm(self.center - self.middle, axis=1)
        return float(np.max(away + self.radius))

    @override
    def farthest(self, direction: Point) -> Point:
        toward = direction / np.linalg.norm(direction)
        k = np.argmax(self.center @ toward + self.radius)
        return self.center[k] + self.radius[k] * toward

    @override
    def transformed(self, rotation: Float[np.ndarray, "3 3"], by: Point) -> "Cluster":
        return dataclasses.replace(self, center=self.center @ rotation.T + by)

    @override
    def arguments(self) -> dict[str, Any]:
        return {"center": self.center, "radius": self.radius}


def across_to(axis: Point, direction: Point) -> Point:
    """Unit vector across an axis that goes most in a direction; 0 if none does."""
    across = direction - (direction @ axis) / (axis @ axis) * axis
    length = np.linalg.norm(across)
    # Of a direction along the axis only rounding is left.
    return across / length if length > 1e-9 * np.linalg.norm(direction) else 0 * across
