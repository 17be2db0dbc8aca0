"""The command `find`."""

import json
import sys

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.__main__ import main
from impostor_jax.find.found import Found
from impostor_jax.many import tasks
from tests.fit.scenes import SIGMA, can, image
from tests.groups import SMALL_IMAGES
from tests.page.scenes import scene_of
from tests.schemas import validator

pytestmark = SMALL_IMAGES

RECORD = {
    "fx": 150.0, "fy": 150.0, "cx": 79.5, "cy": 59.5, "width": 160, "height": 120
}  # fmt: skip
CYLINDER_KEYS = {
    "label", "confidence", "visible", "inside", "status", "world_from_cylinder",
    "center_m", "axis", "radius_m", "height_m", "std", "std_budget", "ends_seen",
    "num_pixels", "rms_m", "chi2",
}  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """A can in front of a wall, twice, and the wall alone."""
    (tmp_path / "camera.json").write_text(json.dumps(RECORD))
    (tmp_path / "frames").mkdir()
    for name, seed in (("a", 0), ("b", 1)):
        np.save(tmp_path / "frames" / f"{name}.npy", image(seed=seed)[0])
    wall = np.full((120, 160), 0.6, np.float32)
    np.save(tmp_path / "wall.npy", wall)
    return tmp_path


@pytest.fixture
def find(folder, monkeypatch, capfd):
    """Run the command in the folder; its exit code, output and errors."""

    def run(*arguments):
        camera = () if "--camera" in arguments else ("--camera", "camera.json")
        given = "find", *arguments, *camera, "--output", "out"
        monkeypatch.chdir(folder)
        monkeypatch.setattr(sys, "argv", ["impostor-jax", *map(str, given)])
        try:
            code = main()
        except SystemExit as stop:
            code = stop.code
        return code, *capfd.readouterr()

    return run


@pytest.fixture
def searched(monkeypatch):
    """Arguments of all searches, which are done by a fit with the true mask."""
    calls = []
    # Loaded before the search is replaced: its module keeps the one it imports.
    fit_cylinder = ij.fit_cylinder

    def stand_in(depth, camera, **options):
        calls.append(options)
        mask = image()[1] & (np.ptp(depth) > 0.1)
        fits = []
        if mask.any():
            fits.append(fit_cylinder(depth, camera, mask, SIGMA))
        ones = np.ones(len(fits))
        planes = ij.Plane(np.array([[0, 0, 0.6]]), np.array([[0, 0, -1.0]]))
        masks = np.tile(mask, (len(fits), 1, 1))
        return Found(tuple(fits), masks, ones, 0.9 * ones, ones < 0, planes)

    monkeypatch.setattr(tasks, "find_cylinders", stand_in)
    return calls


def names(folder):
    return {path.name for path in folder.iterdir()}


FILES = {"found.json", "labels.png", "overlay.png"}


def test_a_can_is_found_and_told(find, folder):
    code, out, err = find("frames/a.npy", "--sigma", SIGMA)
    assert (code, err) == (0, "")
    assert " found, " in out
    assert "radius 40." in out or "radius 39." in out
    assert names(folder / "out") == FILES
    record = json.loads((folder / "out" / "found.json").read_text())
    validator("found").validate(record)
    assert record["frame"].startswith("the camera's: x right")
    assert record["image"] == {"width": 160, "height": 120}
    one = record["cylinders"][0]
    assert set(one) == CYLINDER_KEYS
    assert one["label"] == 1
    assert one["radius_m"] == pytest.approx(0.04, abs=1e-3)
    labels = cv2.imread(str(folder / "out" / "labels.png"), cv2.IMREAD_UNCHANGED)
    assert labels.dtype == np.uint16
    seen, mask = labels == 1, image()[1]
    assert np.count_nonzero(seen & mask) > 0.8 * np.count_nonzero(mask)


def test_a_page_shows_what_was_found(find, folder, searched):
    code, _, err = find("frames/a.npy", "--page", "out/found.html")
    assert (code, err) == (0, "")
    assert names(folder / "out") == FILES | {"found.html"}
    page = (folder / "out" / "found.html").read_text()
    (shape,) = scene_of(page)["shapes"]
    assert shape["numbers"][0][:2] == ["confidence", "0.90"]
    code, _, err = find("frames", "--page", "out/found.html")
    assert code == 2
    assert "--page must not be given with several images" in err


def test_a_pose_stands_at_the_center_with_z_along_the_axis(find, folder, searched):
    assert find("frames/a.npy")[0] == 0
    record = json.loads((folder / "out" / "found.json").read_text())
    (one,) = record["cylinders"]
    pose = np.array(one["world_from_cylinder"])
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-6)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1, abs=1e-6)
    np.testing.assert_allclose(pose[:3, 2], one["axis"])
    np.testing.assert_allclose(pose[:3, 3], one["center_m"])
    assert pose[3].tolist() == [0, 0, 0, 1]
    assert abs(pose[:3, 2] @ np.asarray(can().axis)) == pytest.approx(1, abs=1e-4)
    assert record["planes"] == [
        {"point_m": [0, 0, pytest.approx(0.6)], "normal": [0, 0, -1]}
    ]


def test_an_image_without_cylinders_exits_with_1_and_writes_its_files(find, folder):
    code, out, err = find("wall.npy")
    assert (code, err) == (1, "")
    assert out.startswith("0 found")
    assert names(folder / "out") == FILES
    record = json.loads((folder / "out" / "found.json").read_text())
    validator("found").validate(record)
    assert record["cylinders"] == []
    labels = cv2.imread(str(folder / "out" / "labels.png"), cv2.IMREAD_UNCHANGED)
    assert labels.dtype == np.uint16
    assert not labels.any()


