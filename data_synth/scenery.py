"""Things on a table that are no cylinders, and their distributions.

Each kind draws objects in the frame of the table: x aside, y away from the camera and z
up, with what the camera looks at in its origin. They rest on z = 0.
"""

__all__ = [
    "SCENERY",
    "Balls",
    "Books",
    "Boxes",
    "Bumps",
    "Cones",
    "Corners",
    "Hands",
    "Pillars",
    "Scenery",
]

import abc
import dataclasses
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from data_synth import solid
from data_synth.distribution import Distribution
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.sphere import Sphere

Point = Float[np.ndarray, "3"]

LINKS = 32
"""Balls of a finger, or of a bump: 2 mm apart, so that one of 8 mm is uneven by less
than 0.1 mm."""

FINGERS, METACARPALS = 5, 4
"""The balls of a hand are in so many rows."""


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
    """

    count: Distribution

    @property
    @abc.abstractmethod
    def shapes(self) -> tuple[type[AbstractPrimitive], int]:
        """What primitives one is made of, and how many."""


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


@dataclasses.dataclass(frozen=True)
class Boxes(Things):
    """Boxes that lie on a face.

    Attributes:
        edge: Length of each edge, in meters.
    """

    edge: Distribution

    @property
    @override
    def shapes(self) -> tuple[type[AbstractPrimitive], int]:
        return Box, 1

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        size = np.array([self.edge.draw(rng) for _ in range(3)])
        return Loose(_somewhere(_box("box", size), spread, rng))


@dataclasses.dataclass(frozen=True)
class Books(Things):
    """Thin boxes, that lie or lean on another object.

    Attributes:
        length: Of the longer edge, in meters; the other has three quarters of it.
        thickness: In meters.
        leaning: Share of those that lean.
        tilt: Of these, from upright, in degrees.
    """

    length: Distribution
    thickness: Distribution
    leaning: float
    tilt: Distribution

    @property
    @override
    def shapes(self) -> tuple[type[AbstractPrimitive], int]:
        return Box, 1

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        length, thick = self.length.draw(rng), self.thickness.draw(rng)
        size = np.array([thick, 0.75 * length, length])
        if rng.random() >= self.leaning:
            return Loose(_somewhere(_box("book", size[[2, 1, 0]]), spread, rng))
        angle = np.radians(self.tilt.draw(rng))
        c, s = np.cos(angle), np.sin(angle)
        # The top goes towards -x; it stands on its edge on that side's far face.
        rotation = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        edge = rotation @ np.array([-thick, 0.0, -length]) / 2
        book = solid.Cuboid("book", np.array([0.0, 0.0, -edge[2]]), rotation, size)
        turn = _turn(rng)
        return Loose(book.transformed(turn, _foot(spread, rng)), turn[:, 0])


@dataclasses.dataclass(frozen=True)
class Balls(Things):
    """Balls.

    Attributes:
        radius: In meters.
    """

    radius: Distribution

    @property
    @override
    def shapes(self) -> tuple[type[AbstractPrimitive], int]:
        return Sphere, 1

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        radius = self.radius.draw(rng)
        ball = solid.Cluster("ball", np.array([[0.0, 0.0, radius]]), np.array([radius]))
        return Loose(_somewhere(ball, spread, rng))


@dataclasses.dataclass(frozen=True)
class Cones(Things):
    """Frusta: cups of a small angle, and cones of a large one.

    Attributes:
        radius: Of the wider end, in meters.
        aspect: Height over that radius; less where the cone would come to a tip.
        half_angle: Between axis and wall, in degrees.
        inverted: Share of those that stand on the narrower end.
        lying: Share of those that lie on the wall.
    """

    radius: Distribution
    aspect: Distribution
    half_angle: Distribution
    inverted: float
    lying: float

    @property
    @override
    def shapes(self) -> tuple[type[AbstractPrimitive], int]:
        return Frustum, 1

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        wide, angle = self.radius.draw(rng), np.radians(self.half_angle.draw(rng))
        # A tip of a twentieth at least, on which a cone does not stand.
        height = min(wide * self.aspect.draw(rng), 0.95 * wide / np.tan(angle))
        narrow = wide - height * np.tan(angle)
        radii, way = [wide, narrow], rng.random()
        if way < self.lying:
            ends = [[0.0, 0.0, wide * np.cos(angle)]]
            reach = height * np.cos(angle)
            ends.append([reach, 0.0, narrow * np.cos(angle)])
        else:
            if way < self.lying + self.inverted and narrow > wide / 2:
                radii.reverse()
            ends = [[0.0, 0.0, 0.0], [0.0, 0.0, height]]
        cone = solid.Round("cone", *np.array(ends), *map(float, radii))
        return Loose(_somewhere(cone, spread, rng))


@dataclasses.dataclass(frozen=True)
class Hands(Things):
    """Hands that lie on the table, palm down: rows of balls, tapered and bent.

    Attributes:
        length: From the wrist to the longest finger's tip, in meters.
    """

    length: Distribution

    may_touch: ClassVar[bool] = False

    @property
    @override
    def shapes(self) -> tuple[type[AbstractPrimitive], int]:
        return Sphere, LINKS * (FINGERS + METACARPALS)

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        def vary(value: float) -> float:
            return value * rng.uniform(0.85, 1.15)

        side = rng.choice([-1.0, 1.0])
        fan, curl = rng.uniform(0.0, 0.12), rng.uniform(0.6, 1.0)
        rows = []
        # In millimeters of a hand of 185: the knuckle aside, the length and the radius.
        for aside, long, wide in (
            (30.0, 72.0, 9.0),
            (10.0, 80.0, 9.5),
            (-10.0, 74.0, 9.0),
            (-29.0, 58.0, 7.5),
        ):
            long, wide, aside = vary(long), vary(wide), side * aside
            turn = fan * aside / 10 + rng.uniform(-0.08, 0.08)
            knuckle = np.array([0.0, aside, vary(26.0)])
            reach = curl * long * np.array([np.cos(turn), np.sin(turn), 0.0])
            lift = np.array([0.0, rng.uniform(-4, 4), vary(12.0) + 40 * (1 - curl)])
            tip = knuckle * [1, 1, 0] + reach + [0.0, 0.0, 0.75 * wide]
            between = knuckle + 0.55 * reach + lift
            rows.append(_row((knuckle, between, tip), (1.15 * wide, 0.72 * wide), 0.06))
            wrist = np.array([-vary(85.0), 0.5 * aside, vary(20.0)])
            middle = (knuckle + wrist) / 2 + [0.0, 0.0, 4.0]
            rows.append(_row((knuckle, middle, wrist), (1.3 * wide, vary(17.0)), 0.0))
        thumb = np.array(
            [[-60.0, 20.0, 19.0], [-45.0, 62.0, vary(24.0)], [vary(8.0), 66.0, 8.0]]
        )
        rows.append(_row(thumb * [1.0, side, 1.0], (vary(15.0), vary(8.5)), 0.05))
        center, radius = (np.concatenate(parts) for parts in zip(*rows, strict=True))
        center[:, 2] -= np.min(center[:, 2] - radius)
        scale = self.length.draw(rng) / 185.0
        hand = solid.Cluster("hand", scale * center, scale * radius)
        return Loose(_somewhere(hand, spread, rng))


@dataclasses.dataclass(frozen=True)
class Bumps(Things):
    """Prolate ellipsoids, as rows of balls, of which the table shows the upper part.

    Attributes:
        width: Half of the shorter axes, in meters.
        aspect: Longer over shorter axis, from 1.
        part: Of the half width that is above the table, up to 2.
    """

    width: Distribution
    aspect: Distribution
    part: Distribution

    may_touch: ClassVar[bool] = False

    @property
    @override
    def shapes(self) -> tuple[type[AbstractPrimitive], int]:
        return Sphere, LINKS

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        short = self.width.draw(rng)
        focus = short * np.sqrt(self.aspect.draw(rng) ** 2 - 1)
        # The largest balls in an ellipsoid: their centers end before the foci.
        end = focus**2 / np.hypot(focus, short)
        along = np.linspace(-end, end, LINKS)
        radius = short * np.sqrt(1 - np.square(along / max(focus, 1e-9)))
        height = np.full(LINKS, short * (self.part.draw(rng) - 1))
        center = np.stack([along, np.zeros(LINKS), height], axis=1)
        return Loose(_somewhere(solid.Cluster("bump", center, radius), spread, rng))


@dataclasses.dataclass(frozen=True)
class Pillars(Things):
    """Large upright boxes behind the others, a vertical edge towards the camera.

    Attributes:
        width: Of the two faces beside that edge, in meters.
        height: In meters.
        beyond: Distance of the edge from what the camera looks at, in meters.
    """

    width: Distribution
    height: Distribution
    beyond: Distribution

    may_touch: ClassVar[bool] = False

    @property
    @override
    def shapes(self) -> tuple[type[AbstractPrimitive], int]:
        return Box, 1

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        size = np.array([distribution.draw(rng) for distribution in (self.width,) * 2])
        box = _box("pillar", np.array([*size, self.height.draw(rng)]))
        edge = box.center - np.array([*size / 2, box.center[2]])
        turn = _turned_by(np.radians(rng.uniform(20.0, 70.0)))
        aside, beyond = rng.uniform(-2 * spread, 2 * spread), self.beyond.draw(rng)
        foot = np.array([aside, beyond, 0.0]) - turn @ edge
        return Loose(box.transformed(turn, foot))


@dataclasses.dataclass(frozen=True)
class Corners(Scenery):
    """Corners of a room: two upright planes that meet at a right angle.

    Attributes:
        beyond: Distance of the edge from what the camera looks at, in meters.
    """

    beyond: Distribution

    @property
    @override
    def shapes(self) -> tuple[type[AbstractPrimitive], int]:
        return Plane, 2

    def draw(
        self, spread: float, rng: np.random.Generator
    ) -> list[tuple[Point, Point]]:
        """Draw one: a point and a unit normal of each plane, in the table's frame."""
        aside = rng.uniform(-spread, spread)
        edge = np.array([aside, self.beyond.draw(rng), 0.0])
        turn = _turned_by(np.radians(rng.uniform(-155.0, -115.0)))
        return [(edge, turn[:, k]) for k in range(2)]


