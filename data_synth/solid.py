"""Solids on a table: how far apart they are, and where one that slides meets another.

Each is known by its support function, how far it reaches in a direction. Two convex
solids are apart by the widest gap between two parallel planes that separate them; a
search among the planes' normals never finds more than that, so that what it calls apart
is apart. What is not convex counts as its hull.
"""

__all__ = [
    "Cluster",
    "Cuboid",
    "Object",
    "Round",
    "Solid",
    "are_apart",
    "sine_to",
    "slide_to_touch",
]

import abc
import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar, Self

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere

Point = Float[np.ndarray, "3"]
Directions = Float[np.ndarray, "m 3"]

FIRST = 256
"""Normals that the search begins with, evenly over the sphere."""

NEXT = 32
"""Normals that it tries around the best one, again and again."""

ROUNDS, NARROWER = 20, 0.6
"""How often, and by how much they are closer each time: at last to 1e-5."""


class Solid(abc.ABC):
    """What others must keep clear of."""

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
    def support(self, direction: Directions) -> Float[np.ndarray, " m"]:
        """How far it reaches in directions: the largest product with a point of it."""

    @abc.abstractmethod
    def moved(self, by: Point) -> Self:
        """The same solid elsewhere."""


@dataclasses.dataclass(frozen=True)
class Object(Solid):
    """A thing that is no cylinder, as the package renders it.

    Attributes:
        kind: What it is, for a reader.
    """

    kind: str
    primitive: ClassVar[type[AbstractPrimitive]]

    @abc.abstractmethod
    def transformed(self, rotation: Float[np.ndarray, "3 3"], by: Point) -> Self:
        """The same thing turned, and then moved."""

    def record(self) -> dict[str, Any]:
        """The kind, the name of the primitive, and its arguments, for a JSON file."""
        values = {
            name: np.asarray(value).tolist() for name, value in self.arguments().items()
        }
        return {"kind": self.kind, "type": self.primitive.__name__.lower(), **values}

    @override
    def moved(self, by: Point) -> Self:
        return self.transformed(np.eye(3), by)

    @abc.abstractmethod
    def arguments(self) -> dict[str, Any]:
        """Those of its primitive, of one shape or of a batch of them."""


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
    def support(self, direction: Directions) -> Float[np.ndarray, " m"]:
        return direction @ self.center + np.abs(direction @ self.rotation) @ (
            self.size / 2
        )

    @override
    def transformed(self, rotation: Float[np.ndarray, "3 3"], by: Point) -> Self:
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
    def support(self, direction: Directions) -> Float[np.ndarray, " m"]:
        along = self.p2 - self.p1
        across = sine_to(direction, along / np.linalg.norm(along))
        return np.maximum(
            direction @ self.p1 + self.radius1 * across,
            direction @ self.p2 + self.radius2 * across,
        )

    @override
    def transformed(self, rotation: Float[np.ndarray, "3 3"], by: Point) -> Self:
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
    def support(self, direction: Directions) -> Float[np.ndarray, " m"]:
        return np.max(direction @ self.center.T + self.radius, axis=1)

    @override
    def transformed(self, rotation: Float[np.ndarray, "3 3"], by: Point) -> Self:
        return dataclasses.replace(self, center=self.center @ rotation.T + by)

    @override
    def arguments(self) -> dict[str, Any]:
        return {"center": self.center, "radius": self.radius}


def sine_to(direction: Directions, axis: Point) -> Float[np.ndarray, " m"]:
    """Sine of the angle between unit directions and an axis."""
    return np.sqrt(np.maximum(1 - (direction @ axis) ** 2, 0))


def are_apart(one: Solid, other: Solid, gap: float) -> bool:
    """Whether two solids are surely apart by more than a gap, in meters."""
    between = one.middle - other.middle
    if np.linalg.norm(between) > one.reach + other.reach + gap:
        return True
    return _largest(lambda n: _gap(one, other, n), between, enough=gap) > gap


def slide_to_touch(one: Solid, other: Solid, along: Point, gap: float) -> float:
    """How far a solid has to be moved for a gap to another, to some micrometers.

    Args:
        one: It moves.
        other: It stays.
        along: Unit vector along which it moves.
        gap: In meters.

    Returns:
        In meters; negative where they are apart from the beginning, `-inf` where they
        are whatever the move.
    """

    def less(n: Directions) -> Float[np.ndarray, " m"]:
        """What makes the move shorter: a plane is passed where it opens the gap."""
        opens = n @ along
        ahead = opens > 1e-6
        length = (_gap(one, other, n) - gap) / np.where(ahead, opens, 1)
        return np.where(ahead, length, -np.inf)

    return -_largest(less, one.middle - other.middle)


def _gap(one: Solid, other: Solid, n: Directions) -> Float[np.ndarray, " m"]:
    """Width between the planes across n that touch both, from the other to the one."""
    return -one.support(-n) - other.support(n)


def _evenly(count: int) -> Directions:
    """Directions over the sphere, on a spiral."""
    place = np.arange(count) + 0.5
    z, turn = 1 - 2 * place / count, np.pi * (1 + 5**0.5) * place
    across = np.sqrt(1 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


NORMALS = _evenly(FIRST)
AROUND = np.concatenate([_evenly(NEXT // 2), _evenly(NEXT // 2)[:, [2, 0, 1]] / 2])


def _largest(
    value: Callable[[Directions], Float[np.ndarray, " m"]],
    guess: Point,
    enough: float = np.inf,
) -> float:
    """Largest value over unit vectors, of a function with one hill; or more than enough.

    Args:
        value: The function.
        guess: A direction to begin with, of any length.
        enough: Where the search may end.
    """
    length = float(np.linalg.norm(guess))
    first = NORMALS if length == 0 else np.vstack([NORMALS, guess / length])
    values = value(first)
    best, place = float(values.max()), first[values.argmax()]
    width = 0.3
    for _ in range(ROUNDS):
        if best > enough:
            break
        near = place + width * AROUND
        near /= np.linalg.norm(near, axis=1, keepdims=True)
        values = value(near)
        if values.max() > best:
            best, place = float(values.max()), near[values.argmax()]
        width *= NARROWER
    return best