@pytest.mark.parametrize("given", ["frames", "frames/*.npy"])
def test_a_folder_or_a_pattern_stands_for_its_images(find, folder, searched, given):
    code, out, err = find(given, "wall.npy")
    assert (code, err) == (0, "")
    assert out.startswith("3 images in ")
    assert out.endswith("2 converged, 1 nothing_found; table 'out/results.csv'\n")
    for name, count in (("frames/a", 1), ("frames/b", 1), ("wall", 0)):
        record = json.loads((folder / "out" / name / "found.json").read_text())
        assert len(record["cylinders"]) == count


def test_a_table_of_a_single_image_is_written(find, folder, searched):
    assert find("frames/a.npy", "--table", "out/all.csv")[0] == 0
    table = ij.read_results(folder / "out" / "all.csv")
    assert table["image"].tolist() == ["a"]
    assert table["status"].tolist() == ["converged"]


def test_a_broken_image_is_a_row_of_the_table(find, folder, searched):
    (folder / "frames" / "0.npy").write_bytes(b"broken")
    asked = "frames", "--only-table", "--table", "out/all.csv"
    code, out, err = find(*asked)
    assert code == 1
    assert out.startswith("3 images in ")
    assert "0: depth image 'frames/0.npy' is not a readable" in err
    table = ij.read_results(folder / "out" / "all.csv")
    assert table["image"].tolist() == ["0", "a", "b"]
    assert table["status"].tolist() == ["failed", "converged", "converged"]
    assert names(folder / "out") == {"all.csv", "results.jsonl"}
    # The rest of a run is what failed, or is new.
    np.save(folder / "frames" / "0.npy", image(seed=3)[0])
    assert find(*asked, "--resume")[0] == 0
    assert len(searched) == 3
    table = ij.read_results(folder / "out" / "all.csv")
    assert table["status"].tolist() == ["converged"] * 3


def test_an_interrupted_run_says_how_it_goes_on(find, folder, searched, monkeypatch):
    real = tasks.find_cylinders

    def interrupted(*arguments, **options):
        if searched:
            raise KeyboardInterrupt
        return real(*arguments, **options)

    monkeypatch.setattr(tasks, "find_cylinders", interrupted)
    code, _, err = find("frames")
    assert code == 130
    assert err.splitlines()[-1].endswith("interrupted; --resume does the rest")
    monkeypatch.setattr(tasks, "find_cylinders", real)
    assert find("frames", "--resume")[0] == 0
    assert len(searched) == 2


def test_each_image_may_have_its_camera(find, folder, searched):
    for name in "ab":
        (folder / "frames" / f"{name}.json").write_text(json.dumps(RECORD))
    code, _, err = find("frames/*.npy", "--camera", "{folder}/{name}.json")
    assert (code, err) == (0, "")
    (folder / "frames" / "b.json").unlink()
    code, _, err = find("frames/*.npy", "--camera", "{folder}/{name}.json")
    assert (code, len(err.splitlines())) == (1, 1)
    assert "b: camera file 'frames/b.json' does not exist" in err


def test_options_reach_the_search(find, searched):
    code, _, err = find(
        "wall.npy", "--sigma", 0.002, "--prior-radius", 0.04, 0.001, "--min-pixels", 99,
        "--min-arc-deg", 90, "--radius-range", 0.01, 0.1, "--effort", "fast",
        "--starts", 3,
    )  # fmt: skip
    assert (code, err) == (1, "")
    (given,) = searched
    effort = given.pop("effort")
    assert (effort.starts, effort.readings) == (3, 1024)
    assert given == {
        "sigma": 0.002, "prior": {"radius": (0.04, 0.001)}, "min_pixels": 99,
        "min_arc": pytest.approx(np.pi / 2), "radius_range": (0.01, 0.1),
    }  # fmt: skip


def test_the_record_is_printed_alone(find, folder, searched):
    code, out, err = find("frames/a.npy", "--json", "-", "--sensor", "structured_light")
    assert code == 0
    record = json.loads(out)
    assert record["made_from"]["sigma"]["type"] == "structured_light"
    assert err.startswith("1 found")
    assert names(folder / "out") == FILES - {"found.json"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "a depth image must be given"),
        (("none.npy",), "does not exist"),
        (("none/*.npy",), "must match depth images, got none"),
        (("empty",), "must hold depth images, got none"),
        (("camera.json",), "must be a .png, .tiff or .npy file"),
        (("frames", "--json", "-"), "--json must not be given with several images"),
        (("frames", "frames/a.npy"), "images must be different, got 'a.npy' twice"),
        (("wall.npy", "--sigma", "1", "--sensor", "stereo"), "--sigma must not be"),
        (("small.npy",), "must have the camera's shape"),
        (("frames", "--table", "a.xls"), "table must end with .csv or .parquet"),
        (("frames", "--workers", "0"), "workers must be at least 1, got 0"),
        (("frames", "--workers", "2", "--dask", "tcp://a:1"), "--workers must not be"),
        (("wall.npy", "--samples", "2", "--outline", "hard"), "samples must be 1"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    find, folder, searched, arguments, message
):
    np.save(folder / "small.npy", np.ones((9, 9), np.float32))
    (folder / "empty").mkdir()
    code, _, err = find(*arguments)
    assert code == 2
    (line,) = err.splitlines()
    assert line.startswith("impostor-jax: error: ")
    assert message in line
    assert not searched
