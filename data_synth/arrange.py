"""Putting things one after the other: apart from those that are there, or in contact."""

__all__ = ["Arrangement", "Plane", "Put"]

from collections.abc import Callable, Sequence

import numpy as np

from data_synth.pose import GAP, Pose, are_capsules_apart
from data_synth.solid import Object, Point, Solid, are_apart, slide_to_touch

PLACINGS = 50
"""Places that are tried for a thing before the scene is given up."""

CONTACT = 0.001
"""Largest gap of things that are put in contact, in meters."""

NEAREST = 0.25
"""Least depth of things among scenery, in meters."""

Plane = tuple[Point, Point]
"""A point and a unit normal."""

Put = tuple[Solid, Solid | None]
"""A thing, and another one that it touches."""


class Arrangement:
    """The things of a scene, in the camera's frame.

    Args:
        up: Unit normal of the ground.
        walls: Planes that things stay before.
        is_exact: Whether distances are those of the things. Else they are those of the
            capsules around cylinders, and walls do not count.
        rng: Source of all that is drawn.
    """

    def __init__(
        self,
        up: Point,
        walls: Sequence[Plane],
        is_exact: bool,
        rng: np.random.Generator,
    ):
        self.things: list[Solid] = []
        self.up = up
        self._walls, self._is_exact, self._rng = tuple(walls), is_exact, rng

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
        """Things that another may be put in contact with, if any may be."""
        return [thing for thing in self.things if self._is_exact and thing.is_convex]

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

    def bases(self) -> list[Pose]:
        """Upright cylinders that nothing stands on."""
        upright = [pose for pose in self.poses if pose.axis @ self.up > 1 - 1e-9]
        return [pose for pose in upright if not any(map(self._over(pose), upright))]

    def _over(self, below: Pose) -> Callable[[Pose], bool]:
        def is_over(pose: Pose) -> bool:
            offset = pose.center - below.center
            lift = offset @ self.up
            aside = np.linalg.norm(offset - lift * self.up)
            return bool(lift > 0 and aside < below.item.radius)

        return is_over

    def against(self, thing: Solid, along: Point | None = None) -> Put | None:
        """A thing beside another, in contact; None if there is none, or it is above.

        Args:
            thing: It slides on the ground.
            along: Horizontal direction from the other one; None for any.
        """
        others = self.touchable
        if not others:
            return None
        other = others[int(self._rng.integers(len(others)))]
        if along is None:
            along = self._horizontal(self._rng.normal(size=3))
            along /= np.linalg.norm(along)
        thing = thing.moved(self._horizontal(other.middle - thing.middle))
        shift = slide_to_touch(thing, other, along, self._rng.uniform(0, CONTACT))
        return (thing.moved(shift * along), other) if shift > 0 else None

    def _horizontal(self, vector: Point) -> Point:
        return vector - (vector @ self.up) * self.up

    def _fits(self, thing: Solid, partner: Solid | None) -> bool:
        others = [other for other in self.things if other is not partner]
        if not self._is_exact:
            assert isinstance(thing, Pose)
            return all(are_capsules_apart(thing, other) for other in self.poses)
        planes = [(np.array([0.0, 0.0, NEAREST]), np.array([0.0, 0.0, 1.0]))]
        return all(
            -thing.support(-normal[None])[0] > normal @ point
            for point, normal in [*planes, *self._walls]
        ) and all(are_apart(thing, other, GAP) for other in others)
