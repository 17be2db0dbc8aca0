import json

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.camera.spherical import SphericalCamera
from impostor_jax.io.atomic import write_atomically, write_json
from impostor_jax.io.camera_file import pinhole_of, read_camera, write_camera
from impostor_jax.io.depth_image import (
    fitting_scale,
    read_depth,
    read_mask,
    write_depth_png,
    write_depth_tiff,
    write_mask,
    write_normals,
)

DEPTH = np.array([[0.5, np.inf, 0.0], [1.2345, 2.0, np.nan]], np.float32)
SETTINGS = {"fx": 60.0, "fy": 62.0, "cx": 31.5, "cy": 23.0, "width": 64, "height": 48}


def test_png_depth_comes_back_to_half_a_unit_with_0_for_no_reading(tmp_path):
    write_depth_png(tmp_path / "depth.png", DEPTH, 1e-4)
    found = read_depth(tmp_path / "depth.png", 1e-4)
    expected = np.where(np.isfinite(DEPTH), DEPTH, 0)
    np.testing.assert_allclose(found, expected, atol=0.5e-4)
    assert found[0, 1] == found[1, 2] == 0


def test_the_largest_number_of_16_bits_is_no_reading(tmp_path):
    np.save(tmp_path / "depth.npy", np.array([[65535, 65534, 0, 1]], np.uint16))
    found = read_depth(tmp_path / "depth.npy", 1e-3)
    np.testing.assert_allclose(found, [[0, 65.534, 0, 0.001]])
    # As far as other programs' readings go, ours do.
    assert fitting_scale(np.array([[6.5535]]), None) == 1e-3
    write_depth_png(tmp_path / "depth.png", np.array([[6.5534, 6.5535]]), 1e-4)
    found = read_depth(tmp_path / "depth.png", 1e-4)
    np.testing.assert_allclose(found, [[6.5534, 0]])


def test_tiff_and_npy_depth_come_back_exactly(tmp_path):
    write_depth_tiff(tmp_path / "depth.tiff", DEPTH)
    np.save(tmp_path / "depth.npy", DEPTH)
    expected = np.where(np.isfinite(DEPTH), DEPTH, 0)
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.tiff", None), expected)
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.npy", None), DEPTH)


def test_scale_is_chosen_to_hold_the_largest_depth():
    assert fitting_scale(DEPTH, None) == 1e-4
    assert fitting_scale(DEPTH * 10, None) == 1e-3
    assert fitting_scale(DEPTH, 1e-3) == 1e-3
    with pytest.raises(ValueError, match=r"depth_scale_m must be at least 3\.05e-05"):
        fitting_scale(DEPTH, 1e-5)


def test_mask_comes_back(tmp_path):
    mask = np.array([[True, False], [False, True]])
    write_mask(tmp_path / "mask.png", mask)
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png"), mask)


def test_normals_become_colors(tmp_path):
    normal = np.array([[[0, 0, -1.0], [0, 0, 0]]])
    write_normals(tmp_path / "normal.png", normal)
    blue_green_red = cv2.imread(str(tmp_path / "normal.png"))
    np.testing.assert_array_equal(blue_green_red, [[[0, 128, 128], [0, 0, 0]]])


@pytest.mark.parametrize(
    ("extra", "make"),
    [
        ({"depth_scale_m": 0.001}, {}),
        ({"distortion": [0.1, 0, 0, 0, 0]}, {}),
        ({"distortion": [0.1, 0.01, 0, 0], "fisheye": True}, {}),
    ],
)
def test_camera_comes_back(tmp_path, extra, make):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({**SETTINGS, **extra}))
    camera, scale = read_camera(path)
    assert scale == extra.get("depth_scale_m")
    write_camera(path, camera, scale)
    again, scale_again = read_camera(path)
    assert scale_again == scale
    np.testing.assert_allclose(again.matrix(), camera.matrix())
    assert again.fisheye == camera.fisheye
    if "distortion" in extra:
        np.testing.assert_array_equal(again.distortion, camera.distortion)


