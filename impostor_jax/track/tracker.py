"""Follow cylinders through a video of depth images.

Each image is compared with what is expected of it: what is followed is fitted to the
pixels that read near where it should be, from there, and is the same if the two agree.
Only what no track explains is searched, now and then.
"""

__all__ = ["Tracker"]

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage, special
from scipy.optimize import linear_sum_assignment

from impostor_jax.arguments import bounded_number, real_number, whole_number
from impostor_jax.camera.base import AbstractCamera, not_accepted, posed
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.device import on_processor
from impostor_jax.effort import Effort, effort_of
from impostor_jax.find.cylinders import checked_radii, find_cylinders
from impostor_jax.find.found import Found
from impostor_jax.find.search import Request
from impostor_jax.fit.measured import NOT_MEASURED, law_of_noise
from impostor_jax.fit.options import Options
from impostor_jax.fit.request import checked_noise, checked_prior, checked_readings
from impostor_jax.fit.result import Fit
from impostor_jax.fit.threads import side_by_side
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.track.followed import OTHER, Followed
from impostor_jax.track.measured import Measured
from impostor_jax.track.sight import NO_PLANES, Sight
from impostor_jax.track.state import SIZES, Motion, State
from impostor_jax.track.track import Track
from impostor_jax.track.view import View

TRACKING = Effort(readings=1024, doubts=False)
"""Of the fits to what is expected: the start is near, and more readings take longer."""

LEAST_SHOWN = 0.1
"""Part of the expected pixels that must read near the surface before it is fitted."""

BORDER = 2
"""Pixels beside what a track explains that are not searched, either."""

UNLIKELY = 1e30
"""Cost of what is not the same."""


