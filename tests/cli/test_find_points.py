"""The command `find` with clouds of points."""

import json
import sys

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.__main__ import main
from impostor_jax.many import tasks
from tests.clouds.scenes import wall
from tests.groups import FULL, OF_POINTS
from tests.schemas import validator

pytestmark = OF_POINTS


@pytest.fixture
def folder(tmp_path):
    """A pipe as NPY and as text, and a file that is none."""
    rng = np.random.default_rng(0)
    pipe = wall(rng, 3000, (0, 0, 0), (1, 0, 0), 0.06, 2.0, (-1.3, 1.3), 0.002)
    np.save(tmp_path / "pipe.npy", pipe)
    np.savetxt(tmp_path / "again.xyz", pipe)
    (tmp_path / "broken.ply").write_bytes(b"ply\n")
    return tmp_path


@pytest.fixture
def find(folder, monkeypatch, capfd):
    """Run the command in the folder; its exit code, output and errors."""

    def run(*arguments):
        given = "find", *arguments, "--output", "out"
        monkeypatch.chdir(folder)
        monkeypatch.setattr(sys, "argv", ["impostor-jax", *map(str, given)])
        try:
            code = main()
        except SystemExit as stop:
            code = stop.code
        return code, *capfd.readouterr()

    return run


@FULL
def test_a_pipe_is_found_and_its_points_have_labels(find, folder):
    code, out, err = find("pipe.npy", "--origin", 0, 4, 0)
    assert (code, err) == (0, "")
    assert out.startswith("1 found, ")
    record = json.loads((folder / "out" / "found.json").read_text())
    validator("found").validate(record)
    assert record["cylinders"][0]["radius_m"] == pytest.approx(0.06, abs=1e-3)
    assert record["made_from"]["origin"] == [0, 4, 0]
    labels = np.load(folder / "out" / "labels.npy")
    assert labels.shape == (3000,)
    assert np.mean(labels == 1) > 0.95


def test_several_clouds_have_folders_of_their_names(find, folder, monkeypatch):
    asked = []

    def stand_in(points, **given):
        asked.append(given)
        nothing = np.zeros(0)
        planes = ij.Plane(np.zeros((0, 3)), np.zeros((0, 3)))
        labels = np.zeros(len(points), np.int32)
        told = nothing, nothing, nothing > 0, planes, 3000
        return ij.FoundInPoints((), labels, *told)

    monkeypatch.setattr(tasks, "find_cylinders_in_points", stand_in)
    code, _, _ = find(
        "pipe.npy", "again.xyz", "--min-pixels", 90, "--radius-range", 0.01, 0.2
    )
    assert code == 1
    assert {path.name for path in (folder / "out").iterdir()} == {
        "pipe", "again", "results.csv", "results.jsonl",
    }  # fmt: skip
    assert asked[0]["min_points"] == 90
    assert asked[0]["radius_range"] == (0.01, 0.2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("depth.png",),
            "--camera must be given to search the depth image 'depth.png'",
        ),
        (("missing.ply",), "point file 'missing.ply' does not exist"),
        (("broken.ply",), "point file 'broken.ply'"),
        (("pipe.npy", "--page", "a.html"), "--page must be given with depth images"),
        (
            ("pipe.npy", "--sensor", "stereo"),
            "--sensor must be given with depth images",
        ),
        (("pipe.npy", "again.xyz", "--json", "-"), "--json must not be given"),
        (("pipe.npy", "--sigma", -1), "sigma must be a positive number"),
    ],
)
def test_bad_input_is_one_line(find, arguments, message):
    code, out, err = find(*arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
