"""Fitting a dataset's cylinders: renderer, sensor and fit in one loop."""

import dataclasses
import json
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from data_synth.distribution import Fixed, Uniform
from data_synth.preset import CameraDraw, Preset, Rules
from impostor_jax.__main__ import main
from impostor_jax.evaluate import (
    Outcome,
    evaluate,
    standardized,
    summarize,
    table,
)
from impostor_jax.fit.fittable import CYLINDER, KINDS
from impostor_jax.io.dataset import read_dataset, read_manifest, sensor_of
from tests.data_synth.small import small_dataset
from tests.fit.scenes import CAMERA, SIGMA, image_of
from tests.fit.test_frustum import cup
from tests.fit.test_sphere import ball
from tests.groups import FULL, SMALL_IMAGES

pytestmark = FULL

COUNT = 12
# Of the size that other tests fit, whose compiled fits it shares.
CANS = Preset(
    sentence="Two cans on a table.",
    count=Fixed(2),
    radius=Uniform(0.035, 0.05),
    aspect=Uniform(2.0, 3.0),
    placement=("standing", "lying"),
    distance=Uniform(0.6, 0.7),
    elevation=Uniform(30.0, 50.0),
    ground=True,
    wall=Fixed(2.0),
    camera=CameraDraw(count=1, width=160, height=120, focal=Fixed(150.0)),
    sensor=ij.ConstantNoise(0.001),
    rules=Rules(visible_fraction=0.3, smallest_outline=300),
)


@pytest.fixture(scope="module")
def cans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cans") / "dataset"
    small_dataset(folder, CANS, count=COUNT)
    return folder


@pytest.fixture(scope="module")
def outcomes(cans):
    sensor = sensor_of(read_manifest(cans))
    assert sensor == CANS.sensor
    return [o for some in evaluate(read_dataset(cans), sensor) for o in some]


@SMALL_IMAGES
def test_every_visible_cylinder_is_fitted(outcomes):
    assert len(outcomes) == 2 * COUNT
    assert {(o.key, o.number) for o in outcomes} == {
        (f"{k // 4:06d}_{k % 4:06d}", n) for k in range(COUNT) for n in range(2)
    }
    assert all(outcome.success for outcome in outcomes)


@SMALL_IMAGES
def test_errors_are_as_large_as_their_deviations_say(outcomes):
    scaled = standardized(outcomes)
    assert len(scaled) >= 5 * len(outcomes)
    # The errors of one fit are correlated: as if every fourth were independent.
    assert abs(np.mean(scaled**2) - 1) < 4 * np.sqrt(2 / (len(scaled) / 4))
    assert np.abs(scaled).max() < 5
    assert np.median([abs(o.errors["radius"]) for o in outcomes]) < 5e-4


@SMALL_IMAGES
def test_heights_are_compared_where_both_ends_are_seen(outcomes):
    seen = ["height" in outcome.errors for outcome in outcomes]
    assert any(seen)
    assert not all(seen)
    for outcome in outcomes:
        assert (
            set(outcome.errors) == set(outcome.deviations) <= set(CYLINDER.coordinates)
        )
        assert ("height" in outcome.errors) == ("center_along" in outcome.errors)


@SMALL_IMAGES
def test_the_command_prints_a_table_and_writes_every_outcome(
    cans, outcomes, tmp_path, monkeypatch, capsys
):
    path = tmp_path / "outcomes.json"
    words = ["evaluate", str(cans), "--limit", "2", "--json", str(path)]
    monkeypatch.setattr(sys, "argv", ["impostor-jax", *words])
    assert main() == 0
    found = capsys.readouterr()
    assert found.err == ""
    assert found.out.splitlines()[0].split()[:2] == ["visible", "number"]
    record = json.loads(path.read_text())
    assert record == [dataclasses.asdict(o) for o in outcomes[:4]]


@SMALL_IMAGES
def test_eroded_masks_leave_out_their_edges(cans, outcomes):
    images = [read_dataset(cans)[0]]
    (some,) = evaluate(images, CANS.sensor, erode_px=2)
    assert 0 < some[0].num_readings < outcomes[0].num_readings