class Tracker:
    """Follows every cylinder in a video of depth images.

        tracker = ij.Tracker(camera, sigma=ij.StructuredLight.sensor())
        for depth, seconds, pose in video:
            for track in tracker.step(depth, time=seconds, camera_from_world=pose):
                print(track)

    Sizes do not change, so they become surer with every image; not by what images
    share, as the sensor's scale. Of smooth errors of the sensor, of walls that lean and
    of pixels at an outline neighboring images are taken to have the same, as those of
    a still scene have, and of a fit's own deviation a fifth, by which estimates are
    biased. The rest is taken to be new in each image, unless `noise_time` says
    otherwise. Poses of the camera are taken for exact.

    Args:
        camera: That takes the images.
        sigma: As of `fit_cylinder`; if None it is measured in the first image that
            tells it, and so it is where a model lets noise grow towards grazing and
            that of what is found first does not.
        frame_rate: Images in a second, where `step` is not told the time.
        search_every: Images from one search of what no track explains to the next, the
            first included. An image in which a cylinder is missing from where it was
            is searched, too.
        patience: Seconds for which a track is kept that something hides, or that is out
            of the image.
        absence: Seconds for which one is kept where the image shows that it is gone.
        speed: Standard deviation of velocities, in m/s, before one is known.
        acceleration: Of their change within a second, along each direction, in m/s;
            that within other times goes with their root.
        turning: Of an axis' tilt within a second, likewise, in radians.
        noise_time: Seconds after which 1 / e is left of the errors of readings, as
            where a sensor filters over time; 0 if each image has its own.
        gate: Probability by which the same cylinder is taken for another one.
        radius_range: As of `find_cylinders`, like the next.
        min_pixels: Fewest pixels of a cylinder that a search finds.
        prior: Expected radius and height of every cylinder, each with its standard
            deviation, as of `fit_cylinder`, by which searches find it. It counts once
            for a cylinder, however many images show it.
        effort: How much work a fit to what is expected takes, as of `fit_cylinder`; by
            default 1024 readings and no doubts. One that fails, or does not agree, is
            repeated with doubts.

    Attributes:
        tracks: Of the last image.
        time: Of that, in seconds; None before the first.
        ended: Those that ended with the last image, as they were before.
        noise: Of the sensor; None until it is known.

    Raises:
        ValueError: An argument has a wrong type or value.
    """

    def __init__(
        self,
        camera: AbstractCamera,
        sigma: Any = None,
        *,
        frame_rate: float = 30.0,
        search_every: int = 15,
        patience: float = 2.0,
        absence: float = 0.3,
        speed: float = 1.0,
        acceleration: float = 1.0,
        turning: float = 1.0,
        noise_time: float = 0.0,
        gate: float = 1e-6,
        radius_range: tuple[float, float] = Request.radius_range,
        min_pixels: int = Request.min_pixels,
        prior: Mapping[str, Any] | None = None,
        effort: Effort | str = TRACKING,
    ):
        if not isinstance(camera, PinholeCamera):
            raise ValueError(
                f"camera must be a PinholeCamera, got {not_accepted(camera)}"
            )
        self.camera = camera
        self.noise: AbstractDepthNoise | None = (
            None if sigma is None else checked_noise(sigma)
        )
        self.tracks: tuple[Track, ...] = ()
        self.ended: tuple[Track, ...] = ()
        rate = real_number("frame_rate", frame_rate, positive=True, unit="1/seconds")
        self._interval = 1 / rate
        self._search_every = whole_number(
            "search_every", search_every, 1, unit="images"
        )
        self._patience = bounded_number("patience", patience, "0 or more seconds")
        self._absence = bounded_number("absence", absence, "0 or more seconds")
        self._noise_time = bounded_number("noise_time", noise_time, "0 or more seconds")
        self._motion = Motion(
            real_number("speed", speed, positive=True, unit="m/s"),
            real_number("acceleration", acceleration, positive=True, unit="m/s"),
            real_number("turning", turning, positive=True, unit="radians"),
        )
        self._gate = real_number("gate", gate, positive=True)
        if self._gate >= 1:
            raise ValueError(f"gate must be a probability below 1, got {gate}")
        checked_prior(prior, tuple(SIZES), None)
        self._sizes = {
            name: (float(value), float(deviation))
            for name, (value, deviation) in (prior or {}).items()
        }
        self._sought: dict[str, Any] = {
            "radius_range": checked_radii(radius_range, prior),
            "prior": self._sizes or None,
            "min_pixels": whole_number("min_pixels", min_pixels, 1, unit="pixels"),
        }
        self._options = Options(effort=effort_of(effort))
        self._careful = Options()
        self._followed: list[Followed] = []
        self._planes = NO_PLANES
        self.time: float | None = None
        self._num_images = 0
        self._num_found = 0

    @on_processor
    def step(
        self, depth: Any, time: float | None = None, camera_from_world: Any = None
    ) -> tuple[Track, ...]:
        """Take the next image.

        Args:
            depth: (H, W), planar depth in meters; 0, NaN and infinity mean no reading.
            time: When it was taken, in seconds, later than the one before; if None, by
                the frame rate.
            camera_from_world: Pose of the camera, a `RigidTransform` or a (4, 4)
                matrix; if None, that of the tracker's camera. Without any the world is
                the camera's frame, and velocities are seen from there.

        Returns:
            The tracks, those that are lost included, in the order of their identities.

        Raises:
            ValueError: An argument has a wrong shape, dtype or value.
        """
        now = self._checked_time(time)
        camera = self.camera
        if camera_from_world is not None:
            camera = posed(camera, RigidTransform.of(camera_from_world))
        view = self._view(depth, camera)
        self._predict(now)
        masks = self._follow(view, now)
        if self._is_searched(view):
            self._search(view, masks, now)
        self._end(now)
        self.time, self._num_images = now, self._num_images + 1
        kept = {one.identity for one in self._followed}
        self.ended = tuple(one for one in self.tracks if one.identity not in kept)
        self.tracks = tuple(
            one.told(now, masks.get(one.identity), view.image.shape, self._sizes)
            for one in self._followed
        )
        return self.tracks

    def _checked_time(self, time: Any) -> float:
        if time is None:
            return 0.0 if self.time is None else self.time + self._interval
        time = real_number("time", time, unit="seconds")
        if self.time is not None and time <= self.time:
            raise ValueError(
                f"time must be later than that of the image before, {self.time} "
                f"seconds, got {time}"
            )
        return time

    def _view(self, depth: Any, camera: PinholeCamera) -> View:
        noise = self.noise
        if noise is None:
            image, *_ = checked_readings(depth, camera, None)
            noise = self._measured(np.asarray(image), camera)
        image, noise, _ = checked_readings(depth, camera, noise)
        return View.of(np.asarray(image), camera, noise)

    def _measured(
        self, image: Float[np.ndarray, "h w"], camera: PinholeCamera
    ) -> AbstractDepthNoise:
        """The noise that an image tells, from now on; a guess where it tells none."""
        found = law_of_noise(image, camera)
        if found.text != NOT_MEASURED:
            self.noise = found.noise
        return found.noise

    def _predict(self, now: float) -> None:
        if self.time is None:
            return
        for one in self._followed:
            one.state = one.state.predicted(now - self.time, self._motion)

    def _follow(self, view: View, now: float) -> dict[int, Bool[np.ndarray, "h w"]]:
        """Fit what is followed to what reads near where it should be.

        Returns:
            The pixels that show each that is seen, by identity.
        """
        sights = [view.sight(one.state, self._planes) for one in self._followed]
        owner = _claimed(self._followed, sights, view.image.shape)
        shown = []
        for one, sight in zip(self._followed, sights, strict=True):
            one.look(sight, now)
            if sight.explained >= LEAST_SHOWN * sight.expected:
                shown.append(one)
        masks = side_by_side(lambda one: self._fit(one, view, owner, now), shown)
        seen = {
            one.identity: mask
            for one, mask in zip(shown, masks, strict=True)
            if mask is not None
        }
        self._end_twins(view, seen)
        return seen

    def _fit(
        self, one: Followed, view: View, owner: Int[np.ndarray, "h w"], now: float
    ) -> Bool[np.ndarray, "h w"] | None:
        """Fit a cylinder to its pixels; those, if it is the same."""
        fit, mask = view.fit_near(one, owner, self._planes, self._options)
        if fit is None:
            return None
        seen = self._same(one, view, fit)
        if seen is None and not one.was_lost:
            # Of some hundred quick fits one is off by more than it says.
            fit = view.fit(mask, one.state.cylinder, self._careful)
            seen = self._same(one, view, fit)
        if seen is None:
            return None
        one.take(fit, seen, now, self._repeats(one, now))
        return mask

    def _same(self, one: Followed, view: View, fit: Fit) -> Measured | None:
        """What a fit says, if it is of the same cylinder."""
        if not fit.success:
            one.reason = f"the fit is {fit.status}"
            return None
        measured = view.measured(fit, one.state)
        if self._is_same(one.state, measured):
            return measured
        one.reason = OTHER
        return None

    def _repeats(self, one: Followed, now: float) -> float:
        """How many images tell as much as one whose errors are its own.

        Of errors of which rho is left from one image to the next, n of them tell as
        much as 1 + (n - 1) (1 - rho) / (1 + rho) of independent ones.
        """
        if self._noise_time == 0:
            return 1.0
        left = math.exp(-(now - one.last_seen) / self._noise_time)
        return (1 + left) / max(1 - left, 1e-9)

    def _is_same(self, state: State, measured: Measured) -> bool:
        chi2, freedom = state.distance(measured)
        return bool(chi2 < 2 * special.gammainccinv(freedom / 2, self._gate))

    def _end_twins(self, view: View, seen: dict[int, Bool[np.ndarray, "h w"]]) -> None:
        """Of two tracks of one cylinder the older goes on."""
        kept: list[Followed] = []
        for one in sorted(self._followed, key=lambda one: one.identity not in seen):
            older = None
            if one.identity in seen:
                others = (other for other in kept if other.identity in seen)
                older = next((x for x in others if self._is_twin(x, one, view)), None)
            if older is None:
                kept.append(one)
            else:
                seen[older.identity] = seen[older.identity] | seen.pop(one.identity)
        self._followed = [one for one in self._followed if one in kept]

    def _is_twin(self, older: Followed, one: Followed, view: View) -> bool:
        if older.shares_room(one.state):
            return True
        # First what costs little: pairs of cylinders grow with their square.
        if not older.shares_line(one.state):
            return False
        assert one.fit is not None
        return self._reaches(older, view.measured(one.fit, older.state))

    def _reaches(self, one: Followed, part: Measured) -> bool:
        """Let a track go as far as another part of its wall, if that is one."""
        if not (one.state.is_continued_by(part) and self._is_same(one.state, part)):
            return False
        one.state = one.state.reaching(part)
        return True

    def _is_searched(self, view: View) -> bool:
        is_due = self._num_images % self._search_every == 0
        return is_due or any(one.is_newly_missing for one in self._followed)

    def _search(
        self, view: View, masks: dict[int, Bool[np.ndarray, "h w"]], now: float
    ) -> None:
        """Search what no track explains; find what was lost, and what is new."""
        rest = view.image.copy()
        for mask in masks.values():
            around = ndimage.binary_dilation(mask, iterations=BORDER)
            rest[np.asarray(around, bool)] = 0
        if np.count_nonzero(rest) < self._sought["min_pixels"]:
            return
        found = find_cylinders(rest, view.camera, view.noise, **self._sought)
        if not self._num_found and view.shows_less(found):
            told = self.noise
            self._measured(view.image, view.camera)
            if self.noise is not told:
                view = self._view(view.image, view.camera)
                found = find_cylinders(rest, view.camera, view.noise, **self._sought)
        normals = np.asarray(found.planes.unit_normal, float)
        points = np.asarray(found.planes.point, float)
        across = np.sum(points * normals, axis=1, keepdims=True)
        self._planes = np.hstack([normals, across])
        lost = [one for one in self._followed if one.identity not in masks]
        seen = [one for one in self._followed if one.identity in masks]
        fits = []
        for fit, mask in self._alone(view, found):
            parts = [view.measured(fit, one.state) for one in seen]
            pairs = [*zip(seen, parts, strict=True)]
            if any(one.shares_room(part) for one, part in pairs):
                continue
            whole = next((one for one, x in pairs if self._reaches(one, x)), None)
            if whole is None:
                fits.append((fit, mask))
            else:
                masks[whole.identity] = masks[whole.identity] | mask
        again = self._assigned(view, lost, [fit for fit, _ in fits])
        for k, (fit, mask) in enumerate(fits):
            if k in again:
                one = again[k]
                measured = view.measured(fit, one.state)
                one.take(fit, measured, now, 1.0)
            else:
                self._num_found += 1
                measured = view.measured(fit, None)
                state = State.of(measured, self._motion)
                one = Followed(self._num_found, state, measured, now, fit)
                self._followed.append(one)
            masks[one.identity] = mask

    def _alone(
        self, view: View, found: Found
    ) -> Iterator[tuple[Fit, Bool[np.ndarray, "h w"]]]:
        """What was found, as the image alone tells it, and its pixels."""
        for fit, mask in zip(found.fits, found.masks, strict=True):
            if not self._sizes:
                yield fit, mask
                continue
            alone = view.fit(mask, fit.cylinder, self._careful)
            if alone.success:
                yield alone, mask

    def _assigned(
        self, view: View, lost: Sequence[Followed], fits: Sequence[Fit]
    ) -> dict[int, Followed]:
        """Which of the fits are of which that was lost, by the number of the fit."""
        cost = np.full((len(fits), len(lost)), UNLIKELY)
        for k, fit in enumerate(fits):
            for j, one in enumerate(lost):
                measured = view.measured(fit, one.state)
                if self._is_same(one.state, measured):
                    cost[k, j] = one.state.distance(measured)[0]
        pairs = zip(*linear_sum_assignment(cost), strict=True)
        return {int(k): lost[j] for k, j in pairs if cost[k, j] < UNLIKELY}

    def _end(self, now: float) -> None:
        """End what is lost for too long."""
        self._followed = [
            one
            for one in self._followed
            if now - one.last_seen <= self._patience
            and now - one.last_there <= self._absence
        ]


def _claimed(
    followed: Sequence[Followed], sights: Sequence[Sight], shape: tuple[int, ...]
) -> Int[np.ndarray, "h w"]:
    """Whose each pixel is, by identity; 0 where it is nobody's.

    What reads near several is the nearest's. What is lost takes what no other does.
    """
    owner = np.zeros(shape, np.int32)
    gap = np.full(shape, np.inf, np.float32)
    order = sorted(range(len(followed)), key=lambda k: followed[k].is_lost)
    for one, sight in ((followed[k], sights[k]) for k in order):
        window = sight.window
        is_nearest = sight.gap < gap[window]
        if one.is_lost:
            is_nearest &= owner[window] == 0
        owner[window][is_nearest] = one.identity
        gap[window][is_nearest] = sight.gap[is_nearest]
    return owner
