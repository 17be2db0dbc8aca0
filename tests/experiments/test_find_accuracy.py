"""What is found is resampled, kept and calibrated as the experiment says."""

import dataclasses

import numpy as np
import pytest

import impostor_jax as ij
from data_synth.distribution import Fixed
from data_synth.preset import CameraDraw
from data_synth.presets import PRESETS
from experiments.find_accuracy.calibrate import fit_weights
from experiments.find_accuracy.program import MissingProgramError
from experiments.find_accuracy.programs import PROGRAMS, Entry
from experiments.find_accuracy.run import resampled
from experiments.find_accuracy.runs import Runs
from impostor_jax.matching import LEVELS, RIGHT, WRONG, Comparison, Detection, Matches
from tests.groups import FULL


def compared(*verdicts):
    """An image with one cylinder."""
    there = np.array(verdicts, int)
    matches = Matches(there, np.where(there == RIGHT, 0, -1))
    return Comparison(1, np.full(len(there), 0.9), dict.fromkeys(LEVELS, matches))


def test_resampled_scores_spread_about_the_score():
    scores = resampled([compared(RIGHT, WRONG), compared()] * 20)
    false = np.array([score.false_per_image["fine"] for score in scores])
    assert abs(false.mean() - 0.5) < 0.03
    # Of 40 images, each with a false detection or none.
    assert false.std() == pytest.approx(np.sqrt(0.25 / 40), rel=0.3)


def test_a_program_that_is_missing_says_what_it_needs(monkeypatch):
    monkeypatch.delenv("CAPE_ROOT", raising=False)
    camera = ij.PinholeCamera(150.0, 150.0, 79.5, 59.5, 160, 120)
    readings = np.ones((120, 160), np.float32)
    with pytest.raises(MissingProgramError, match=r"github\.com/pedropro/CAPE"):
        PROGRAMS["CAPE"].function(readings, camera, ij.ConstantNoise(0.001))


@FULL
def test_what_a_program_has_found_is_kept(tmp_path, monkeypatch):
    camera = CameraDraw(count=1, width=160, height=120, focal=Fixed(130.0))
    preset = dataclasses.replace(PRESETS["bench"], camera=camera)
    runs = Runs(preset, 2, 1, tmp_path, 1)
    calls = []

    def found(depth, camera, sensor):
        calls.append(depth.shape)
        return [Detection(np.zeros(3), np.eye(3)[2], 0.1, np.nan, 0.5)] * len(calls)

    def missing(depth, camera, sensor):
        raise MissingProgramError("not here any more")

    monkeypatch.setitem(PROGRAMS, "peer", Entry("Finds as often as asked.", found))
    first = runs.detections("peer")
    assert calls == [(120, 160)] * 2
    monkeypatch.setitem(PROGRAMS, "peer", Entry("Is gone.", missing))
    again = runs.detections("peer")
    assert [len(own) for own in again] == [len(own) for own in first] == [1, 2]
    np.testing.assert_array_equal(again[1][1].axis, first[1][1].axis)
    changed = Entry("Has changed.", missing, ("experiments/fit_speed",))
    monkeypatch.setitem(PROGRAMS, "peer", changed)
    with pytest.raises(MissingProgramError):
        runs.detections("peer")


def test_weights_are_those_that_the_detections_were_drawn_with():
    rng = np.random.default_rng(0)
    # The last fact is the same of all: it tells nothing.
    facts = rng.normal([1.0, -2.0, 3.0], [0.5, 2.0, 0.0], (20000, 3))
    odds = 0.5 - 2.0 * facts[:, 0] + 0.7 * facts[:, 1]
    right = rng.random(len(facts)) < 1 / (1 + np.exp(-odds))
    weights = fit_weights(facts, right)
    np.testing.assert_allclose(weights.of_facts, [-2.0, 0.7, 0.0], atol=0.12)
    assert weights.bias == pytest.approx(0.5, abs=0.12)
    assert weights.confidence(facts).mean() == pytest.approx(right.mean(), abs=1e-6)


def test_weights_of_facts_that_tell_all_stay_finite():
    facts = np.linspace(-1, 1, 400)[:, None]
    weights = fit_weights(facts, facts[:, 0] > 0)
    sure = weights.confidence(facts)
    assert np.all(np.diff(sure) > 0)
    assert 0.9 < sure[-1] < 1
