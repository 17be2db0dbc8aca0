"""Putting things one by one: apart from those that are there, or in contact."""

__all__ = ["PLACINGS", "Arrangement", "Plane", "Put"]

from collections.abc import Callable, Sequence

import numpy as np

from data_synth.contact import are_apart, slide_to_touch
from data_synth.pose import GAP, Pose, are_capsules_apart
from data_synth.solid import Object, Point, Solid

PLACINGS = 50
"""Places that are tried for a thing, or a lamp, before the scene is given up."""

CONTACT = 0.001
"""Largest gap of things that are put in contact, in meters."""

NEAREST = np.array([0.0, 0.0, 0.25]), np.array([0.0, 0.0, 1.0])
"""The plane before the camera that things on a table do not reach, in meters."""

Plane = tuple[Point, Point]
"""A point and a unit normal."""

Put = tuple[Solid, Solid | None]
"""A thing, and another one that it touches."""


class Arrangement:
    """The things of a scene, in the camera's frame.

    Args:
        target: What the camera looks at.
        up: Unit normal of the ground, which is there.
        walls: Planes that things stay before.
        is_exact: Whether distances are those of the things. Else they are those of the
            capsules around cylinders, nothing touches, and walls do not count.
        rng: Source of all that is drawn.
    """

    def __init__(
        self,
        target: Point,
        up: Point,
        walls: Sequence[Plane],
        is_exact: bool,
        rng: np.random.Generator,
    ):
        self.things: list[Solid] = []
        self.target, self.up, self.rng = target, up, rng
        self._walls, self._is_exact = (NEAREST, *walls), is_exact

    @property
    def poses(self) -> tuple[Pose, ...]:
        """The cylinders."""
        return tuple(thing for thing in self.things if isinstance(thing, Pose))

    @property
    def scenery(self) -> tuple[Object, ...]:
        """The other things."""
        return tuple(thing for thing in self.things if isinstance(thing, Object))

    @property
    def touchable(self) -> list[Solid]:
        """Things that another may be put in contact with."""
        return [thing for thing in self.things if self._is_exact and thing.is_convex]

    @property
    def bases(self) -> list[Pose]:
        """Cylinders that stand on the ground, with nothing on them."""
        standing = []
        for pose in self.poses:
            lift = (pose.center - self.target) @ self.up - pose.item.height / 2
            # On the ground, so only what stands on it can be over its end.
            is_below = any(
                np.linalg.norm(self._level(other.center - pose.center))
                < pose.item.radius
                for other in self.poses
                if other is not pose
            )
            if pose.axis @ self.up > 1 - 1e-9 and abs(lift) < 1e-9 and not is_below:
                standing.append(pose)
        return standing

    def put(self, draw: Callable[[], Put | None]) -> bool:
        """Put a thing where there is room for it; whether there was.

        Args:
            draw: Draws a place; None where it comes upon none.
        """
        for _ in range(PLACINGS):
            drawn = draw()
            if drawn is not None and self._fits(*drawn):
                self.things.append(drawn[0])
                return True
        return False

    def against(self, thing: Solid, along: Point | None = None) -> Put | None:
        """A thing beside another, in contact; None if there is none, or it is above.

        Args:
            thing: On the ground, where it slides.
            along: Direction on the ground from the other one; None for any.
        """
        others = self.touchable
        if not others:
            return None
        other = others[int(self.rng.integers(len(others)))]
        if along is None:
            along = self._level(self.rng.normal(size=3))
            along /= np.linalg.norm(along)
        thing = thing.moved(self._level(other.middle - thing.middle))
        shift = slide_to_touch(thing, other, along, self.rng.uniform(0, CONTACT))
        return (thing.moved(shift * along), other) if shift > 0 else None

    def _level(self, vector: Point) -> Point:
        """The part of a vector along the ground."""
        return vector - (vector @ self.up) * self.up

    def _fits(self, thing: Solid, partner: Solid | None) -> bool:
        if not self._is_exact:
            assert isinstance(thing, Pose)
            return all(are_capsules_apart(thing, other) for other in self.poses)
        is_before = all(
            normal @ (thing.farthest(-normal) - point) > 0
            for point, normal in self._walls
        )
        return is_before and all(
            are_apart(thing, other, GAP)
            for other in self.things
            if other is not partner
        )
