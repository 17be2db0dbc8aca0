"""Following the cylinders of videos, and comparing the tracks with what is there.

Counts are those of CLEAR MOT: a cylinder that counts stays with its track as long as
that is near it, the others are paired by the smallest distance; one without a track is
missed, a track without a cylinder is false, and one that has another track than before
is a switch.

References:
    Bernardin and Stiefelhagen (2008), "Evaluating Multiple Object Tracking Performance:
    The CLEAR MOT Metrics".
"""

__all__ = [
    "TrackScore",
    "TrackedImage",
    "evaluate_tracks",
    "pair_tracks",
    "score_tracks",
    "track_errors",
]

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.io.dataset_shard import LabeledImage
from impostor_jax.matching import LEVELS, Detection, Truth, distances, truth_of
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.track.measured import basis_of
from impostor_jax.track.track import Track, TrackStatus
from impostor_jax.track.tracker import Tracker

APART = 1e9
"""Cost of a pair that is not near."""

MOST_95 = 1.959964
"""Half width of the 95 % interval in standard deviations."""


class TrackedImage(NamedTuple):
    """What came of an image.

    Attributes:
        num_truths: Cylinders that count.
        num_missed: Those of them without a track.
        num_false: Tracks that are seen, without a cylinder.
        num_switches: Cylinders whose track is another than before.
        errors: Of each pair by coordinate, in meters and radians: the track less the
            truth, of what the track determines.
        deviations: What the tracks say that they are off by.
    """

    num_truths: int
    num_missed: int
    num_false: int
    num_switches: int
    errors: list[dict[str, float]]
    deviations: list[dict[str, float]]


@dataclasses.dataclass(frozen=True)
class TrackScore:
    """How well a tracker did on some images.

    Attributes:
        num_images: Number of images.
        num_truths: Cylinders that count, image by image.
        num_missed: As of `TrackedImage`, of all images, like the next two.
        num_false: Likewise.
        num_switches: Likewise.
        rms: Root mean square of the errors by coordinate, in meters and radians.
        coverage: Share of the errors within their 95 % intervals, by coordinate.
    """

    num_images: int
    num_truths: int
    num_missed: int
    num_false: int
    num_switches: int
    rms: dict[str, float]
    coverage: dict[str, float]

    @property
    def mota(self) -> float:
        """One less misses, false tracks and switches over the cylinders that count."""
        wrong = self.num_missed + self.num_false + self.num_switches
        return 1 - wrong / max(self.num_truths, 1)


def evaluate_tracks(
    images: Iterable[LabeledImage], sensor: AbstractDepthNoise, **options: Any
) -> Iterator[TrackedImage]:
    """Follow the cylinders of videos, each from its first image on.

    Args:
        images: Of a dataset of videos, in order.
        sensor: Weighs the readings.
        options: Of `Tracker`.

    Raises:
        ValueError: An image is of no video.
    """
    tracker, known = None, {}
    for image in images:
        if image.seconds is None or image.identity is None:
            raise ValueError(f"images must be of videos, got {image.key}, which is not")
        if tracker is None or image.seconds == 0:
            tracker, known = Tracker(image.pinhole, sensor, **options), {}
        tracks = tracker.step(image.depth, image.seconds, image.camera_from_world)
        pose = np.asarray(image.camera_from_world, float)
        seen = {t.identity: t for t in tracks if t.status != TrackStatus.LOST}
        truth = truth_of(image)
        found = {k: _detection(track, pose) for k, track in seen.items()}
        pairs, num_false = pair_tracks(truth, found, known)
        switched = [k for k, track in pairs.items() if known.get(k, track) != track]
        known |= pairs
        told = [
            track_errors(seen[track], _in_world(image, k)) for k, track in pairs.items()
        ]
        num_truths = int(np.count_nonzero(truth.counted))
        yield TrackedImage(
            num_truths=num_truths,
            num_missed=num_truths - len(pairs),
            num_false=num_false,
            num_switches=len(switched),
            errors=[errors for errors, _ in told],
            deviations=[deviations for _, deviations in told],
        )


