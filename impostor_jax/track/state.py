"""A cylinder in motion, and how sure it is: a Kalman filter.

The coordinates are the center and its velocity in the world, the tilt of the axis along
the two vectors of `tangent_basis(axis)`, since an axis has neither sign nor roll, and
radius and height, which never change: of them information only adds up.

The filter follows the cylinder as the sensor shows it. What images share is no noise:
the gains do not take it for any, and how it moves the estimate is carried along
(a Schmidt, or consider, filter). So no number of images makes a size surer than the
sensor's scale.

References:
    Schmidt (1966), "Application of state-space methods to navigation problems".
"""

__all__ = ["STATE_COORDINATES", "Motion", "State"]

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from impostor_jax.arguments import place_of
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.track.measured import Measured, basis_of

STATE_COORDINATES = (
    *(f"center_{x}" for x in "xyz"),
    *(f"velocity_{x}" for x in "xyz"),
    "axis_first",
    "axis_second",
    "radius",
    "height",
)
"""Of a covariance of `State`; of a velocity in meters per second."""

CENTER, VELOCITY, AXIS = slice(0, 3), slice(3, 6), slice(6, 8)
RADIUS, HEIGHT = 8, 9

SIZES = {"radius": RADIUS, "height": HEIGHT}
"""Places of what may be expected before a video."""

FREE = 1.0
"""Standard deviation in meters of a height before the first image that tells it."""


@dataclasses.dataclass(frozen=True)
class Motion:
    """What is expected of motions.

    Attributes:
        speed: Standard deviation of a velocity before it is known, in m/s.
        acceleration: Of its change within a second, along each direction, in m/s; that
            in other times goes with their root.
        turning: Of the axis' tilt within a second, likewise, in radians.
    """

    speed: float
    acceleration: float
    turning: float


