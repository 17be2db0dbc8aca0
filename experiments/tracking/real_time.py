"""A camera that does not wait: what comes while the tracker is busy is dropped."""

__all__ = ["real_time", "times", "track_of"]

import dataclasses
import time
from collections.abc import Iterator, Sequence

import numpy as np

import impostor_jax as ij
from experiments.fitting import rmse
from experiments.recording import Metric
from experiments.tracking.scenes import CAMERA, RATE, Frame
from impostor_jax.evaluate_tracks import track_errors
from impostor_jax.track.track import Track, TrackStatus

TAKEN = {"all": 1, "half": 2, "quarter": 4, "eighth": 8}
"""Every n-th image, however long it takes."""

WARM = 17
"""Images of which the second one that is searched is the last but one."""

NEAR = 0.05
"""Meters within which a track is of a can."""


@dataclasses.dataclass
class Followed:
    """What became of the cans of a video.

    Attributes:
        taken: Numbers of the images that were taken.
        delays: Seconds from each of them to its tracks.
        asides: Errors of places across the axis, in meters.
        speeds: Errors of velocities across the axis, in m/s.
        num_missed: Cans in these images that no track follows.
        num_switches: How often a can has another identity than before.
        radii: Standard deviations of the radii after the last image, in meters.
    """

    taken: list[int] = dataclasses.field(default_factory=list)
    delays: list[float] = dataclasses.field(default_factory=list)
    asides: list[float] = dataclasses.field(default_factory=list)
    speeds: list[float] = dataclasses.field(default_factory=list)
    num_missed: int = 0
    num_switches: int = 0
    radii: list[float] = dataclasses.field(default_factory=list)


def real_time(frames: Sequence[Frame], sigma: float) -> Iterator[Metric]:
    """What is lost where every n-th image is taken, and where the newest one is.

    Args:
        frames: A video, `RATE` images in a second.
        sigma: Noise of each reading, in meters.
    """
    # At first programs are compiled.
    _followed(frames[:WARM], sigma, 1)
    for case, every in TAKEN.items():
        yield from _metrics(case, frames, _followed(frames, sigma, every))
    yield from _metrics("newest", frames, _followed(frames, sigma, None))


def _followed(frames: Sequence[Frame], sigma: float, every: int | None) -> Followed:
    """Follow the cans of a video.

    Args:
        frames: The video.
        sigma: Of its noise.
        every: Of which images one is taken; None for the newest that has come when the
            tracker is ready.
    """
    tracker, found = ij.Tracker(CAMERA, sigma), Followed()
    identities: dict[int, int] = {}
    tracks: tuple[Track, ...] = ()
    number, ready = 0, 0.0
    while number < len(frames):
        frame, taken = frames[number], number / RATE
        begin = time.perf_counter()
        tracks = tracker.step(
            frame.depth, time=taken, camera_from_world=frame.camera_from_world
        )
        ready = max(ready, taken) + time.perf_counter() - begin
        found.taken.append(number)
        found.delays.append(ready - taken)
        before = frames[max(number - 1, 0)].cans
        for k, (can, earlier) in enumerate(zip(frame.cans, before, strict=True)):
            track = track_of(can, tracks)
            if track is None or track.status is TrackStatus.LOST:
                found.num_missed += 1
                continue
            found.num_switches += identities.get(k, track.identity) != track.identity
            identities[k] = track.identity
            if len(found.taken) > 1:
                _add_errors(found, track, can, earlier)
        newest = int(ready * RATE)
        number = max(number + 1, newest) if every is None else number + every
    found.radii = [float(track.std.radius) for track in tracks]
    return found


def _add_errors(
    found: Followed, track: Track, can: ij.Cylinder, earlier: ij.Cylinder
) -> None:
    off, _ = track_errors(track, can)
    found.asides.append(float(np.hypot(off["center_first"], off["center_second"])))
    velocity = RATE * np.subtract(can.center, earlier.center)
    error, axis = track.velocity - velocity, np.asarray(can.axis, float)
    found.speeds.append(float(np.linalg.norm(error - (error @ axis) * axis)))


def track_of(can: ij.Cylinder, tracks: Sequence[Track]) -> Track | None:
    """The track that is near a can, if there is one."""
    away = [
        float(np.linalg.norm(np.subtract(one.cylinder.center, can.center)))
        for one in tracks
    ]
    best = int(np.argmin(away)) if away else 0
    return tracks[best] if away and away[best] < NEAR else None


def times(label: str, seconds: Sequence[float]) -> Iterator[Metric]:
    """The median and the slowest of a hundred, in milliseconds, but for the first.

    That is of all of an image, or compiles.
    """
    ms = 1e3 * np.array(seconds[1:] or seconds)
    n, spread = len(ms), float(np.std(ms))
    for part, value in (("median", np.median(ms)), ("slow", np.quantile(ms, 0.99))):
        yield Metric(f"{label}.{part}", float(value), spread, "ms", "lower", n)


def _metrics(case: str, frames: Sequence[Frame], found: Followed) -> Iterator[Metric]:
    label, count = f"real_time.{case}", len(found.taken)
    dropped = 1 - count / len(frames)
    yield Metric.share(f"{label}.dropped", dropped, len(frames), "lower")
    num_cans = count * len(frames[0].cans)
    missed = found.num_missed / num_cans
    yield Metric.share(f"{label}.missed", missed, num_cans, "lower")
    yield Metric(f"{label}.switches", found.num_switches, None, "1", "lower", num_cans)
    yield from times(label, found.delays)
    for name, unit, errors in (
        ("aside", "m", found.asides),
        ("speed", "m/s", found.speeds),
        ("radius", "m", found.radii),
    ):
        yield rmse(f"{label}.{name}", np.array(errors), unit)
