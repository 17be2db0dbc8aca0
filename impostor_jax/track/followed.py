"""A cylinder that a tracker follows, and what it remembers of it."""

__all__ = ["OTHER", "Followed"]

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.effort import MIN_READINGS
from impostor_jax.fit.budget import Deviations
from impostor_jax.fit.result import Fit
from impostor_jax.track.measured import COORDINATES, Measured, basis_of
from impostor_jax.track.sight import Sight
from impostor_jax.track.state import AXIS, CENTER, HEIGHT, RADIUS, VELOCITY, State
from impostor_jax.track.track import Track, TrackStatus

MOST_HIDDEN = 0.5
"""Part of the expected pixels that something hides, or that have no reading, from which
nothing can be said of the rest."""

OUT = "it is out of the image"
HIDDEN = "something hides it, or nothing is read"
GONE = "what is behind it is seen"
OTHER = "what is seen there does not fit"
"""Reasons for which it is lost."""

LEAST_PART = 1e-3
"""Part of an axis along a direction from which a center that is open along the axis is
open there."""

TOLD = (*COORDINATES, *(f"velocity_{x}" for x in "xyz"))
"""Coordinates of a track's covariance."""


class Followed:
    """A cylinder that is followed.

    Attributes:
        identity: Its number.
        state: What images have told of it, at the time of the last one.
        seen: What the last image that shows it says.
        first_seen: Time of the first image that shows it, in seconds.
        last_seen: Of the last.
        last_there: Of the last in which it may have been where it should be.
        num_fits: Images that the state is from.
        fit: To the image; None where it does not show it.
        reason: Why it does not.
        visible: Part of the expected pixels that read near its surface.
        was_lost: Whether the image before did not show it.
        is_newly_missing: Whether the image, and not the one before, shows that it is
            not where it should be, or nothing of it where most was seen before.
    """

    def __init__(
        self, identity: int, state: State, seen: Measured, now: float, fit: Fit
    ):
        self.identity = identity
        self.state = state
        self.seen = seen
        self.first_seen = self.last_seen = self.last_there = now
        self.num_fits = 1
        self.fit: Fit | None = fit
        self.reason = ""
        self.visible = 1.0
        self.was_lost = False
        self.is_newly_missing = False

    @property
    def is_lost(self) -> bool:
        """Whether the last image that it was looked for in does not show it."""
        return self.fit is None

    def look(self, sight: Sight, now: float) -> None:
        """Note what reads where it is expected; it is lost until it is taken."""
        self.was_lost = self.is_lost
        was_missing = self.is_lost and self.reason not in (HIDDEN, OUT)
        was_open = not self.was_lost and self.visible > 1 - MOST_HIDDEN
        self.fit = None
        self.visible = sight.explained / max(sight.expected, 1)
        could_be_seen = sight.explained + sight.empty
        if sight.expected < MIN_READINGS:
            self.reason = OUT
        elif could_be_seen < (1 - MOST_HIDDEN) * sight.expected:
            self.reason = HIDDEN
        elif 2 * sight.empty > could_be_seen:
            self.reason = GONE
        else:
            self.reason = OTHER
        # What hides it all at once may be a table that it was expected below.
        unseen = (OUT,) if was_open else (HIDDEN, OUT)
        self.is_newly_missing = not was_missing and self.reason not in unseen
        if self.reason != GONE:
            self.last_there = now

    def take(self, fit: Fit, measured: Measured, now: float, repeats: float) -> None:
        """Take what a fit says of it."""
        self.state = self.state.updated(measured, repeats)
        self.fit, self.seen, self.reason = fit, measured, ""
        self.last_seen = self.last_there = now
        self.num_fits += 1
        self.is_newly_missing = False

    def shares_room(self, other: State | Measured) -> bool:
        """Whether its middle, or that of another one, is within the other."""
        return _is_within(self.state, other) or _is_within(other, self.state)

    def shares_line(self, other: State) -> bool:
        """Whether the middle of another one is within its wall, if that went on."""
        _, across = _offset(other, self.state)
        return across < self.state.radius

    def told(
        self,
        now: float,
        mask: Bool[np.ndarray, "h w"] | None,
        shape: tuple[int, ...],
        sizes: Mapping[str, tuple[float, float]],
    ) -> Track:
        """What a caller is told of it.

        Args:
            now: Time of the image.
            mask: Pixels that show it; None where none does.
            shape: Of the image.
            sizes: What is expected of it, as of `State.expecting`.
        """
        state = self.state.expecting(sizes, self.seen) if sizes else self.state
        covariance, std = _told(state)
        status = TrackStatus.NEW if self.num_fits == 1 else TrackStatus.TRACKED
        return Track(
            identity=self.identity,
            status=TrackStatus.LOST if self.is_lost else status,
            reason=self.reason,
            cylinder=state.cylinder,
            velocity=state.velocity,
            std=std,
            covariance=covariance,
            coordinates=TOLD,
            time=now,
            first_seen=self.first_seen,
            last_seen=self.last_seen,
            num_fits=self.num_fits,
            visible=self.visible,
            mask=np.zeros(shape, bool) if mask is None else mask,
            fit=self.fit,
        )


def _is_within(one: State | Measured, other: State | Measured) -> bool:
    """Whether the middle of a cylinder is within another one."""
    along, across = _offset(one, other)
    return across < other.radius and abs(along) < other.height / 2


def _offset(one: State | Measured, other: State | Measured) -> tuple[float, float]:
    """How far the middle of a cylinder is along another's axis, and aside of that."""
    offset = one.center - other.center
    along = float(offset @ other.axis)
    return along, float(np.linalg.norm(offset - along * other.axis))


def _told(state: State) -> tuple[Float[np.ndarray, "10 10"], Deviations]:
    """Covariance in `TOLD` coordinates, and standard deviations by name."""
    basis = np.vstack([basis_of(state.axis), state.axis])
    into = np.zeros((10, 10))
    into[:2, AXIS], into[2:5, CENTER] = np.eye(2), basis
    into[5, RADIUS] = into[6, HEIGHT] = 1
    into[7:, VELOCITY] = np.eye(3)
    full = state.whole_covariance
    known = into @ full @ into.T
    center = np.sqrt(np.diagonal(full)[CENTER])
    if not state.has_height:
        is_open = np.isin(TOLD, ("center_along", "height"))
        known[is_open] = known[:, is_open] = 0
        known[is_open, is_open] = np.inf
        center = np.where(np.abs(state.axis) > LEAST_PART, np.inf, center)
    own = np.sqrt(np.diagonal(known))
    by_name = {
        "center": center,
        "across_axis": own[2:4],
        "along_axis": own[4:5],
        "velocity": own[7:],
        "axis": own[:2],
        "radius": own[5:6],
        "height": own[6:7],
    }
    names = [name for name, values in by_name.items() for _ in values]
    return known, Deviations(np.concatenate([*by_name.values()]), tuple(names))
