"""Cameras of other programs: their objects' fields, and what they project to."""

import json
import sys
import types
from enum import Enum

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.io.camera_file import read_camera

POINT = (0.3, 0.2, 1.0)
"""Projected by the programs themselves; the images are small, which is soon read."""

FULL = [500.0, 501.0, 320.0, 240.0, 0.1, 0.02, 0.001, 0.002, 0.003, 0.04, 0.005, 0.006]


def seen(camera):
    """Where a point is seen, in double precision."""
    with jax.enable_x64(True):
        return np.asarray(camera.project(jnp.asarray(POINT)))


class Model(Enum):
    """As of pybind11: an entry has a name."""

    none = 0
    modified_brown_conrady = 1
    inverse_brown_conrady = 2
    ftheta = 3
    brown_conrady = 4
    kannala_brandt4 = 5


def intrinsics(model, coeffs):
    """The fields of `pyrealsense2.intrinsics` 2.59."""
    size, focal = {"width": 64, "height": 48}, {"fx": 600.0, "fy": 601.0}
    center = {"ppx": 320.5, "ppy": 239.0}
    return types.SimpleNamespace(**size, **focal, **center, model=model, coeffs=coeffs)


class Colmap:
    """The fields of `pycolmap.Camera` 4.2, of which `model` has a name."""

    def __init__(self, model, params):
        self.model = types.SimpleNamespace(name=model)
        self.params = np.array(params, float)
        self.width, self.height = 64, 48


def ros(**changes):
    """`sensor_msgs/CameraInfo` of ROS 2, as attributes."""
    roi = dict.fromkeys(("x_offset", "y_offset", "height", "width"), 0)
    fields = {
        "height": 48, "width": 64, "distortion_model": "plumb_bob",
        "d": np.array([0.1, 0.02, 0.01, 0.02, 0.003]),
        "k": np.array([600.0, 0, 320.5, 0, 601, 239, 0, 0, 1]),
        "binning_x": 0, "binning_y": 0,
        "roi": types.SimpleNamespace(**roi, do_rectify=False),
    }  # fmt: skip
    return types.SimpleNamespace(**(fields | changes))


# Printed by rs2_project_point_to_pixel of pyrealsense2 2.59.1.
@pytest.mark.parametrize(
    ("model", "coeffs", "pixel"),
    [
        (Model.none, [0] * 5, (500.5, 359.2)),
        (Model.brown_conrady, [0.1, 0.02, 0.01, 0.02, 0.003], (507.342, 363.509)),
        (Model.brown_conrady, [0] * 5, (500.5, 359.2)),
        (Model.inverse_brown_conrady, [0.1, 0.02, 0, 0, 0.003], (502.902, 360.804)),
        (Model.modified_brown_conrady, [0.1, 0.02, 0, 0, 0.003], (502.902, 360.804)),
        (Model.kannala_brandt4, [0.1, 0.02, 0.01, 0.02, 0], (495.379, 355.780)),
        (Model.kannala_brandt4, [0] * 5, (493.257, 354.363)),
    ],
)
def test_a_realsense_projects_as_its_program_does(model, coeffs, pixel):
    camera = ij.camera_from(intrinsics(model, coeffs))
    assert (camera.width, camera.height) == (64, 48)
    np.testing.assert_allclose(seen(camera), pixel, atol=1e-3)


# Printed by Camera.img_from_cam of pycolmap 4.2.1; half a pixel less here.
COLMAP = [
    ("SIMPLE_PINHOLE", [500, 320, 240], (470.0, 340.0)),
    ("PINHOLE", [500, 510, 320, 240], (470.0, 342.0)),
    ("SIMPLE_RADIAL", [500, 320, 240, 0.1], (471.95, 341.3)),
    ("RADIAL", [500, 320, 240, 0.1, 0.02], (472.0007, 341.3338)),
    ("OPENCV", [500, 501, 320, 240, 0.1, 0.02, 0.001, 0.002], (472.3707, 341.76192)),
    (
        "OPENCV_FISHEYE",
        [500, 501, 320, 240, 0.1, 0.02, 0.01, 0.02],
        (465.73253, 337.34933),
    ),
    ("FULL_OPENCV", FULL, (471.57067555, 341.22750127)),
]


@pytest.mark.parametrize(("model", "params", "pixel"), COLMAP)
def test_a_camera_of_colmap_projects_as_its_program_does(model, params, pixel):
    line = f"3 {model} 64 48 {' '.join(map(str, params))}"
    for camera in (ij.camera_from(Colmap(model, params)), ij.camera_from(line)):
        assert (camera.width, camera.height) == (64, 48)
        np.testing.assert_allclose(seen(camera), np.subtract(pixel, 0.5), atol=1e-5)


