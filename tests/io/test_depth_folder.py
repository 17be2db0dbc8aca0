"""Folders of RGB-D datasets, in the layouts that their pages document."""

import json
import shutil

import cv2
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij

UNITS = np.array([[0, 500, 1000], [2000, 4000, 60000]], np.uint16)
SMALL = ij.PinholeCamera(3.0, 3.0, 1.0, 0.5, 3, 2)
# A quarter turn about z: of the camera's x, the world's y.
TURN = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
POSE = np.array([[0, -1, 0, 1.5], [1, 0, 0, 2.0], [0, 0, 1, 3.0], [0, 0, 0, 1]])
"""World from camera."""


def image(path, values=UNITS):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), values)


def text(path, *lines):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*lines, ""]))


def matrix_lines(matrix):
    return [" ".join(f"{x:.6f}" for x in row) for row in matrix]


def tum(folder):
    quarter = "1.5 2 3 0 0 0.70710678 0.70710678"
    text(
        folder / "depth.txt", "# depth maps", "# timestamp filename",
        "10.000 depth/10.000.png", "10.033 depth/10.033.png",
        "10.500 depth/10.500.png",
    )  # fmt: skip
    text(
        folder / "groundtruth.txt", "# timestamp tx ty tz qx qy qz qw",
        "9.99 0 0 0 0 0 0 1", f"10.001 {quarter}", f"10.041 {quarter}",
    )  # fmt: skip
    for name in ("10.000", "10.033", "10.500"):
        image(folder / "depth" / f"{name}.png")
    return folder


def bop(folder):
    # From the world to the camera, in millimeters.
    camera = {"cam_K": [3, 0, 1, 0, 4, 0.5, 0, 0, 1], "depth_scale": 0.1}
    turn = np.transpose(TURN)
    camera["cam_R_w2c"] = turn.ravel().tolist()
    camera["cam_t_w2c"] = (-1000 * turn @ [1.5, 2, 3]).tolist()
    folder.mkdir(parents=True, exist_ok=True)
    plain = {"cam_K": camera["cam_K"], "depth_scale": 0.1}
    cameras = {"12": plain, "3": camera}
    (folder / "scene_camera.json").write_text(json.dumps(cameras))
    truth = {"3": [{"obj_id": 7}, {"obj_id": 5}], "12": []}
    (folder / "scene_gt.json").write_text(json.dumps(truth))
    image(folder / "depth" / "000003.png")
    image(folder / "depth" / "000012.png")
    for k in range(2):
        image(
            folder / "mask_visib" / f"000003_{k:06d}.png",
            np.where(UNITS == 500 * (k + 1), 255, 0).astype(np.uint8),
        )
    return folder


def scannet(folder):
    k = np.eye(4)
    k[0, 0], k[1, 1], k[0, 2], k[1, 2] = 3, 4, 1, 0.5
    text(folder / "intrinsic" / "intrinsic_depth.txt", *matrix_lines(k))
    for name, pose in (("9", POSE), ("10", POSE), ("11", np.full((4, 4), -np.inf))):
        text(folder / "pose" / f"{name}.txt", *matrix_lines(pose))
        image(folder / "depth" / f"{name}.png")
    return folder


def redwood(folder):
    lines = [["0 0 1", *matrix_lines(POSE)], ["1 1 2", *matrix_lines(POSE)]]
    text(folder / "trajectory.log", *lines[0], *lines[1])
    for k in range(3):
        image(folder / "depth" / f"{k:05d}.png")
    return folder


MAKERS = {"tum": tum, "bop": bop, "scannet": scannet, "redwood": redwood}
NAMES = {
    "tum": ["10.000", "10.033"],
    "bop": ["000003", "000012"],
    "scannet": ["9", "10"],
    "redwood": ["00000", "00001"],
}
UNIT_M = {"tum": 1 / 5000, "bop": 1e-4, "scannet": 1e-3, "redwood": 1e-3}