SCENERY = (Boxes, Books, Balls, Cones, Hands, Bumps, Pillars, Corners)
"""All kinds."""


def _box(kind: str, size: Point) -> solid.Cuboid:
    """A box that lies on a face, over the origin."""
    return solid.Cuboid(kind, np.array([0.0, 0.0, size[2] / 2]), np.eye(3), size)


def _turned_by(angle: float) -> Float[np.ndarray, "3 3"]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _turn(rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    """Any turn about the vertical."""
    return _turned_by(rng.uniform(0, 2 * np.pi))


def _foot(spread: float, rng: np.random.Generator) -> Point:
    return np.array([*rng.uniform(-spread, spread, 2), 0.0])


def _somewhere(
    what: solid.Object, spread: float, rng: np.random.Generator
) -> solid.Object:
    """An object with any turn, anywhere on the table."""
    return what.transformed(_turn(rng), _foot(spread, rng))


def _row(
    points: tuple[Point, Point, Point], radii: tuple[float, float], swell: float
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Balls along a bent line, from one radius to another, thicker at three joints."""
    t = np.linspace(0.0, 1.0, LINKS)
    weights = np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=1)
    radius = (radii[0] + t * (radii[1] - radii[0])) * (
        1 + swell * np.cos(4 * np.pi * t)
    )
    return weights @ np.array(points), radius
