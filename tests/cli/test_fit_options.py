"""What the command `fit` takes beside one image and its mask."""

import json
import sys

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import impostor_jax as ij
from impostor_jax.__main__ import main
from impostor_jax.io.scene_file import write_scene
from tests.fit.scenes import CAMERA as SEEN_BY
from tests.fit.scenes import can, image, image_of
from tests.fit.test_labels import RADII, two_cans
from tests.groups import FULL, RELEASE, SMALL_IMAGES
from tests.page.scenes import scene_of

pytestmark = SMALL_IMAGES

CAMERA = {"fx": 150.0, "fy": 150.0, "cx": 79.5, "cy": 59.5, "width": 160, "height": 120}
BALL = ij.Sphere((0.02, 0.01, 0.35), 0.05)


@pytest.fixture
def folder(tmp_path):
    """A can, a ball and two cans, with their masks and labels."""
    (tmp_path / "camera.json").write_text(json.dumps(CAMERA))
    views = {"can": image(), "ball": image_of(BALL), "two": two_cans()}
    for name, (depth, seen) in views.items():
        np.save(tmp_path / f"{name}.npy", depth)
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.asarray(seen, np.uint8))
    return tmp_path


@pytest.fixture
def fit(folder, monkeypatch, capfd):
    """Run the command on images of the folder; its exit code, output and errors."""

    def run(*arguments, camera=("--camera", "camera.json")):
        given = "fit", *arguments, *camera, "--output", "out"
        monkeypatch.chdir(folder)
        monkeypatch.setattr(sys, "argv", ["impostor-jax", *map(str, given)])
        try:
            code = main()
        except SystemExit as stop:
            code = stop.code
        return code, *capfd.readouterr()

    return run


def names_in(folder):
    return {path.name for path in folder.iterdir()}


def record_of(folder, *place):
    return json.loads(folder.joinpath("out", *place, "fit.json").read_text())


def test_labels_are_fitted_each(fit, folder):
    code, out, err = fit("two.npy", "--labels", "two.png")
    assert (code, err) == (0, "")
    assert "label 2:\nconverged" in out
    for label, radius in zip((2, 5), RADII, strict=True):
        record = record_of(folder, f"label_{label}")
        assert record["radius_m"] == pytest.approx(radius, abs=3e-4)
        assert (folder / "out" / f"label_{label}" / "overlay.png").is_file()


def test_a_page_shows_all_fits_of_an_image(fit, folder):
    page = folder / "out" / "fits.html"
    code, _, err = fit("two.npy", "--labels", "two.png", "--page", page)
    assert (code, err) == (0, "")
    shapes = scene_of(page.read_text())["shapes"]
    assert [shape["name"] for shape in shapes] == ["label 2", "label 5"]
    assert all(shape["drawn"] for shape in shapes)


@FULL
def test_a_page_of_a_fit_that_fails_says_so(fit, folder):
    np.save(folder / "wall.npy", np.full((120, 160), 0.5, np.float32))
    code, out, err = fit("wall.npy", "--mask", "can.png", "--page", "-")
    assert code == 1
    assert "wall" not in err
    (shape,) = scene_of(out)["shapes"]
    assert (shape["name"], shape["drawn"]) == ("cylinder", None)


def test_a_label_image_is_refused_as_a_mask(fit):
    code, _, err = fit("two.npy", "--mask", "two.png")
    assert code == 2
    assert len(err.splitlines()) == 1
    assert "mask 'two.png' must be of one object" in err
    assert "--labels fits each" in err


@FULL
def test_several_images_have_a_folder_each(fit, folder):
    np.save(folder / "wall.npy", np.full((120, 160), 0.5, np.float32))
    files = "can.npy", "wall.npy"
    # A flag takes one file at a time, so that it may stand before the images.
    code, out, err = fit("--mask", "can.png", "--mask", "can.png", *files)
    assert (code, err) == (1, "")
    assert "2 images in " in out
    assert record_of(folder, "can")["success"] is True
    assert record_of(folder, "wall")["success"] is False


@RELEASE
def test_masks_of_several_images_may_be_a_folder_of_their_names(fit, folder):
    code, _, err = fit("can.npy", "ball.npy", "--mask", ".")
    assert err == ""
    for name in ("can", "ball"):
        mask = cv2.imread(str(folder / f"{name}.png"), cv2.IMREAD_UNCHANGED)
        assert record_of(folder, name)["num_pixels"] == np.count_nonzero(mask)
    assert code in (0, 1)


@FULL
def test_a_sphere_is_fitted_with_a_prior(fit, folder):
    code, _, err = fit(
        "ball.npy", "--mask", "ball.png", "--shape", "sphere",
        "--prior-radius", 0.05, 1e-6,
    )  # fmt: skip
    assert (code, err) == (0, "")
    record = record_of(folder)
    assert record["shape"] == "sphere"
    assert record["radius_m"] == pytest.approx(0.05, abs=2e-6)
    assert record["std"]["radius_m"] == pytest.approx(1e-6, rel=0.1)
    assert len(record["covariance"]["values"]) == 4
    assert record["ends_seen"] == []
    assert (folder / "out" / "overlay.png").is_file()