def opened(kind, folder):
    """Frames of a folder of small images, whose camera a kind may not know."""
    camera = SMALL if kind in ("tum", "redwood") else None
    return ij.io.read_depth_folder(folder, camera=camera)


@pytest.mark.parametrize("kind", MAKERS)
def test_depth_comes_in_meters_with_the_frames_in_order(kind, tmp_path):
    frames = opened(kind, MAKERS[kind](tmp_path / "given"))
    assert [frame.name for frame in frames] == NAMES[kind]
    for frame in frames:
        assert frame.depth.dtype == np.float32
        np.testing.assert_allclose(frame.depth, UNIT_M[kind] * UNITS, rtol=1e-6)
        assert (frame.camera.width, frame.camera.height) == (3, 2)
    assert frames[-1].name == frames[1].name == frames[1:][0].name
    with pytest.raises(IndexError):
        frames[2]


@pytest.mark.parametrize("kind", MAKERS)
def test_pose_is_that_of_the_world(kind, tmp_path):
    pose = opened(kind, MAKERS[kind](tmp_path / "given"))[0].camera.camera_from_world
    assert pose is not None
    # The camera is there, and looks along the world's z.
    np.testing.assert_allclose(
        pose.apply(jnp.asarray(POSE[:3, 3], float)), 0, atol=1e-6
    )
    ahead = jnp.asarray((POSE @ [1, 0, 2, 1])[:3], float)
    np.testing.assert_allclose(pose.apply(ahead), [1, 0, 2], atol=1e-6)


def test_camera_of_bop_and_scannet_is_that_of_the_files(tmp_path):
    for kind in ("bop", "scannet"):
        camera = opened(kind, MAKERS[kind](tmp_path / kind))[0].camera
        np.testing.assert_allclose(
            camera.matrix(), [[3, 0, 1], [0, 4, 0.5], [0, 0, 1]], atol=1e-6
        )


@pytest.mark.parametrize(
    ("maker", "name", "focal"),
    [
        (tum, "rgbd_dataset_freiburg1_desk", 517.3),
        (tum, "rgbd_dataset_freiburg2_xyz", 520.9),
        (tum, "freiburg3", 535.4),
        (redwood, "livingroom", 525.0),
    ],
)
def test_camera_of_a_folder_is_known_by_its_kind_or_name(maker, name, focal, tmp_path):
    frame = ij.io.read_depth_folder(str(maker(tmp_path / name)))[0]
    assert frame.camera.fx == focal
    given = ij.io.read_depth_folder(tmp_path / name, camera=SMALL)[0]
    assert given.camera.fx == 3.0
    assert given.camera.camera_from_world is not None


def test_masks_of_bop_are_of_visible_pixels(tmp_path):
    first, last = opened("bop", bop(tmp_path / "given"))
    assert first.objects == (7, 5)
    np.testing.assert_array_equal(first.masks, [UNITS == 500, UNITS == 1000])
    assert last.objects == ()
    assert last.masks.shape == (0, 2, 3)
    shutil.rmtree(tmp_path / "given" / "mask_visib")
    assert opened("bop", tmp_path / "given")[0].objects == ()


def test_without_poses_the_camera_is_the_world(tmp_path):
    (tum(tmp_path / "tum") / "groundtruth.txt").unlink()
    frames = opened("tum", tmp_path / "tum")
    assert len(frames) == 3
    assert frames[0].camera.camera_from_world is None
    (redwood(tmp_path / "redwood") / "trajectory.log").unlink()
    frames = ij.io.read_depth_folder(tmp_path / "redwood", "redwood", camera=SMALL)
    assert len(frames) == 3
    assert frames[0].camera.camera_from_world is None
    assert opened("bop", bop(tmp_path / "b"))[1].camera.camera_from_world is None


def test_trajectory_of_another_name_is_found(tmp_path):
    folder = redwood(tmp_path / "given")
    (folder / "trajectory.log").rename(folder / "livingroom1-traj.txt")
    assert len(opened("redwood", folder)) == 2
    text(folder / "odometry.log")
    with pytest.raises(ValueError, match=r"one trajectory, got .*traj\.txt, odometry"):
        opened("redwood", folder)