@SMALL_IMAGES
def test_the_command_scores_what_is_found_without_masks(
    cans, tmp_path, monkeypatch, capsys
):
    path = tmp_path / "found.json"
    words = ["evaluate", str(cans), "--find", "--limit", "3", "--json", str(path)]
    monkeypatch.setattr(sys, "argv", ["impostor-jax", *words])
    assert main() == 0
    found = capsys.readouterr()
    assert found.err == ""
    lines = found.out.splitlines()
    assert lines[0] == "3 images, 6 cylinders that count"
    assert lines[1].split()[:2] == ["tolerance", "recall"]
    assert any(line.split()[:2] == ["visible", "number"] for line in lines)
    record = json.loads(path.read_text())
    score, outcomes = record["score"], record["outcomes"]
    assert score["recall"]["standard"] > 0.6
    assert score["recall"]["coarse"] >= score["recall"]["fine"]
    assert len(outcomes) == round(6 * score["recall"]["standard"])
    assert all(
        abs(one["errors"]["radius"]) <= 0.1 * one["radius_m"] for one in outcomes
    )


@SMALL_IMAGES
@pytest.mark.parametrize("shape", [cup(), ball()], ids=["frustum", "sphere"])
def test_other_shapes_are_compared_with_the_truth(shape):
    depth, mask = image_of(shape)
    several = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], shape)
    seen = ij.LabeledImage(depth, mask[None], CAMERA, several, np.ones(1), "0_0")
    ((found,),) = evaluate([seen], ij.ConstantNoise(SIGMA))
    assert found.success
    assert list(found.errors) == list(KINDS[type(shape)].coordinates)
    scaled = standardized([found])
    assert 0 < np.abs(scaled).max() < 4
    text = table([found])
    assert all(f" {name} " in text for name in found.errors)
    summary = summarize([found])
    assert summary.wrong == 0
    assert 0 < summary.radius_mm < 1
    assert 0 < summary.center_mm < 1


def outcome(error, deviation, visible=1.0, success=True):
    errors = {"radius": error} if success else {}
    deviations = {"radius": deviation} if success else {}
    status = "converged" if success else "poor_fit"
    return Outcome(
        "000000_000000", 0, visible, 100, status, success, errors, deviations, 0.04
    )


def test_a_summary_counts_failures_and_what_is_wrong():
    some = [outcome(0.01, 0.001), outcome(-0.001, 0.001), outcome(0, 0, success=False)]
    found = summarize(some)
    assert (found.count, found.failures, found.wrong) == (3, 1, 1)
    assert found.radius_mm == pytest.approx(5.5)
    assert np.isnan(found.height_mm)
    assert found.interval_coverage == {"68 %": 0.0, "95 %": 0.5}


def test_coverage_of_normal_errors_is_nominal():
    errors = np.random.default_rng(0).normal(size=4000)
    found = summarize([outcome(float(e), 1.0) for e in errors])
    assert found.spread == pytest.approx(1, abs=0.05)
    assert found.interval_coverage["68 %"] == pytest.approx(0.6827, abs=0.03)
    assert found.interval_coverage["95 %"] == pytest.approx(0.95, abs=0.014)


def test_a_table_has_a_row_for_each_visibility():
    lines = table([outcome(0.001, 0.001, 0.3), outcome(0.001, 0.001, 1.0)]).splitlines()
    assert [line.split()[0] for line in lines] == [
        "visible", "20%-40%", "95%-100%", "all", "radius",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--limit", "0"], "limit must be a whole number"),
        (["--erode-px", "-1"], "erode_px must be a whole number"),
        (["--erode-px", "1", "--find"], "must not be given with --find"),
        ([], "manifest of dataset"),
    ],
)
def test_bad_arguments_are_one_line(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.setattr(
        sys, "argv", ["impostor-jax", "evaluate", str(tmp_path), *words]
    )
    assert main() == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