@dataclasses.dataclass(frozen=True)
class State:
    """A cylinder, its velocity, and how sure they are.

    Attributes:
        center: (3,), in the world frame, in meters.
        velocity: (3,), in meters per second.
        axis: Unit vector.
        radius: In meters.
        height: In meters; the visible extent where nothing tells it.
        covariance: Of errors that are each image's own, in `STATE_COORDINATES`.
        shared: What one standard deviation of each error that images share has done.
        has_height: Whether images have told it, and with it the place along the axis.
        end: The only end that the last image showed, as of `Measured`.
        elapsed: Time since that image, in seconds.
        drift: Variance, in square meters, by which a velocity may since have changed
            the place along a direction.
    """

    center: Float[np.ndarray, "3"]
    velocity: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float
    height: float
    covariance: Float[np.ndarray, "10 10"]
    shared: Float[np.ndarray, "10 k"]
    has_height: bool = False
    end: int = 0
    elapsed: float = 0.0
    drift: float = 0.0

    @property
    def whole_covariance(self) -> Float[np.ndarray, "10 10"]:
        """Covariance with all errors; not finite entries are left to a reader."""
        return self.covariance + self.shared @ self.shared.T

    @functools.cached_property
    def cylinder(self) -> Cylinder:
        """It alone, in the world frame.

        It is put together without the checks of its class, and of NumPy's arrays, in a
        fortieth of the time.
        """
        dtype = jax.dtypes.canonicalize_dtype(float)
        values = (self.center, self.axis, self.radius, self.height)
        center, *rest = (np.asarray(x, dtype) for x in values)
        return _layout().unflatten([place_of(self.center, center), *rest])

    @staticmethod
    def of(seen: Measured, motion: Motion) -> "State":
        """The first state of a cylinder, from one image."""
        into = np.zeros((10, 7))
        into[CENTER, 2:5] = seen.basis.T
        into[AXIS, :2] = np.eye(2)
        into[RADIUS, 5] = into[HEIGHT, 6] = 1
        covariance = into @ seen.own @ into.T
        covariance[VELOCITY, VELOCITY] = motion.speed**2 * np.eye(3)
        return State(
            center=seen.center,
            velocity=np.zeros(3),
            axis=seen.axis,
            radius=seen.radius,
            height=seen.height,
            covariance=covariance,
            shared=into @ seen.shared,
            end=seen.end,
            has_height=bool(seen.is_known[4:].all()),
        )

    def predicted(self, seconds: float, motion: Motion) -> "State":
        """The state after some time."""
        forward = np.eye(10)
        forward[CENTER, VELOCITY] = seconds * np.eye(3)
        noise = np.zeros((10, 10))
        change, eye = motion.acceleration**2, np.eye(3)
        noise[CENTER, CENTER] = change * seconds**3 / 3 * eye
        noise[CENTER, VELOCITY] = noise[VELOCITY, CENTER] = (
            change * seconds**2 / 2 * eye
        )
        noise[VELOCITY, VELOCITY] = change * seconds * eye
        noise[AXIS, AXIS] = motion.turning**2 * seconds * np.eye(2)
        return dataclasses.replace(
            self,
            center=self.center + seconds * self.velocity,
            covariance=forward @ self.covariance @ forward.T + noise,
            shared=forward @ self.shared,
            elapsed=self.elapsed + seconds,
            drift=change * (self.elapsed + seconds) ** 3 / 3,
        )

    def compared(self, seen: Measured) -> "Innovation":
        """What an image shows, less what is expected of it."""
        along = seen.basis[2]
        offset = seen.center - self.center
        across = seen.basis[:2] @ self.axis
        sine, cosine = float(np.linalg.norm(across)), float(self.axis @ along)
        angle = float(np.arctan2(sine, cosine))
        rows, off = np.zeros((7, 10)), np.zeros(7)
        rows[:2, AXIS] = _carried(self.axis, along)
        off[:2] = -across * (angle / sine if sine > 0 else 1)
        rows[2:5, CENTER] = seen.basis
        off[2:5] = seen.basis @ offset
        if not seen.is_known[4]:
            # What is seen is another place of the axis.
            slide = off[4] / cosine
            rows[2:4, AXIS] = slide * rows[:2, AXIS]
            off[2:4] -= slide * across
        rows[5, RADIUS] = rows[6, HEIGHT] = 1
        off[5:] = seen.radius - self.radius, seen.height - self.height
        known = seen.is_known
        return Innovation(
            rows=rows[known],
            off=off[known],
            own=seen.own[np.ix_(known, known)],
            shared=seen.shared[known],
        )

    def updated(self, seen: Measured, repeats: float = 1.0) -> "State":
        """The state after an image.

        Args:
            seen: What a fit says of it; its axis has the sign of this one's.
            repeats: How many images tell as much as one whose errors are its own.
        """
        state = self._with_end(seen)._ready(seen)
        found = state.compared(seen)
        own = found.own * repeats
        state = state._corrected(dataclasses.replace(found, own=own))
        state = state._placed(seen)
        return dataclasses.replace(state, end=seen.end, elapsed=0.0, drift=0.0)

    def _ready(self, seen: Measured) -> "State":
        """With room for a height, where an image is the first that tells it."""
        return self._placed(seen) if seen.is_known[4:].all() else self

    def _with_end(self, seen: Measured) -> "State":
        """With the place of an end, where an image shows one alone."""
        along, half = seen.basis[2], seen.end / 2
        off = along @ (seen.center - self.center) + half * (seen.height - self.height)
        row, variance = np.zeros((1, 10)), seen.end_std**2
        if self.has_height:
            row[0, CENTER], row[0, HEIGHT] = along, half
        elif self.end == seen.end:
            # The motion since an image that showed the same end.
            row[0, VELOCITY], variance = along * self.elapsed, 2 * variance + self.drift
        shared = seen.shared[4] + half * seen.shared[6] if self.has_height else 0.0
        shared = np.broadcast_to(shared, (1, seen.shared.shape[1]))
        end = Innovation(row, np.array([off]), np.array([[variance]]), shared)
        return self._corrected(end) if seen.end and row.any() else self

    def _placed(self, seen: Measured) -> "State":
        """With ends as far as something is seen, where nothing has told the height.

        The place along the axis is no unknown then. With a variance that is large, an
        axis that turns a little would make it one across.
        """
        if self.has_height:
            return self
        slide = self.axis @ (seen.center - self.center)
        center, tells = self.center + slide * self.axis, bool(seen.is_known[4:].all())
        kept = np.eye(10)
        kept[CENTER, CENTER] -= np.outer(self.axis, self.axis)
        kept[HEIGHT, HEIGHT] = 0
        free = np.zeros((10, 10))
        if tells:
            free[CENTER, CENTER] = FREE**2 * np.outer(self.axis, self.axis)
            free[HEIGHT, HEIGHT] = FREE**2
        return dataclasses.replace(
            self,
            center=center,
            height=seen.height,
            covariance=kept @ self.covariance @ kept.T + free,
            shared=kept @ self.shared,
            has_height=tells,
        )

    def is_continued_by(self, seen: Measured) -> bool:
        """Whether it may go on where another part of its wall is seen.

        So it is where nothing has told its height, and no end is between the two.
        """
        side = 1 if self.axis @ (seen.center - self.center) > 0 else -1
        is_whole = self.has_height or bool(seen.is_known[4:].all())
        return not is_whole and self.end != side and seen.end != -side

    def reaching(self, seen: Measured) -> "State":
        """The state with ends as far as another part of its wall is seen."""
        along = float(self.axis @ (seen.center - self.center))
        low = min(-self.height / 2, along - seen.height / 2)
        high = max(self.height / 2, along + seen.height / 2)
        center = self.center + (low + high) / 2 * self.axis
        return dataclasses.replace(self, center=center, height=high - low)

    def expecting(
        self, sizes: Mapping[str, tuple[float, float]], seen: Measured
    ) -> "State":
        """The state with what is expected of sizes, which no image has been told.

        All errors count here, so that a known size tells the scale, and with it the
        place. Images are compared with the state without it: a second one would take
        what the first was told for news.

        Args:
            sizes: Expected values and their standard deviations, in meters, of `SIZES`.
            seen: What the last image that shows it says.
        """
        state = self
        if not self.has_height and self.end and "height" in sizes:
            state = self._from_end(*sizes["height"], seen)
            sizes = {name: x for name, x in sizes.items() if name != "height"}
        covariance, nothing = state.whole_covariance, np.zeros_like(state.shared)
        state = dataclasses.replace(state, covariance=covariance, shared=nothing)
        for name, (value, deviation) in sizes.items():
            if name == "height" and not state.has_height:
                continue
            row = np.eye(10)[SIZES[name]][None]
            off = np.array([value - getattr(state, name)])
            own = np.array([[deviation**2]])
            state = state._corrected(Innovation(row, off, own, nothing[:1]))
        return state

    def _from_end(self, height: float, deviation: float, seen: Measured) -> "State":
        """With a height that is expected, and a place that follows from one end."""
        half = self.end / 2
        with_height, with_end = np.zeros(10), np.zeros(10)
        with_height[CENTER], with_height[HEIGHT] = -half * self.axis, 1
        with_end[CENTER] = self.axis
        covariance = self.covariance + deviation**2 * np.outer(with_height, with_height)
        covariance += seen.end_std**2 * np.outer(with_end, with_end)
        moved = seen.shared[4] + half * seen.shared[6]
        return dataclasses.replace(
            self,
            center=self.center + half * (self.height - height) * self.axis,
            height=height,
            covariance=covariance,
            shared=self.shared + np.outer(with_end, moved),
            has_height=True,
        )

    def _corrected(self, found: "Innovation") -> "State":
        spread = found.rows @ self.covariance @ found.rows.T + found.own
        gain = np.linalg.solve(spread, found.rows @ self.covariance).T
        change = gain @ found.off
        left = np.eye(10) - gain @ found.rows
        # Joseph's form stays positive where a gain is rounded.
        covariance = left @ self.covariance @ left.T + gain @ found.own @ gain.T
        shared = left @ self.shared + gain @ found.shared
        # In an image a can that falls turns by an angle that is no longer its tangent.
        tilt = change[AXIS] @ basis_of(self.axis)
        angle = float(np.linalg.norm(tilt))
        axis = np.cos(angle) * self.axis + np.sinc(angle / np.pi) * tilt
        axis = axis / np.linalg.norm(axis)
        turn = np.eye(10)
        turn[AXIS, AXIS] = _carried(self.axis, axis)
        return dataclasses.replace(
            self,
            center=self.center + change[CENTER],
            velocity=self.velocity + change[VELOCITY],
            axis=axis,
            radius=self.radius + float(change[RADIUS]),
            height=self.height + float(change[HEIGHT]),
            covariance=turn @ covariance @ turn.T,
            shared=turn @ shared,
        )

    def distance(self, seen: Measured) -> tuple[float, int]:
        """Chi-squared by which an image differs from what is expected.

        Returns:
            It, with all errors counted, and its degrees of freedom.
        """
        state = self._ready(seen)
        found = state.compared(seen)
        before = found.rows @ state.shared
        # The scale is the same. Of the others this image may have, or may not have,
        # what those before it had.
        scale = before[:, :1] - found.shared[:, :1]
        apart = np.hstack([scale, before[:, 1:], found.shared[:, 1:]])
        spread = found.rows @ state.covariance @ found.rows.T + found.own
        spread += apart @ apart.T
        return float(found.off @ np.linalg.solve(spread, found.off)), len(found.off)


@functools.cache
def _layout() -> Any:
    """Of the tree of a cylinder, whose leaves are center, axis, radius and height."""
    return jax.tree.structure(Cylinder((0, 0, 0), (0, 0, 1), 1, 1))


@dataclasses.dataclass(frozen=True)
class Innovation:
    """What an image shows, less what was expected, of n coordinates.

    Attributes:
        rows: How they change with the state.
        off: The difference.
        own: Covariance of the image's own errors.
        shared: What one standard deviation of each shared error does to what it shows.
    """

    rows: Float[np.ndarray, "n 10"]
    off: Float[np.ndarray, " n"]
    own: Float[np.ndarray, "n n"]
    shared: Float[np.ndarray, "n k"]


def _carried(
    before: Float[np.ndarray, "3"], after: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "2 2"]:
    """From tilts at one axis to those at another, by the least rotation between."""
    cosine = float(before @ after)
    x, y, z = np.cross(before, after)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + cross + cross @ cross / (1 + cosine)
    return basis_of(after) @ rotation @ basis_of(before).T