def cameras(folder, **change):
    path = folder / "scene_camera.json"
    record = json.loads(path.read_text())
    record["3"] |= change
    path.write_text(json.dumps(record))


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        ("tum", lambda f: text(f / "depth.txt", "1 a b"), "must hold seconds and a"),
        ("tum", lambda f: text(f / "depth.txt", "x a"), "must hold seconds and a file"),
        ("tum", lambda f: text(f / "depth.txt"), "must hold depth images, got none"),
        ("tum", lambda f: text(f / "groundtruth.txt"), "rows of 8 numbers, got none"),
        ("tum", lambda f: text(f / "groundtruth.txt", "1 2 3"), "invalid column index"),
        (
            "tum",
            lambda f: text(f / "groundtruth.txt", "10 0 0 0 0 0 0 0"),
            "must hold finite poses",
        ),
        ("bop", lambda f: cameras(f, cam_K=[1]), "is broken at '3': cam_K must be"),
        ("bop", lambda f: cameras(f, depth_scale=0), "'3': depth_scale must be a pos"),
        ("bop", lambda f: cameras(f, cam_t_w2c="a"), "at '3': cam_t_w2c must be"),
        ("bop", lambda f: (f / "scene_gt.json").write_text("{"), "scene_gt of scene"),
        ("bop", lambda f: (f / "scene_camera.json").write_text("[]"), "one JSON obj"),
        ("scannet", lambda f: text(f / "pose" / "9.txt", "1 2 3 4"), "must hold poses"),
        ("scannet", lambda f: (f / "pose" / "9.txt").unlink(), "does not exist"),
        (
            "scannet",
            lambda f: text(f / "intrinsic" / "intrinsic_depth.txt", "1 2 3 4"),
            "must be 4 x 4",
        ),
        ("redwood", lambda f: text(f / "trajectory.log", "0 0 1"), "is cut off: each"),
        (
            "redwood",
            lambda f: text(f / "trajectory.log", "0 0 1", *["2 0 0 0"] * 4),
            "must hold poses",
        ),
        ("redwood", lambda f: shutil.rmtree(f / "depth"), "must hold depth images"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_folder_is_named(kind, change, message, tmp_path):
    change(MAKERS[kind](tmp_path / "given"))
    with pytest.raises(ValueError, match=message):
        opened(kind, tmp_path / "given")


def test_a_broken_image_is_named_when_it_is_read(tmp_path):
    folder = bop(tmp_path / "given")
    frames = opened("bop", folder)
    (folder / "depth" / "000003.png").write_bytes(b"hello")
    assert frames[1].name == "000012"
    with pytest.raises(ValueError, match=r"depth image '.*000003\.png'"):
        frames[0]
    (folder / "depth" / "000012.png").unlink()
    with pytest.raises(ValueError, match=r"000012\.png' does not exist"):
        frames[1]


def test_a_folder_of_another_kind_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"with scene_camera\.json \(BOP\), depth\.t"):
        ij.io.read_depth_folder(tmp_path)
    with pytest.raises(ValueError, match="path must be a folder, got"):
        ij.io.read_depth_folder(tmp_path / "none")
    with pytest.raises(ValueError, match="kind must be one of bop, redwood, scannet"):
        ij.io.read_depth_folder(tmp_path, "kitti")
    with pytest.raises(ValueError, match=r"scene_camera of scene .* does not exist"):
        ij.io.read_depth_folder(tmp_path, "bop")
    with pytest.raises(ValueError, match="camera must not be given of a folder of bop"):
        ij.io.read_depth_folder(bop(tmp_path / "bop"), camera=SMALL)
    with pytest.raises(ValueError, match="camera must be given where the folder's"):
        ij.io.read_depth_folder(tum(tmp_path / "tum"))
