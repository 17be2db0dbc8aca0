"""Which detections are right, and what follows: precision, recall and calibration.

A detection is right if its axis, the place of its axis and its radius are near those of
a true cylinder that no surer detection has taken. What is compared is determined by the
image: heights and ends are not.
"""

__all__ = [
    "BINS",
    "IGNORED",
    "LEVELS",
    "MIN_READINGS",
    "MIN_VISIBLE",
    "RIGHT",
    "SURE",
    "WRONG",
    "Calibration",
    "Comparison",
    "Curve",
    "Detection",
    "Matches",
    "Score",
    "Tolerance",
    "Truth",
    "average_precision",
    "calibration",
    "compare",
    "detection_of",
    "distances",
    "match",
    "points_of",
    "precision_recall",
    "score_of",
    "score_record",
    "score_table",
    "truth_of",
]

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.fit.record import numbers
from impostor_jax.fit.result import Fit
from impostor_jax.io.dataset_shard import LabeledImage
from impostor_jax.rendering.silhouettes import silhouettes


class Tolerance(NamedTuple):
    """How far off a detection may be.

    Attributes:
        axis_deg: Angle between the axes, of whichever sign, in degrees.
        offset: Distance of the axis from the point of the true one beside which most is
            seen, in true radii.
        radius: Difference of the radii, in true radii.
    """

    axis_deg: float
    offset: float
    radius: float


LEVELS = {
    "coarse": Tolerance(15.0, 0.35, 0.25),
    "standard": Tolerance(5.0, 0.15, 0.10),
    "fine": Tolerance(2.0, 0.05, 0.03),
}

MIN_READINGS = 300
"""Readings in the visible part of a cylinder that must be found: pixels that have none
show nothing."""

MIN_VISIBLE = 0.3
"""Part of its silhouette in the frame that nothing hides. What is out of the frame does
not count: of a pipe around the camera that is 8/9 of the dataset's visible fraction."""

SURE = 0.5
"""Confidence from which false detections are counted apart."""

BINS = 10
"""Of equal width, in which confidences are compared with what is right."""

RIGHT, WRONG, IGNORED = 1, 0, -1
"""Verdicts on detections; one that is ignored is neither right nor false."""


class Detection(NamedTuple):
    """One cylinder that a program has found, in the camera's frame and in meters.

    Attributes:
        center: A point of the axis; the cylinder's middle if it is known.
        axis: Unit vector, of either sign.
        radius: Of the wall.
        height: From end to end; NaN if the program does not tell.
        confidence: In [0, 1], the larger the surer.
        radius_std: What the program says its radius is off by, one standard deviation;
            NaN if it does not tell.
    """

    center: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float
    height: float
    confidence: float
    radius_std: float = math.nan


class Truth(NamedTuple):
    """The cylinders of an image, as detections are compared with them.

    Attributes:
        axis: Unit vectors.
        place: Points of the axes beside which most is seen.
        radius: In meters.
        counted: Whether a cylinder must be found; else it is ignored.
    """

    axis: Float[np.ndarray, "n 3"]
    place: Float[np.ndarray, "n 3"]
    radius: Float[np.ndarray, " n"]
    counted: Bool[np.ndarray, " n"]


class Matches(NamedTuple):
    """Verdicts on the detections of an image, in the order of their list.

    Attributes:
        verdict: `RIGHT`, `WRONG` or `IGNORED`.
        truth: Number of the cylinder that a right one has found; -1 for the others.
    """

    verdict: Int[np.ndarray, " d"]
    truth: Int[np.ndarray, " d"]


class Comparison(NamedTuple):
    """What came of the detections in an image.

    Attributes:
        num_truths: Cylinders that count.
        confidence: Of the detections.
        matches: At each of `LEVELS`.
    """

    num_truths: int
    confidence: Float[np.ndarray, " d"]
    matches: dict[str, Matches]


class Curve(NamedTuple):
    """Precision against recall, from the surest detections to all."""

    recall: Float[np.ndarray, " k"]
    precision: Float[np.ndarray, " k"]


class Calibration(NamedTuple):
    """Confidence against what is right, in `BINS` bins.

    Attributes:
        confidence: Mean of each bin; NaN where it is empty.
        right: Share that is right; NaN where it is empty.
        number: Detections of the bin.
        error: Mean absolute difference of the two, weighted by the counts (the expected
            calibration error); NaN where nothing was detected.
    """

    confidence: Float[np.ndarray, " b"]
    right: Float[np.ndarray, " b"]
    number: Int[np.ndarray, " b"]
    error: float


