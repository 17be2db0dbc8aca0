"""Detections are counted as right, false or neither, and summed up as defined."""

import numpy as np
import pytest

import impostor_jax as ij
from experiments.find_accuracy.program import Detection, MissingProgramError
from experiments.find_accuracy.programs import PROGRAMS
from experiments.find_accuracy.scoring import (
    BINS,
    IGNORED,
    LEVELS,
    RIGHT,
    WRONG,
    Truth,
    average_precision,
    calibration,
    match,
    outcome_of,
    precision_recall,
    resampled,
    score_of,
    truth_of,
)

STANDARD = LEVELS["standard"]

X, Y = np.eye(3)[:2]


def truth(*, counted=(True, True)):
    """Two cylinders of radius 0.1 along y, 1 m beside each other."""
    place = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 2.0]])
    return Truth(np.stack([Y, Y]), place, np.full(2, 0.1), np.array(counted))


def detection(x=0.0, confidence=0.9, axis=Y, radius=0.1, z=2.0, y=0.0):
    return Detection(np.array([x, y, z]), axis, radius, np.nan, confidence)


def verdicts(found, there=None, tolerance=STANDARD):
    return match(there or truth(), found, tolerance).verdict.tolist()


def tilted(degrees):
    angle = np.radians(degrees)
    return np.cos(angle) * Y + np.sin(angle) * X


def test_a_perfect_detection_is_right_at_every_level():
    for tolerance in LEVELS.values():
        # Any point of the axis will do, and either sign.
        found = [detection(0.0, y=7.0), detection(1.0, axis=-Y)]
        assert match(truth(), found, tolerance).truth.tolist() == [0, 1]


@pytest.mark.parametrize("level", LEVELS)
def test_each_tolerance_is_a_bound(level):
    most = LEVELS[level]
    for part, verdict in ((0.99, RIGHT), (1.01, WRONG)):
        for found in (
            detection(axis=tilted(part * most.axis_deg)),
            detection(z=2 + part * most.offset * 0.1),
            detection(radius=0.1 * (1 + part * most.radius)),
            detection(radius=0.1 * (1 - part * most.radius)),
        ):
            assert verdicts([found], tolerance=most) == [verdict]


def test_only_the_surest_of_two_detections_is_right():
    found = [detection(confidence=0.3), detection(z=2.005, confidence=0.6)]
    assert verdicts(found) == [WRONG, RIGHT]


def test_a_detection_takes_the_nearest_cylinder():
    there = truth()
    there.place[1, 0] = 0.01
    found = [detection(0.008, confidence=0.9), detection(0.001, confidence=0.8)]
    assert match(there, found, STANDARD).truth.tolist() == [1, 0]


def test_what_is_near_an_ignored_cylinder_is_neither_right_nor_false():
    there = truth(counted=(True, False))
    coarse = detection(1.0, radius=0.12)
    # Far from both; near the ignored one, and once more; near the other.
    found = [detection(5.0), detection(1.0), coarse, detection(0.0)]
    assert verdicts(found, there) == [WRONG, IGNORED, IGNORED, RIGHT]
    score = score_of([outcome_of(there, found)])
    assert score.num_truths == 1
    assert score.false_per_image["standard"] == 1


def test_numbers_that_are_not_finite_are_false():
    assert verdicts([detection(np.nan), detection(radius=np.inf)]) == [WRONG, WRONG]


def test_nothing_is_found_in_an_image_without_cylinders():
    nothing = Truth(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, bool))
    score = score_of([outcome_of(nothing, []), outcome_of(nothing, [detection()])])
    assert np.isnan(score.average_precision["standard"])
    assert score.false_per_image["standard"] == 0.5
    assert score.sure_false_per_image["standard"] == 0.5