def test_an_intrinsic_of_open3d_has_its_clouds_of_depth_images():
    # `create_from_depth_image` of Open3D 0.20 has the first pixel of this camera at
    # (-1.5, -1.2376238) / 100 of its depth.
    matrix = np.array([[100.0, 0, 1.5], [0, 101, 1.25], [0, 0, 1]])
    given = types.SimpleNamespace(intrinsic_matrix=matrix, width=4, height=3)
    # As in the JSON that Open3D writes, by columns.
    record = {"intrinsic_matrix": matrix.T.ravel().tolist(), "width": 4, "height": 3}
    for camera in (ij.camera_from(given), ij.camera_from(record)):
        assert (camera.width, camera.height, camera.distortion) == (4, 3, None)
        pixel = camera.project(jnp.array([-1.5, -1.2376238, 100.0]))
        np.testing.assert_allclose(pixel, (0, 0), atol=1e-6)


def test_a_message_of_ros_is_read():
    first = vars(ros())
    old = {"K": first["k"], "D": first["d"]}
    old |= {name: first[name] for name in ("width", "height", "distortion_model")}
    for given in (ros(), old, types.SimpleNamespace(**old)):
        # The same lens as RealSense's, whose brown_conrady is OpenCV's.
        np.testing.assert_allclose(
            seen(ij.camera_from(given)), (507.342, 363.509), atol=1e-3
        )
    fisheye = ros(distortion_model="equidistant", d=[0.1, 0.02, 0.01, 0.02])
    np.testing.assert_allclose(
        seen(ij.camera_from(fisheye)), (495.379, 355.780), atol=1e-3
    )
    rational = ros(distortion_model="rational_polynomial", d=[*FULL[4:]])
    assert len(ij.camera_from(rational).distortion) == 8
    assert ij.camera_from(ros(distortion_model="", d=[])).distortion is None


def test_a_matrix_with_a_size_and_a_pose_are_read():
    pose = np.eye(4)
    pose[2, 3] = 2
    camera = ij.camera_from(
        [[60, 0, 31.5], [0, 61, 23.5], [0, 0, 1]], (64, 48), camera_from_world=pose
    )
    assert (camera.width, camera.height) == (64, 48)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (60, 61, 31.5, 23.5)
    assert camera.camera_from_world.translation[2] == 2