@RELEASE
def test_a_tube_is_fitted_and_a_can_tested_for_a_bore(fit, folder):
    can_ = can(40.0)
    pipe = ij.tube(can_.center, can_.axis, 0.04, 0.034, 0.12)
    depth, mask = image_of(pipe)
    np.save(folder / "pipe.npy", depth)
    cv2.imwrite(str(folder / "pipe.png"), np.asarray(mask, np.uint8))
    code, out, err = fit("pipe.npy", "--mask", "pipe.png", "--shape", "tube")
    assert (code, err) == (0, "")
    assert "inner_radius 3" in out
    record = record_of(folder)
    assert record["shape"] == "tube"
    assert record["inner_radius_m"] == pytest.approx(0.034, abs=2e-4)
    assert (folder / "out" / "overlay.png").is_file()
    _, out, err = fit("pipe.npy", "--mask", "pipe.png", "--test-bore")
    assert err == ""
    assert "bore    needed" in out
    assert record_of(folder)["bore"]["needed"] is True


@FULL
def test_a_box_is_fitted(fit, folder):
    turned = Rotation.from_rotvec([0.4, 0.7, 0.2]).as_matrix()
    depth, mask = image_of(ij.Box((0.01, -0.01, 0.4), turned, (0.06, 0.04, 0.1)))
    np.save(folder / "carton.npy", depth)
    cv2.imwrite(str(folder / "carton.png"), np.asarray(mask, np.uint8))
    code, out, err = fit("carton.npy", "--mask", "carton.png", "--shape", "box")
    assert (code, err) == (0, "")
    assert "  size    " in out
    record = record_of(folder)
    assert record["shape"] == "box"
    assert sorted(record["size_m"]) == pytest.approx([0.04, 0.06, 0.1], abs=1e-3)
    assert len(record["ends_seen"]) == 6
    assert (folder / "out" / "overlay.png").is_file()


@RELEASE
def test_a_frustum_is_fitted_from_a_start(fit, folder):
    truth, half = can(), 0.06
    ends = (np.asarray(truth.center + sign * half * truth.axis) for sign in (-1, 1))
    write_scene(folder / "start.json", [ij.Frustum(*ends, 0.041, 0.039)])
    code, out, err = fit(
        "can.npy", "--mask", "can.png", "--shape", "frustum", "--initial", "start.json"
    )
    assert (code, err) == (0, "")
    assert "  radius1 " in out
    record = record_of(folder)
    assert record["radius1_m"] == pytest.approx(0.04, abs=1e-3)
    assert record["ends_seen"] == [True, True]
    assert record["covariance"]["coordinates"][-3:] == ["radius1", "radius2", "height"]
    assert (folder / "out" / "overlay.png").is_file()


def test_what_is_fixed_keeps_its_value_in_the_start(fit, folder):
    truth = can()
    start = ij.Cylinder(truth.center, truth.axis, 0.04001, 0.12)
    write_scene(folder / "start.json", [start])
    _, _, err = fit(
        "can.npy", "--mask", "can.png", "--initial", "start.json",
        "--fixed", "radius", "height",
    )  # fmt: skip
    assert err == ""
    record = record_of(folder)
    assert record["radius_m"] == pytest.approx(0.04001, rel=1e-6)
    assert record["std"]["height_m"] == 0


@FULL
@pytest.mark.parametrize(
    "sensor",
    [
        "structured_light",
        pytest.param("stereo_camera", marks=RELEASE),
        "sensor.json",
    ],
)
def test_a_sensor_is_a_name_or_a_file(fit, folder, sensor):
    record = {"type": "constant", "deviation": 0.001}
    (folder / "sensor.json").write_text(json.dumps(record))
    _, _, err = fit("can.npy", "--mask", "can.png", "--sensor", sensor)
    assert err == ""
    record = record_of(folder)
    assert record["radius_m"] == pytest.approx(0.04, abs=2e-3)
    assert ("scale" in record["std_budget"]) == (sensor == "stereo_camera")


