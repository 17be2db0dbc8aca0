"""The command `track`."""

import csv
import json
import sys

import cv2
import numpy as np
import pytest

from impostor_jax.__main__ import main
from tests.groups import SMALL_IMAGES
from tests.page.scenes import scene_of
from tests.track.scenes import can, frame

pytestmark = SMALL_IMAGES

RECORD = {
    "fx": 150.0, "fy": 150.0, "cx": 79.5, "cy": 59.5, "width": 160, "height": 120
}  # fmt: skip


@pytest.fixture
def track(tmp_path, monkeypatch, capfd):
    """Run the command in a folder with a video; its exit code, output and errors."""
    (tmp_path / "camera.json").write_text(json.dumps(RECORD))
    for name, shapes in (("cans", [can()]), ("wall", [])):
        (tmp_path / name).mkdir()
        for k in range(3):
            np.save(tmp_path / name / f"{k}.npy", frame(shapes, k))

    def run(*arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["impostor-jax", "track", *arguments])
        try:
            code = main()
        except SystemExit as stop:
            code = stop.code
        return code, *capfd.readouterr()

    return run


def test_a_row_for_each_track_of_each_image(track, tmp_path):
    words = "cans", "--camera", "camera.json", "--sigma", "0.001"
    prior = "--prior-radius", "0.04", "0.0001"
    code, out, _ = track(*words, *prior, "--page", "track.html")
    assert code == 0
    assert "1 cylinders in 3 images" in out
    scene = scene_of((tmp_path / "track.html").read_text())
    told = [(one["seconds"], one["tracks"][0]["status"]) for one in scene["images"]]
    assert told == [(0.0, "new"), (0.033333, "tracked"), (0.066667, "tracked")]
    with (tmp_path / "tracks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["new", "tracked", "tracked"]
    assert [row["name"] for row in rows] == ["0", "1", "2"]
    assert {row["identity"] for row in rows} == {"1"}
    assert float(rows[2]["time_s"]) == pytest.approx(2 / 30)
    off = float(rows[2]["radius_m"]) - 0.04
    assert abs(off) < 4 * float(rows[2]["std_radius_m"])
    assert float(rows[2]["std_radius_m"]) < float(rows[0]["std_radius_m"])
    assert float(rows[2]["center_m_z"]) == pytest.approx(0.5, abs=1e-3)
    assert abs(float(rows[2]["velocity_m_per_s_x"])) < 0.5


@pytest.mark.parametrize("ending", [".mp4", ".avi"])
def test_a_video_shows_the_outlines(ending, track, tmp_path):
    video = f"tracks{ending}"
    words = "cans", "--camera", "camera.json", "--sigma", "0.001", "--video", video
    assert track(*words)[0] == 0
    reader = cv2.VideoCapture(str(tmp_path / video))
    frames = [reader.read()[1] for _ in range(3)]
    assert not reader.read()[0]
    assert frames[2].shape == (120, 160, 3)
    # The first color of outlines is a red; no depth has one.
    red = (frames[2][..., 2] > 150) & (frames[2][..., 1] < 90)
    assert np.count_nonzero(red) > 50
    assert {path.name for path in tmp_path.iterdir()} == {
        "camera.json", "cans", "wall", "tracks.csv", video,
    }  # fmt: skip


def test_without_a_cylinder_it_ends_with_1(track, tmp_path):
    code, out, _ = track("wall", "--camera", "camera.json", "--sigma", "0.001")
    assert (code, "0 cylinders" in out) == (1, True)
    assert (tmp_path / "tracks.csv").read_text() in ("", "\n")


def test_an_image_that_is_broken_was_dropped(track, tmp_path):
    (tmp_path / "cans" / "1.npy").write_bytes(b"no image")
    code, out, err = track("cans", "--camera", "camera.json", "--sigma", "0.001")
    assert (code, "1 cylinders in 2 images" in out) == (1, True)
    assert "1: " in err
    with (tmp_path / "tracks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["new", "tracked"]
    assert float(rows[1]["time_s"]) == pytest.approx(2 / 30)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("cans",), "scene_camera.json"),
        (("cans", "--camera", "none.json"), "does not exist"),
        (("cans", "--camera", "camera.json", "--patience", "-1"), "patience must be"),
        (("cans", "--camera", "camera.json", "--page", "wall"), "page must be a file"),
        (
            ("cans", "--camera", "camera.json", "--prior-height", "-0.1", "0.01"),
            "prior['height'] must be a positive number in meters",
        ),
    ],
)
def test_bad_input_ends_with_2_and_one_line(track, arguments, message):
    code, _, err = track(*arguments)
    assert code == 2
    assert message in err
