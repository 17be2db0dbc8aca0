"""The command `calibrate`."""

import json
import sys

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.__main__ import main
from impostor_jax.cli.given import chosen_noise
from impostor_jax.io.camera_file import camera_record
from impostor_jax.io.depth_image import write_mask
from impostor_jax.io.sensor_record import sensor_record
from tests.calibrate.scenes import CAMERA, images_of
from tests.groups import FULL, RELEASE, SMALL_IMAGES

pytestmark = SMALL_IMAGES


@pytest.fixture
def calibrate(tmp_path, monkeypatch, capfd):
    """Run the command on three images; its exit code, output and errors."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "camera.json").write_text(json.dumps(camera_record(CAMERA, 0.0001)))
    (tmp_path / "frames").mkdir()
    (tmp_path / "masks").mkdir()
    for number, image in enumerate(images_of(ij.ConstantNoise(0.003), 3)):
        np.save(tmp_path / "frames" / f"{number}.npy", image)
        mask = np.zeros(image.shape, bool)
        mask[:90] = True
        write_mask(tmp_path / "masks" / f"{number}.png", mask)

    np.save(tmp_path / "empty.npy", np.zeros((120, 160), np.float32))

    def run(*arguments):
        given = "calibrate", *arguments, "--camera", "camera.json"
        monkeypatch.setattr(sys, "argv", ["impostor-jax", *map(str, given)])
        try:
            code = main()
        except SystemExit as stop:
            code = stop.code
        return code, *capfd.readouterr()

    return run


@FULL
def test_what_is_written_is_a_sensor_of_fit_and_find(calibrate, tmp_path):
    code, out, err = calibrate("frames", "--kind", "constant")
    assert (code, err) == (0, "")
    assert "planes in 3 images, " in out.splitlines()[0]
    assert {path.name for path in tmp_path.iterdir()} == {
        "camera.json", "empty.npy", "frames", "masks", "sensor.json",
    }  # fmt: skip
    record = json.loads((tmp_path / "sensor.json").read_text())
    assert record["type"] == "constant"
    assert record["deviation"] == pytest.approx(0.003, rel=0.05)
    assert sensor_record(chosen_noise(None, "sensor.json", lambda: None)) == record


@RELEASE
def test_masks_tell_which_pixels_are_used(calibrate):
    options = ("frames", "--kind", "constant")
    whole, part = (
        int(calibrate(*options, *more)[1].split()[5])
        for more in ((), ("--masks", "masks"))
    )
    assert 0.5 * whole < part < 0.9 * whole


@FULL
def test_the_record_is_printed_alone(calibrate, tmp_path):
    code, out, err = calibrate("frames", "--kind", "constant", "--output", "-")
    assert code == 0
    assert json.loads(out)["type"] == "constant"
    assert "planes" in err
    assert not (tmp_path / "sensor.json").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("frames", "--radius", 0.04), "--objects and --radius must be given together"),
        (("frames", "--objects", "masks"), "--objects and --radius must be given"),
        (
            ("frames", "--masks", "masks/0.png"),
            "--masks must be one file a depth image",
        ),
        (("none.npy",), "none.npy"),
        (("empty.npy",), "planes on at least 3000 pixels"),
        (("frames", "--kind", "sonar"), "sonar"),
        (("frames", "--output", "none/sensor.json"), "output must be a file in"),
        (("frames", "--native-scale", 0), "native_scale must be a positive number"),
    ],
)
def test_bad_input_is_one_line_and_exits_with_2(
    calibrate, tmp_path, arguments, message
):
    code, out, err = calibrate(*arguments)
    assert (code, out) == (2, "")
    (line,) = err.splitlines()
    assert line.startswith("impostor-jax: error: ")
    assert message in line
    assert not (tmp_path / "sensor.json").exists()
