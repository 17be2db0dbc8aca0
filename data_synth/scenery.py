"""The kinds of things on a table that are no cylinders, as distributions."""

__all__ = [
    "SCENERY",
    "Arms",
    "Bags",
    "Balls",
    "Books",
    "Bottles",
    "Boxes",
    "Bumps",
    "Cones",
    "Corners",
    "Hands",
    "Mounds",
    "Pillars",
    "Rolls",
    "Scenery",
    "Things",
]

import dataclasses
from typing import ClassVar

import numpy as np
from typing_extensions import override

from data_synth.distribution import Distribution, check_positive
from data_synth.scenery_base import (
    Loose,
    Scenery,
    Shapes,
    Things,
    any_foot,
    any_turn,
    somewhere,
    turned_by,
)
from data_synth.scenery_soft import Arms, Bags, Bottles, Bumps, Hands, Rolls
from data_synth.solid import Cluster, Cuboid, Point, Round
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.sphere import Sphere


@dataclasses.dataclass(frozen=True)
class Boxes(Things):
    """Boxes that lie on a face.

    Attributes:
        edge: Length of each edge, in meters.
    """

    edge: Distribution

    shapes: ClassVar[Shapes] = Box, 1

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        size = np.array([self.edge.draw(rng) for _ in range(3)])
        return Loose(somewhere(_box("box", size), spread, rng))


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

    shapes: ClassVar[Shapes] = Box, 1

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        length, thick = self.length.draw(rng), self.thickness.draw(rng)
        size = np.array([thick, 0.75 * length, length])
        if rng.random() >= self.leaning:
            return Loose(somewhere(_box("book", size[[2, 1, 0]]), spread, rng))
        angle = np.radians(self.tilt.draw(rng))
        c, s = np.cos(angle), np.sin(angle)
        # The top goes towards -x; it stands on its edge on that side's far face.
        rotation = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        edge = rotation @ np.array([-thick, 0.0, -length]) / 2
        book = Cuboid("book", np.array([0.0, 0.0, -edge[2]]), rotation, size)
        turn = any_turn(rng)
        return Loose(book.transformed(turn, any_foot(spread, rng)), turn[:, 0])


@dataclasses.dataclass(frozen=True)
class Balls(Things):
    """Balls.

    Attributes:
        radius: In meters.
    """

    radius: Distribution

    shapes: ClassVar[Shapes] = Sphere, 1

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        radius = self.radius.draw(rng)
        ball = Cluster("ball", np.array([[0.0, 0.0, radius]]), np.array([radius]))
        return Loose(somewhere(ball, spread, rng))


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

    shapes: ClassVar[Shapes] = Frustum, 1

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
        cone = Round("cone", *np.array(ends), *map(float, radii))
        return Loose(somewhere(cone, spread, rng))


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

    shapes: ClassVar[Shapes] = Box, 1
    may_touch: ClassVar[bool] = False

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        size = np.array([part.draw(rng) for part in (*[self.width] * 2, self.height)])
        box = _box("pillar", size)
        turn = turned_by(np.radians(rng.uniform(20.0, 70.0)))
        aside, beyond = rng.uniform(-2 * spread, 2 * spread), self.beyond.draw(rng)
        foot = np.array([aside, beyond, 0.0]) + turn @ (size * [0.5, 0.5, 0.0])
        return Loose(box.transformed(turn, foot))


@dataclasses.dataclass(frozen=True)
class Corners(Scenery):
    """Corners of a room: two upright planes that meet at a right angle.

    Attributes:
        beyond: Distance of the edge from what the camera looks at, in meters.
    """

    beyond: Distribution

    shapes: ClassVar[Shapes] = Plane, 2

    def draw(
        self, spread: float, rng: np.random.Generator
    ) -> list[tuple[Point, Point]]:
        """Draw one: a point and a unit normal of each plane, in the table's frame."""
        aside = rng.uniform(-spread, spread)
        edge = np.array([aside, self.beyond.draw(rng), 0.0])
        turn = turned_by(np.radians(rng.uniform(-155.0, -115.0)))
        return [(edge, turn[:, k]) for k in range(2)]


@dataclasses.dataclass(frozen=True)
class Mounds(Scenery):
    """Rolling ground: caps of balls that lie under it, and that other things stand in.

    Attributes:
        height: Above the level ground, in meters.
        width: Half the width at the level ground, in meters.
    """

    height: Distribution
    width: Distribution

    def __post_init__(self) -> None:
        for name in ("height", "width"):
            check_positive(f"{name} of Mounds", getattr(self, name))

    shapes: ClassVar[Shapes] = Sphere, 1

    def draw(self, spread: float, rng: np.random.Generator) -> Cluster:
        """Draw one, anywhere within `spread` of the target, in the table's frame."""
        height, width = self.height.draw(rng), self.width.draw(rng)
        # Of the sagitta of a chord.
        radius = (width * width / height + height) / 2
        place = np.array([*rng.uniform(-spread, spread, 2), height - radius])
        return Cluster("mound", place[None], np.array([radius]))


SCENERY = (
    Boxes, Books, Balls, Cones, Hands, Arms, Bottles, Bags, Rolls, Bumps, Pillars,
    Corners, Mounds,
)  # fmt: skip
"""All kinds."""


def _box(kind: str, size: Point) -> Cuboid:
    """A box that lies on a face, over the origin."""
    return Cuboid(kind, np.array([0.0, 0.0, size[2] / 2]), np.eye(3), size)
