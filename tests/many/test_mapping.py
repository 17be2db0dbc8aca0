"""Tasks on many images, in turn and in other processes."""

import json

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.found import Found
from impostor_jax.many import tasks
from impostor_jax.many.mapping import JOURNAL
from tests.data_synth.small import Here
from tests.fit.scenes import CAMERA, SIGMA, image
from tests.groups import SMALL_IMAGES

pytestmark = SMALL_IMAGES


@pytest.fixture
def folder(tmp_path):
    """Three cans, a file that is none, and the can's mask for each."""
    (tmp_path / "frames").mkdir()
    for name in ("a", "b", "d"):
        np.save(tmp_path / "frames" / f"{name}.npy", image(seed=ord(name))[0])
    (tmp_path / "frames" / "c.npy").write_bytes(b"broken")
    return tmp_path


@pytest.fixture
def searched(monkeypatch):
    """Depth images of all searches, which find nothing."""
    calls = []

    def stand_in(depth, camera, **options):
        calls.append((depth, options))
        nothing, nowhere = np.zeros(0), np.zeros((0, 3))
        masks = np.zeros((0, *depth.shape), bool)
        planes = ij.Plane(nowhere, nowhere)
        return Found((), masks, nothing, nothing, nothing > 0, planes)

    monkeypatch.setattr(tasks, "find_cylinders", stand_in)
    return calls


def test_a_broken_image_is_a_row_and_the_others_are_fitted(folder):
    found = {
        one.name: one
        for one in ij.map_images(
            folder / "frames", CAMERA, "cylinder", sigma=SIGMA, effort="fast"
        )
    }
    assert [*found] == ["a", "b", "c", "d"]
    assert "c.npy' is not a readable" in found["c"].failed
    (row,) = found["c"].rows
    assert (row["image"], row["status"]) == ("c", "failed")
    for name in "abd":
        (row,) = found[name].rows
        assert (row["image"], row["status"], row["success"]) == (
            name,
            "converged",
            True,
        )
        assert row["radius_m"] == pytest.approx(0.04, abs=1e-3)
        assert len(row["covariance"]) == 49
        assert row["version"]


def test_an_unexpected_error_of_one_image_leaves_the_others(folder, monkeypatch):
    def failing(depth, camera, **options):
        raise KeyError("lost")

    monkeypatch.setattr(tasks, "find_cylinders", failing)
    reasons = [one.failed for one in ij.map_images(folder / "frames", CAMERA)]
    assert reasons[0] == "KeyError: 'lost'"
    assert len(reasons) == 4


def test_what_is_done_is_left_out_until_something_changes(folder, searched):
    def run(**options):
        before = len(searched)
        given = {"output": folder / "out", "resume": True, **options}
        made = [one.name for one in ij.map_images(folder / "frames", CAMERA, **given)]
        assert sorted(made) == ["a", "b", "c", "d"]
        return len(searched) - before

    assert run() == 3
    assert run() == 0
    assert run(min_pixels=90) == 3
    assert run(min_pixels=90) == 0
    np.save(folder / "frames" / "a.npy", image(seed=9)[0])
    assert run(min_pixels=90) == 1
    assert run(min_pixels=90, resume=False) == 3
    read = ij.read_results(folder / "out" / JOURNAL)
    assert read["image"].tolist() == ["a", "b", "c", "d"]
    assert np.count_nonzero(read["status"] == "failed") == 1


def test_a_loop_that_is_left_keeps_what_was_done(folder, searched):
    made = ij.map_images(folder / "frames", CAMERA, output=folder / "out")
    assert next(made).name == "a"
    made.close()
    lines = (folder / "out" / JOURNAL).read_text().splitlines()
    assert [json.loads(line)[0] for line in lines] == ["a"]
    rest = ij.map_images(folder / "frames", CAMERA, output=folder / "out", resume=True)
    assert [one.name for one in rest] == ["a", "b", "c", "d"]
    assert len(searched) == 3


def test_an_executor_does_the_same(folder, searched):
    def rows(**options):
        made = ij.map_images(folder / "frames", CAMERA, **options)
        return [[row["status"] for row in one.rows] for one in made]

    assert rows() == rows(executor=Here())


def test_files_are_written_in_folders_of_the_names(folder):
    out = folder / "out"
    images = [folder / "frames" / f"{name}.npy" for name in "ab"]
    options = {"sigma": SIGMA, "effort": "fast", "output": out, "files": True}
    assert len([*ij.map_images(images, CAMERA, "cylinder", **options)]) == 2
    record = json.loads((out / "b" / "fit.json").read_text())
    assert record["success"] is True
    assert (out / "b" / "overlay.png").is_file()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"task": "cone"}, "task must be one of find, cylinder"),
        ({"resume": True}, "output must be given with resume"),
        ({"masks": "m"}, "mask must be given with what is fitted alone"),
        ({"masks": "m", "labels": "m", "task": "box"}, "not be given together"),
        ({"workers": 0}, "workers must be at least 1"),
        ({"fixed": ("radius",)}, "fixed must not be given with task 'find'"),
        ({"min_arc": 1.0, "task": "box"}, "min_arc must not be given with task 'box'"),
        ({"min_points": 60}, "min_points must not be given with images"),
        ({"task": "box", "effort": "slow"}, "effort must be"),
    ],
)
def test_bad_arguments_are_refused_at_once(folder, options, message):
    with pytest.raises(ValueError, match=message):
        ij.map_images(folder / "frames", CAMERA, **options)