def test_depth_in_millimeters_gets_a_hint_on_one_line(fit, folder):
    np.save(folder / "far.npy", 1000 * image()[0])
    # The noise, measured in the image, is a thousand times as large, too.
    _, _, err = fit("far.npy", "--mask", "can.png")
    assert len(err.splitlines()) == 1
    assert err.startswith("impostor-jax: warning: depth must be in meters")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "a depth image must be given"),
        (("can.npy", "can.npy"), "images must be different, got 'can.npy' twice"),
        (("can.npy", "ball.npy", "--mask", "can.png"), "one file a depth image"),
        (("can.npy", "--mask", "can.png", "--labels", "can.png"), "not be given toget"),
        (("can.npy", "--labels", "can.png", "--json", "a.json"), "--json must not be"),
        (("can.npy", "--sensor", "sonar"), "must be one of constant, structured_light"),
        (("can.npy", "--sensor", "none.json"), "none.json"),
        (("can.npy", "ball.npy", "--page", "a.html"), "--page must not be given with"),
        (("can.npy", "--page", "."), "page must be a file, got the folder"),
        (("can.npy", "--sensor", "stereo", "--sigma", "1"), "--sigma must not be"),
        (("can.npy", "--initial", "start.json"), "must hold one cylinder to begin wit"),
        (("can.npy", "--fixed", "radius"), "initial must be given with fixed"),
        (("can.npy", "--prior-radius", "0.04", "0"), "deviation of prior['radius']"),
        (("ball.npy", "--shape", "sphere", "--test-taper"), "--test-taper must not be"),
        (("ball.npy", "--shape", "sphere", "--test-bore"), "--test-bore must not be"),
        (("can.npy", "--shape", "tube", "--initial", "start.json"), "hold one tube"),
        (("ball.npy", "--shape", "sphere", "--prior-height", "1", "1"),
         "prior must be one of center, radius"),
        (("can.npy", "--shape", "cube"), "--shape"),
        (("can.png", "--silhouette", "--mask", "can.png"), "--silhouette must not be"),
        (("can.npy", "--views", "a.json", "--labels", "a.png"), "not --labels"),
        (("can.npy", "--pose-sigma", "0.001", "0.001"), "must be given with --views"),
    ],
)  # fmt: skip
def test_bad_option_gives_one_line_and_exit_code_2(arguments, message, fit, folder):
    write_scene(folder / "start.json", [BALL])
    code, _, err = fit(*arguments)
    assert code == 2
    assert len(err.splitlines()) == 1
    assert message in err


@pytest.mark.parametrize("program", ["impostor-jax", "impostor-synth"])
def test_version_is_printed(program, capfd):
    from data_synth.cli import parse as parse_synth
    from impostor_jax.cli.parse import parse

    with pytest.raises(SystemExit) as stop:
        (parse if program == "impostor-jax" else parse_synth)(["--version"])
    assert not stop.value.code
    name, version = capfd.readouterr().out.split()
    assert name == program
    assert version[0].isdigit()


@FULL
def test_an_outline_alone_is_fitted_with_a_known_radius(fit, folder):
    mask = 255 * np.asarray(ij.render(can(), SEEN_BY, outputs=("mask",)).mask)
    cv2.imwrite(str(folder / "glass.png"), mask.astype(np.uint8))
    code, out, err = fit("glass.png", "--silhouette", "--prior-radius", 0.04, 0.0001)
    assert (code, err) == (0, "")
    assert "converged" in out
    record = record_of(folder)
    assert record["source"] == "outline"
    assert record["radius_m"] == pytest.approx(0.04, abs=3e-4)
    assert not (folder / "out" / "overlay.png").exists()


@FULL
def test_views_of_one_object_have_one_fit(fit, folder):
    poses = [np.eye(4).tolist(), np.eye(4).tolist()]
    (folder / "poses.json").write_text(json.dumps(poses))
    np.save(folder / "again.npy", image(seed=1)[0])
    files = "can.npy", "again.npy", "--mask", "can.png", "--mask", "can.png"
    posed = "--views", "poses.json", "--pose-sigma", 0.0005, 0.001
    code, _, err = fit(*files, *posed, "--page", "out/page.html")
    assert (code, err) == (0, "")
    assert names_in(folder / "out") == {"fit.json", "page.html"}
    record = record_of(folder)
    assert record["radius_m"] == pytest.approx(0.04, abs=1e-3)
    assert record["num_pixels"] > 1.8 * np.count_nonzero(image()[1])
    assert record["std_budget"]["poses"]["center_m"][0] > 0.0002
    assert np.shape(record["pose_errors"]["value"]) == (2, 6)
    (folder / "poses.json").write_text(json.dumps(poses[:1]))
    code, _, err = fit(*files, "--views", "poses.json")
    assert code == 2
    assert "must hold a list of 2 matrices" in err


@FULL
def test_a_cloud_is_fitted(fit, folder):
    depth, mask = image()
    rows, cols = np.nonzero(mask)
    ray = np.stack([(cols - 79.5) / 150, (rows - 59.5) / 150, np.ones(len(rows))], -1)
    np.save(folder / "cloud.npy", ray * depth[mask][:, None])
    code, _, err = fit("cloud.npy", "--origin", 0, 0, 0, camera=())
    assert (code, err) == (0, "")
    assert record_of(folder)["radius_m"] == pytest.approx(0.04, abs=1e-3)
    assert names_in(folder / "out") == {"fit.json"}
    code, _, err = fit("cloud.npy", "--mask", "can.png", camera=())
    assert code == 2
    assert "--mask must be given with depth images alone" in err
