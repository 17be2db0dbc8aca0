"""Counts of tracks, on cases that are counted by hand, and of a drawn video."""

import numpy as np
import pytest

import impostor_jax as ij
from data_synth.camera_draw import CameraDraw
from data_synth.distribution import Fixed, Uniform
from data_synth.preset import Preset, Rules
from impostor_jax.evaluate_tracks import (
    TrackedImage,
    evaluate_tracks,
    pair_tracks,
    score_tracks,
)
from impostor_jax.matching import Detection, Truth
from tests.data_synth.small import small_dataset
from tests.groups import FULL, SMALL_IMAGES
from tests.track.scenes import can

pytestmark = SMALL_IMAGES

NOISE = ij.ConstantNoise(0.001)


def seen(x):
    """A track as it is compared."""
    shape = can(x=x)
    center, axis = (np.asarray(v, float) for v in (shape.center, shape.axis))
    return Detection(center, axis, float(shape.radius), float(shape.height), 1.0)


def truth_of(cans, counted=True):
    return Truth(
        axis=np.array([one.axis for one in cans], float),
        place=np.array([one.center for one in cans], float),
        radius=np.array([one.radius for one in cans], float),
        counted=np.full(len(cans), counted),
    )


def test_a_track_stays_with_its_cylinder_while_it_is_near():
    cans = [can(x=0.0), can(x=0.1)]
    near = {7: seen(0.001), 8: seen(0.0), 9: seen(0.5)}
    truth = truth_of(cans)
    assert pair_tracks(truth, near, {}) == ({0: 8}, 2)
    assert pair_tracks(truth, near, {0: 7}) == ({0: 7}, 2)
    assert pair_tracks(truth, near, {0: 9}) == ({0: 8}, 2)
    assert pair_tracks(truth_of(cans, counted=False), near, {}) == ({}, 1)
    assert pair_tracks(truth, {}, {0: 7}) == ({}, 0)


def test_scores_sum_up_images():
    images = [
        TrackedImage(2, 0, 1, 0, [{"radius": 1e-3}], [{"radius": 1e-3}]),
        TrackedImage(2, 1, 0, 1, [{"radius": -3e-3}], [{"radius": 1e-3}]),
    ]
    score = score_tracks(images)
    assert score.mota == pytest.approx(1 - 3 / 4)
    assert score.rms["radius"] == pytest.approx(np.sqrt(5) * 1e-3)
    assert score.coverage["radius"] == 0.5


@FULL
def test_cans_of_a_drawn_video_keep_their_tracks(tmp_path):
    preset = Preset(
        sentence="A can on a table.",
        radius=Uniform(0.04, 0.05),
        placement=("standing",),
        distance=Fixed(0.5),
        spread=0.02,
        ground=True,
        wall=Fixed(1.5),
        camera=CameraDraw(count=1, width=160, height=120, focal=Fixed(150.0)),
        sensor=NOISE,
        rules=Rules(smallest_outline=300),
    )
    small_dataset(tmp_path / "video", preset, count=8, sequence=8)
    images = list(ij.read_dataset(tmp_path / "video"))
    score = score_tracks(evaluate_tracks(images, NOISE))
    assert (score.num_images, score.num_truths) == (8, 8)
    assert score.mota == 1.0
    assert score.rms["radius"] < 3e-4
    with pytest.raises(ValueError, match="images must be of videos"):
        next(evaluate_tracks([images[0]._replace(seconds=None)], NOISE))