@pytest.mark.parametrize("is_even", [True, False])
def test_spherical_camera_comes_back(tmp_path, is_even):
    path = tmp_path / "scanner.json"
    beams = np.array([15.0, 13.0, 11.0] if is_even else [15.0, 13.1, 2.0])
    camera = SphericalCamera.of_beams(beams, 1000)
    write_camera(path, camera, 0.002)
    record = json.loads(path.read_text())
    assert record["model"] == "spherical"
    assert isinstance(record["elevation_deg"], dict if is_even else list)
    assert record["azimuth_deg"] == {"first": -179.82, "last": 179.82, "count": 1000}
    again, scale = read_camera(path)
    assert scale == 0.002
    np.testing.assert_allclose(again.elevation, camera.elevation, atol=1e-12)
    np.testing.assert_allclose(again.azimuth, camera.azimuth, atol=1e-12)
    with pytest.raises(ValueError, match="must have a pinhole camera, got a spherical"):
        pinhole_of(again, "scanner.json")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": "fisheye"}, "model must be 'spherical'"),
        ({"elevation_deg": []}, "elevation_deg must be a list of degrees, or a range"),
        ({"elevation_deg": [1, True]}, "elevation_deg must be a list of degrees, or a"),
        ({"elevation_deg": [1, 1]}, "elevation must rise strictly or fall strictly"),
        ({"elevation_deg": [95, 1]}, "elevation must be from -pi/2 to pi/2 radians"),
        ({"azimuth_deg": {"first": 0, "last": 90}}, "azimuth_deg lacks count"),
        (
            {"azimuth_deg": {"first": 0, "last": 1, "count": 1.5}},
            "count of azimuth",
        ),
        (
            {"azimuth_deg": {"first": "a", "last": 1, "count": 2}},
            "azimuth_deg must be",
        ),
        ({"azimuth_deg": {"first": 0, "last": 1, "count": 2**28}}, "pixels together"),
        ({"fx": 60.0}, "holds unknown keys: fx"),
        ({"depth_scale_m": -1}, "depth_scale_m must be a positive number"),
    ],
)
def test_bad_spherical_camera_file_is_refused(tmp_path, changes, message):
    good = {"model": "spherical", "elevation_deg": [1, 0], "azimuth_deg": [-1, 0, 1]}
    path = tmp_path / "scanner.json"
    path.write_text(json.dumps({**good, **changes}))
    with pytest.raises(ValueError, match=message):
        read_camera(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not readable JSON"),
        ("[1, 2]", "must hold one JSON object"),
        (json.dumps({"fx": 1}), "lacks fy, cx, cy, width, height"),
        (json.dumps({**SETTINGS, "skew": 0}), "holds unknown keys: skew"),
        (json.dumps({**SETTINGS, "fx": 0}), "fx must be a positive number"),
        (json.dumps({**SETTINGS, "depth_scale_m": 0}), "depth_scale_m must be a pos"),
        (json.dumps({**SETTINGS, "depth_scale_m": "mm"}), "depth_scale_m must be a"),
        (json.dumps({**SETTINGS, "fisheye": 1}), "fisheye must be true or false"),
    ],
)
def test_bad_camera_file_is_refused(tmp_path, text, message):
    path = tmp_path / "camera.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_camera(path)


def write_sample(path, kind):
    if kind == "text":
        path.write_text("not an image")
    elif kind == "color":
        cv2.imwrite(str(path), np.zeros((4, 4, 3), np.uint16))
    elif kind == "8 bits":
        cv2.imwrite(str(path), np.zeros((4, 4), np.uint8))
    elif kind == "16 bits":
        cv2.imwrite(str(path), np.zeros((4, 4), np.uint16))
    elif kind == "objects":
        np.save(path, np.array([{}], dtype=object), allow_pickle=True)
    elif kind == "complex":
        np.save(path, np.zeros((4, 4), complex))


@pytest.mark.parametrize(
    ("name", "kind", "message"),
    [
        ("depth.png", None, "does not exist"),
        ("depth.exr", "text", "must be a .png, .tiff or .npy file"),
        ("depth.png", "text", "is not a readable image"),
        ("depth.npy", "text", "is not a readable NPY file"),
        ("depth.npy", "objects", "is not a readable NPY file"),
        ("depth.npy", "complex", "must hold integers or floats, got complex128"),
        ("depth.png", "color", "must have one channel"),
        ("depth.png", "8 bits", "must have 16 bits a pixel, got 8"),
        ("depth.png", "16 bits", "depth_scale_m must be given in the camera file"),
    ],
)
def test_bad_depth_file_is_refused(tmp_path, name, kind, message, capfd):
    write_sample(tmp_path / name, kind)
    with pytest.raises(ValueError, match=message):
        read_depth(tmp_path / name, None)
    # OpenCV's own warnings would follow the one line of the command line.
    assert capfd.readouterr().err == ""


def test_a_write_that_fails_leaves_the_old_file_and_no_other(tmp_path):
    path = tmp_path / "record.json"
    write_json(path, {"a": 1})

    def fail(partial):
        partial.write_text("half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_atomically(path, fail)
    with pytest.raises(ValueError, match="Out of range"):
        write_json(path, {"a": float("nan")})
    assert json.loads(path.read_text()) == {"a": 1}
    assert [entry.name for entry in tmp_path.iterdir()] == ["record.json"]


def test_public_camera_has_the_fields_that_files_hold():
    assert ij.PinholeCamera(**SETTINGS).matrix()[0, 2] == 31.5