def test_average_precision_of_a_known_list():
    right = np.array([True, False, True, True, False])
    confidence = np.array([0.9, 0.8, 0.7, 0.6, 0.5])
    curve = precision_recall(right, confidence, 4)
    np.testing.assert_allclose(curve.recall, [0.25, 0.25, 0.5, 0.75, 0.75])
    np.testing.assert_allclose(curve.precision, [1, 1 / 2, 2 / 3, 3 / 4, 3 / 5])
    # The precisions 2/3 and 3/4 are both 3/4: it is reached at a larger recall.
    assert average_precision(curve) == pytest.approx(0.25 + 2 * 0.25 * 0.75)


def test_order_within_one_confidence_does_not_matter():
    confidence, areas = np.full(4, 0.5), []
    for right in ([True, True, False, False], [False, False, True, True]):
        curve = precision_recall(np.array(right), confidence, 2)
        areas.append(average_precision(curve))
    assert areas == [0.5, 0.5]


def test_no_detections_have_no_precision():
    nothing = np.zeros(0)
    curve = precision_recall(nothing.astype(bool), nothing, 3)
    assert average_precision(curve) == 0
    assert np.isnan(calibration(nothing.astype(bool), nothing).error)


def test_calibration_error_of_a_known_list():
    confidence = np.array([0.92, 0.98, 0.55, 0.55, 0.55, 0.55, 1.0])
    right = np.array([True, False, True, True, False, False, True])
    told = calibration(right, confidence)
    assert told.number.tolist() == [0, 0, 0, 0, 0, 4, 0, 0, 0, 3]
    assert told.right[5] == 0.5
    assert told.confidence[5] == pytest.approx(0.55)
    last = abs((0.92 + 0.98 + 1.0) / 3 - 2 / 3)
    assert told.error == pytest.approx((4 * 0.05 + 3 * last) / 7)
    assert len(told.right) == BINS
    assert np.isnan(told.right[0])


def test_resampled_scores_spread_about_the_score():
    there, found = truth(), [detection(0.0), detection(3.0)]
    outcomes = [outcome_of(there, found), outcome_of(there, [])] * 20
    scores = resampled(outcomes)
    false = np.array([score.false_per_image["fine"] for score in scores])
    assert abs(false.mean() - 0.5) < 0.03
    # Of 40 images, each with a false detection or none.
    assert false.std() == pytest.approx(np.sqrt(0.25 / 40), rel=0.3)


def test_what_hardly_shows_is_ignored():
    camera = ij.PinholeCamera(150.0, 150.0, 79.5, 59.5, 160, 120)
    center = np.float32([[-0.2, 0, 1], [0.0, 0, 1], [0.2, 0, 1]])
    axis, radius = np.tile(np.float32(Y), (3, 1)), np.full(3, 0.06, np.float32)
    cans = ij.Cylinder(center, axis, radius, np.full(3, 0.4, np.float32))
    maps = ij.render(ij.Scene([cans]), camera, ("depth", "index"))
    index, depth = np.asarray(maps.index), np.asarray(maps.depth)
    mask = np.stack([index == k for k in range(3)])
    # Little is seen of the second; of the third there are few readings.
    mask[1, 40:] = False
    depth = np.where(index < 0, 0, depth)
    depth[mask[2] & (np.arange(120)[:, None] > 70)] = 0
    depth[mask[2] & (np.arange(120)[:, None] < 60)] = 0
    image = ij.LabeledImage(depth, mask, camera, cans, np.ones(3), "")
    seen = truth_of(image)
    assert seen.counted.tolist() == [True, False, False]
    np.testing.assert_allclose(seen.place[0], center[0], atol=0.01)
    assert seen.place[1, 1] < -0.05


def test_a_program_that_is_missing_says_what_it_needs(monkeypatch):
    monkeypatch.delenv("CAPE_ROOT", raising=False)
    camera = ij.PinholeCamera(150.0, 150.0, 79.5, 59.5, 160, 120)
    readings = np.ones((120, 160), np.float32)
    with pytest.raises(MissingProgramError, match=r"github\.com/pedropro/CAPE"):
        PROGRAMS["CAPE"].function(readings, camera, ij.ConstantNoise(0.001))