def pair_tracks(
    truth: Truth, tracks: Mapping[int, Detection], known: Mapping[int, int]
) -> tuple[dict[int, int], int]:
    """Which track each cylinder has.

    Args:
        truth: In the camera's frame.
        tracks: Those that are seen, by identity, in that frame.
        known: Identity of the track that each had last, by its place in the truth.

    Returns:
        Identities by the places of cylinders that count; and how many tracks have none,
        nor one that does not count.
    """
    away = np.full((len(tracks), len(truth.radius)), np.inf)
    for j, one in enumerate(tracks.values()):
        away[j] = distances(truth, one, LEVELS["standard"])
    cost, identities = np.where((away <= 1) & truth.counted, away, APART), list(tracks)
    for k, identity in known.items():
        if identity in tracks and cost[identities.index(identity), k] < APART:
            # Before all that is nearer.
            cost[identities.index(identity), k] -= len(tracks) + 1
    chosen = zip(*linear_sum_assignment(cost), strict=True)
    pairs = {int(k): identities[j] for j, k in chosen if cost[j, k] < APART}
    is_near_other = ((away <= 1) & ~truth.counted).any(axis=1)
    is_used = np.isin(identities, list(pairs.values()))
    return pairs, int(np.count_nonzero(~is_used & ~is_near_other))


def score_tracks(images: Iterable[TrackedImage]) -> TrackScore:
    """Sum up what came of at least one image."""
    some = list(images)
    pairs = [
        pair
        for one in some
        for pair in zip(one.errors, one.deviations, strict=True)
    ]  # fmt: skip
    names = dict.fromkeys(name for errors, _ in pairs for name in errors)
    rms, coverage = {}, {}
    for name in names:
        both = [(e[name], d[name]) for e, d in pairs if name in e]
        error, deviation = np.array(both).T
        rms[name] = float(np.sqrt(np.mean(error**2)))
        coverage[name] = float(np.mean(np.abs(error) <= MOST_95 * deviation))
    return TrackScore(
        num_images=len(some),
        num_truths=sum(one.num_truths for one in some),
        num_missed=sum(one.num_missed for one in some),
        num_false=sum(one.num_false for one in some),
        num_switches=sum(one.num_switches for one in some),
        rms=rms,
        coverage=coverage,
    )


def _detection(track: Track, camera_from_world: Float[np.ndarray, "4 4"]) -> Detection:
    """A track as it is compared, in the camera's frame."""
    shape = track.cylinder
    turn, by = camera_from_world[:3, :3], camera_from_world[:3, 3]
    return Detection(
        center=turn @ np.asarray(shape.center, float) + by,
        axis=turn @ np.asarray(shape.axis, float),
        radius=float(shape.radius),
        height=float(shape.height),
        confidence=1.0,
    )


def track_errors(
    track: Track, truth: Cylinder
) -> tuple[dict[str, float], dict[str, float]]:
    """Errors of what a track determines, and what it says they are.

    Args:
        track: In the world frame, like the next.
        truth: The cylinder that it is of.

    Returns:
        Track less truth by the coordinates of a fit, in meters and radians; and
        standard deviations.
    """
    own, axis = (np.asarray(x.axis, float) for x in (track.cylinder, truth))
    axis = axis * np.sign(axis @ own)
    basis = np.vstack([basis_of(own), own])
    offset = np.asarray(track.cylinder.center, float) - np.asarray(truth.center, float)
    # Across the axis where the track's center is, which may not be the truth's.
    aside = basis[:2] @ (offset - (offset @ axis) * axis)
    values = {
        "axis_first": float(-basis[0] @ axis),
        "axis_second": float(-basis[1] @ axis),
        "center_first": float(aside[0]),
        "center_second": float(aside[1]),
        "center_along": float(offset @ own),
        "radius": float(track.cylinder.radius) - float(truth.radius),
        "height": float(track.cylinder.height) - float(truth.height),
    }
    deviation = dict(
        zip(track.coordinates, np.sqrt(np.diagonal(track.covariance)), strict=True)
    )
    known = [name for name in values if np.isfinite(deviation[name])]
    return (
        {name: values[name] for name in known},
        {name: float(deviation[name]) for name in known},
    )


def _in_world(image: LabeledImage, number: int) -> Cylinder:
    """One of the cylinders of an image of a video."""
    cylinder = jax.tree.map(lambda x: np.asarray(x)[number], image.cylinders)
    pose = RigidTransform.from_matrix(image.camera_from_world)
    return cylinder.transformed(pose.inverse())