@dataclasses.dataclass(frozen=True)
class Score:
    """How well a program did on some images.

    Attributes:
        num_images: Number of images.
        num_truths: Cylinders that count in all.
        average_precision: At each of `LEVELS`; NaN where no cylinder counts.
        curves: Precision against recall at each level.
        recall: Part of the cylinders that is found, at each level; NaN where none
            counts.
        false_per_image: All false detections, at each level.
        sure_false_per_image: Those with a confidence of at least `SURE`.
        calibration: At the standard level.
    """

    num_images: int
    num_truths: int
    average_precision: dict[str, float]
    curves: dict[str, Curve]
    recall: dict[str, float]
    false_per_image: dict[str, float]
    sure_false_per_image: dict[str, float]
    calibration: Calibration


def points_of(
    depth: Float[np.ndarray, "h w"], camera: AbstractCamera
) -> Float[np.ndarray, "h w 3"]:
    """Readings of a camera with a center as points of its frame; 0 for none."""
    row, col = camera.frame.pixels()
    ray = camera.rays(row, col, np.float32)
    return depth[..., None] * np.asarray(ray.direction.stack())


def detection_of(fit: Fit, confidence: float) -> Detection:
    """A fit that succeeded, with a camera that has no pose, as a detection."""
    shape = fit.cylinder
    return Detection(
        center=np.asarray(shape.center, float),
        axis=np.asarray(shape.axis, float),
        radius=float(shape.radius),
        height=float(shape.height) if fit.height_observed else math.nan,
        confidence=confidence,
        radius_std=float(fit.std.radius),
    )


def truth_of(image: LabeledImage) -> Truth:
    """What detections in an image of a dataset are compared with."""
    cylinders = image.cylinders
    center, axis = (np.asarray(v, float) for v in (cylinders.center, cylinders.axis))
    place, counted = center.copy(), np.zeros(len(center), bool)
    if not len(center):
        return Truth(axis, place, np.zeros(0), counted)
    points = points_of(image.depth, image.camera)
    whole = np.asarray(silhouettes(cylinders, image.camera).count)
    for k, mask in enumerate(image.mask):
        seen = points[mask & (image.depth > 0)]
        if len(seen):
            place[k] += np.median((seen - center[k]) @ axis[k]) * axis[k]
        counted[k] = len(seen) >= MIN_READINGS
        counted[k] &= np.count_nonzero(mask) >= MIN_VISIBLE * whole[k]
    return Truth(axis, place, np.asarray(cylinders.radius, float), counted)


def match(
    truth: Truth, detections: Sequence[Detection], tolerance: Tolerance
) -> Matches:
    """Give each cylinder that counts to the surest detection that is near enough.

    Of several cylinders that are near, a detection takes the nearest. One that is no
    cylinder that counts and is within the coarse tolerance of one that is ignored, is
    ignored.
    """
    verdict = np.full(len(detections), WRONG)
    found = np.full(len(detections), -1)
    free = truth.counted.copy()
    for k in np.argsort([-one.confidence for one in detections], kind="stable"):
        distance = np.where(free, distances(truth, detections[k], tolerance), np.inf)
        if np.min(distance, initial=np.inf) <= 1:
            best = int(np.argmin(distance))
            verdict[k], found[k], free[best] = RIGHT, best, False
            continue
        near = distances(truth, detections[k], LEVELS["coarse"]) <= 1
        if np.any(near & ~truth.counted):
            verdict[k] = IGNORED
    return Matches(verdict, found)


def distances(
    truth: Truth, detection: Detection, tolerance: Tolerance
) -> Float[np.ndarray, " n"]:
    """The largest of a detection's differences over what is tolerated, of each."""
    axis = np.asarray(detection.axis, float)
    cross = np.linalg.norm(np.cross(truth.axis, axis), axis=1)
    angle = np.degrees(np.arctan2(cross, np.abs(truth.axis @ axis)))
    beside = np.cross(truth.place - np.asarray(detection.center, float), axis)
    offset = np.linalg.norm(beside, axis=1) / truth.radius
    radius = np.abs(detection.radius - truth.radius) / truth.radius
    ratios = np.stack([angle, offset, radius], axis=1) / tolerance
    # A program that returns a number that is not finite is wrong.
    return np.where(np.isfinite(ratios), ratios, np.inf).max(axis=1)