def pytorch3d(focal, point, is_ndc=True, **changes):
    """The fields and methods of PyTorch3D's cameras 0.7, of which one is in a batch."""
    fields = {
        "focal_length": np.array(focal), "principal_point": np.array([point]),
        # A turn of 90 degrees about z.
        "R": np.array([[[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]]),
        "T": np.array([[0.1, -0.2, 0.5]]),
        "in_ndc": lambda: is_ndc, "is_perspective": lambda: True,
    }  # fmt: skip
    return types.SimpleNamespace(**(fields | changes))


# Of its notes on cameras: the same camera in both ways.
NDC = pytorch3d([1.2], (0.2, 0.5), image_size=np.array([[128, 256]]))
SCREEN = pytorch3d(
    [[76.8, 76.8]], (115.2, 32.0), is_ndc=False, image_size=np.array([[128, 256]])
)


def test_cameras_of_pytorch3d_see_what_its_formulas_say():
    point = np.array([0.4, 0.3, 2.0])
    x, y, z = point @ NDC.R[0] + NDC.T[0]
    # To normalized device coordinates, left and up, and from them to the screen.
    ndc = np.array([1.2 * x / z + 0.2, 1.2 * y / z + 0.5])
    screen = np.array([256, 128]) / 2 - ndc * 128 / 2
    for given in (NDC, SCREEN):
        camera = ij.camera_from(given)
        assert (camera.width, camera.height) == (256, 128)
        with jax.enable_x64(True):
            pose = ij.RigidTransform(*jax.tree.leaves(camera.camera_from_world))
            pixel = camera.project(pose.apply(point))
        np.testing.assert_allclose(pixel, screen - 0.5, rtol=1e-6)


def test_plain_numbers_of_pytorch3d_have_no_pose_but_that_which_is_given():
    record = {"focal_length": 1.2, "principal_point": (0.2, 0.5), "in_ndc": True}
    camera = ij.camera_from(record, (256, 128))
    assert camera.camera_from_world is None
    assert (camera.fx, camera.fy) == (76.8, 76.8)
    assert (camera.cx, camera.cy) == (114.7, 31.5)
    placed = ij.camera_from(NDC, camera_from_world=np.eye(4))
    np.testing.assert_array_equal(placed.camera_from_world.rotation, np.eye(3))


CUT = types.SimpleNamespace(x_offset=8, y_offset=0, width=10, height=48)
EYE = np.eye(3)


@pytest.mark.parametrize(
    ("given", "size", "message"),
    [
        (None, None, "camera must be an intrinsic of Open3D"),
        ({"fx": 1}, None, "camera must be an intrinsic of Open3D"),
        (np.eye(4), (64, 48), "camera must be an intrinsic of Open3D"),
        (EYE, None, "size must be given with a matrix K"),
        (EYE, 64, "size must be 2 numbers"),
        (EYE, (64.5, 48), "width must be a whole number"),
        (EYE + np.eye(3, k=1), (64, 48), "without skew"),
        (-EYE + np.diag([0, 0, 2]), (64, 48), "fx must be a positive number"),
        (ros(), (64, 48), "size must be given with a matrix K alone"),
        (ros(binning_x=2), None, "binning_x must be 0 or 1"),
        (ros(roi=CUT), None, "roi must be the whole image"),
        (ros(distortion_model="fov"), None, "distortion_model must be plumb_bob"),
        (ros(d=[0.1, 0.2]), None, "plumb_bob must have 0, 4, 5 coefficients"),
        (ros(k=[1, 2]), None, "K must hold 9 numbers"),
        (intrinsics(Model.ftheta, [0] * 5), None, "model must be none"),
        (
            intrinsics(Model.inverse_brown_conrady, [0, 0, 0.01, 0, 0]),
            None,
            "coeffs of inverse_brown_conrady must have no tangential terms",
        ),
        (Colmap("FOV", [1, 2, 3, 4, 5]), None, "model must be one of SIMPLE_PINHOLE"),
        (Colmap("PINHOLE", [1, 2, 3]), None, "params of PINHOLE must be 4 numbers"),
        ("1 PINHOLE 640", None, "a line of COLMAP's cameras.txt"),
        (NDC, (256, 128), "size must not be given with a camera that has image_size"),
        (pytorch3d([1.2], (0, 0)), None, "a camera without image_size"),
        (
            pytorch3d([1.2], (0, 0), is_perspective=lambda: False),
            (64, 48),
            "which are of another projection",
        ),
        (pytorch3d([1.2], (0, 0), K=EYE), (64, 48), "must have no K"),
        (pytorch3d([1.2] * 3, (0, 0)), (64, 48), "focal_length must be that"),
    ],
)
def test_what_cannot_be_had_exactly_is_refused(given, size, message):
    with pytest.raises(ValueError, match=message):
        ij.camera_from(given, size)


# As camera_calibration_parsers writes it, and as `ros2 topic echo` prints it.
CALIBRATION = """
image_width: 64
image_height: 48
camera_name: usb_cam
camera_matrix:
  rows: 3
  cols: 3
  data: [600.0, 0.0, 320.5, 0.0, 601.0, 239.0, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, 2e-2, 0.01, 0.02, 0.003]
"""
ECHO = """
header:
  frame_id: camera
height: 48
width: 64
distortion_model: plumb_bob
d:
- 0.1
- 0.02
- 0.01
- 0.02
- 0.003
k: [600.0, 0.0, 320.5, 0.0, 601.0, 239.0, 0.0, 0.0, 1.0]
binning_x: 0
binning_y: 0
roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}
---
"""


WHOLE = "roi: {x_offset: 0, y_offset: 0, height: 48, width: 64}\n"


@pytest.mark.parametrize("text", [CALIBRATION, ECHO, CALIBRATION + WHOLE])
def test_a_camera_file_may_be_of_ros(text, tmp_path):
    pytest.importorskip("yaml")
    (tmp_path / "camera.yaml").write_text(text)
    camera, scale = read_camera(tmp_path / "camera.yaml")
    np.testing.assert_allclose(seen(camera), (507.342, 363.509), atol=1e-3)
    assert scale is None


def test_a_camera_file_may_be_of_colmap(tmp_path):
    head = "# Camera list with one line of data per camera:\n"
    (tmp_path / "cameras.txt").write_text(f"{head}3 PINHOLE 64 48 500 510 320 240\n")
    camera, _ = read_camera(tmp_path / "cameras.txt")
    assert (camera.cx, camera.cy) == (319.5, 239.5)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("c.txt", "# none\n", "must hold one camera, got 0"),
        ("c.txt", "1 PINHOLE 1 1 1 1 1 1\n" * 2, "must hold one camera, got 2"),
        ("c.txt", "a b c", "a line of COLMAP's cameras.txt"),
        ("c.txt", "1 PINHOLE 64 48 nan 510 320 240", "fx must be"),
        ("c.txt", b"\xff\xfe", "is not readable text"),
        ("c.yaml", "a: [", "is not readable YAML"),
        ("c.yaml", "3", "must hold ROS's CameraInfo"),
        ("c.yml", "image_width: 640", "camera must be an intrinsic of Open3D"),
        pytest.param("c.yml", "[" * 3000, "must hold ROS's CameraInfo", id="deep"),
        pytest.param("c.yml", "a: &a [1]\nb: [*a]", "CameraInfo", id="names"),
        pytest.param("c.yml", "x" * 2**19, "at most 262144 bytes", id="long"),
        ("c.json", json.dumps({"k": 1}), "lacks fx"),
    ],
)
def test_a_bad_camera_file_is_named(name, text, message, tmp_path):
    pytest.importorskip("yaml")
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ValueError, match=f"camera file '.*{name}'.*{message}"):
        read_camera(path)


def test_yaml_without_pyyaml_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "yaml", None)
    (tmp_path / "camera.yaml").write_text(ECHO)
    with pytest.raises(ValueError, match=r"pip install 'impostor-jax\[yaml\]'"):
        read_camera(tmp_path / "camera.yaml")
