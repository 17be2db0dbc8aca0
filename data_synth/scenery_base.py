"""What all kinds of scenery have in common.

Each kind draws objects in the frame of the table: x aside, y away from the camera and z
up, with what the camera looks at in its origin. They rest on z = 0.
"""

__all__ = [
    "Loose",
    "Scenery",
    "Shapes",
    "Things",
    "any_foot",
    "any_turn",
    "somewhere",
    "turned_by",
]

import abc
import dataclasses
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float

from data_synth import solid
from data_synth.distribution import Distribution, check_not_negative
from data_synth.solid import Point
from impostor_jax.primitives.base import AbstractPrimitive

Shapes = tuple[type[AbstractPrimitive], int]
"""A type of primitives, and a number of them."""


class Loose(NamedTuple):
    """An object that is yet to be put among others.

    Attributes:
        object: In the table's frame.
        leans: Direction in which it has to be moved away from another object, which
            then holds it; None for one that stands by itself.
    """

    object: solid.Object
    leans: Point | None = None


@dataclasses.dataclass(frozen=True)
class Scenery(abc.ABC):
    """Objects of a kind.

    Attributes:
        count: How many are in an image.
        shapes: What primitives one is made of, and how many.
        signed: Names of the attributes that may be negative.
    """

    count: Distribution

    shapes: ClassVar[Shapes]
    signed: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            if field.name not in self.signed:
                name = f"{field.name} of {type(self).__name__}"
                check_not_negative(name, getattr(self, field.name))


@dataclasses.dataclass(frozen=True)
class Things(Scenery):
    """Objects of a kind that take up room.

    Attributes:
        may_touch: Whether one may be moved until it is in contact with another.
    """

    may_touch: ClassVar[bool] = True

    @abc.abstractmethod
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        """Draw one.

        Args:
            spread: Of objects around what the camera looks at, in meters.
            rng: Source of all that is drawn.
        """


def turned_by(angle: float) -> Float[np.ndarray, "3 3"]:
    """A turn about the vertical, by an angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def any_turn(rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    """Any turn about the vertical."""
    return turned_by(rng.uniform(0, 2 * np.pi))


def any_foot(spread: float, rng: np.random.Generator) -> Point:
    """A place on the table."""
    return np.array([*rng.uniform(-spread, spread, 2), 0.0])


def somewhere(
    what: solid.Object, spread: float, rng: np.random.Generator
) -> solid.Object:
    """An object with any turn, anywhere on the table."""
    return what.transformed(any_turn(rng), any_foot(spread, rng))