def precision_recall(
    right: Bool[np.ndarray, " d"],
    confidence: Float[np.ndarray, " d"],
    num_truths: int,
) -> Curve:
    """Precision and recall of the detections above each confidence that occurs.

    Those of one confidence come together, so that their order does not matter.
    """
    order = np.argsort(-confidence, kind="stable")
    last = np.append(np.diff(confidence[order]) != 0, True)[: len(order)]
    hits = np.cumsum(right[order])[last]
    taken = (np.arange(len(order)) + 1)[last]
    return Curve(hits / max(num_truths, 1), hits / taken)


def average_precision(curve: Curve) -> float:
    """Area under the curve, each precision the best at that recall or a larger one."""
    best = np.maximum.accumulate(curve.precision[::-1])[::-1]
    return float(np.sum(np.diff(curve.recall, prepend=0.0) * best))


def calibration(
    right: Bool[np.ndarray, " d"], confidence: Float[np.ndarray, " d"]
) -> Calibration:
    """Compare confidences with the shares that are right."""
    place = np.minimum((confidence * BINS).astype(int), BINS - 1)
    count = np.bincount(place, minlength=BINS)
    sums = [np.bincount(place, weights=w, minlength=BINS) for w in (confidence, right)]
    means = [
        np.divide(s, count, out=np.full(BINS, np.nan), where=count > 0) for s in sums
    ]
    gap = float(np.sum(np.abs(sums[0] - sums[1])))
    error = gap / len(right) if len(right) else math.nan
    return Calibration(means[0], means[1], count, error)


def compare(truth: Truth, detections: Sequence[Detection]) -> Comparison:
    """Compare the detections in an image with what is there."""
    return Comparison(
        num_truths=int(np.count_nonzero(truth.counted)),
        confidence=np.array([one.confidence for one in detections], float),
        matches={
            level: match(truth, detections, tolerance)
            for level, tolerance in LEVELS.items()
        },
    )


def score_of(images: Sequence[Comparison]) -> Score:
    """Sum up what came of at least one image."""
    num_images = len(images)
    num_truths = sum(image.num_truths for image in images)
    confidence = np.concatenate([image.confidence for image in images])
    curves, recall, precision, false, sure = {}, {}, {}, {}, {}
    told: dict[str, Calibration] = {}
    for level in LEVELS:
        verdict = np.concatenate([one.matches[level].verdict for one in images])
        rated = verdict != IGNORED
        right, sureness = verdict[rated] == RIGHT, confidence[rated]
        curve = precision_recall(right, sureness, num_truths)
        curves[level] = curve
        recall[level] = np.count_nonzero(right) / num_truths if num_truths else math.nan
        precision[level] = average_precision(curve) if num_truths else math.nan
        false[level] = np.count_nonzero(~right) / num_images
        sure[level] = np.count_nonzero(~right & (sureness >= SURE)) / num_images
        told[level] = calibration(right, sureness)
    return Score(
        num_images=num_images,
        num_truths=num_truths,
        average_precision=precision,
        curves=curves,
        recall=recall,
        false_per_image=false,
        sure_false_per_image=sure,
        calibration=told["standard"],
    )


def score_table(score: Score) -> str:
    """Table of a score, for a reader."""
    titles = ("tolerance", "recall", "false/image", "of these sure", "precision")
    lines = [
        f"{score.num_images} images, {score.num_truths} cylinders that count",
        "".join(f"{title:>15}" for title in titles),
    ]
    for level in LEVELS:
        numbers = (
            score.recall[level],
            score.false_per_image[level],
            score.sure_false_per_image[level],
            score.average_precision[level],
        )
        lines.append(f"{level:>15}" + "".join(f"{x:>15.3f}" for x in numbers))
    lines.append(f"confidences are off by {score.calibration.error:.3f} on average")
    return "\n".join(lines)


def score_record(score: Score) -> dict[str, Any]:
    """A score as JSON can hold it; null where a number is NaN."""
    names = "recall", "false_per_image", "sure_false_per_image", "average_precision"
    return {
        "num_images": score.num_images,
        "num_truths": score.num_truths,
        **{
            name: {
                level: numbers(value) for level, value in getattr(score, name).items()
            }
            for name in names
        },
        "calibration_error": numbers(score.calibration.error),
    }
