"""Bytes that were changed anywhere end in values or in a `ValueError`, quietly."""

import contextlib
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_synth.presets import PRESETS, preset_named
from impostor_jax.io.camera_file import read_camera
from impostor_jax.io.depth_folder import DepthFolder
from impostor_jax.io.depth_image import read_depth, read_mask
from impostor_jax.io.depth_layouts import LAYOUTS
from impostor_jax.io.points_file import read_points
from impostor_jax.io.scene_file import read_scene
from tests.groups import FULL
from tests.io.test_depth_folder import MAKERS, SMALL

EXAMPLES = settings(max_examples=150, deadline=None)

CHANGES = st.lists(
    st.tuples(
        st.sampled_from(["set", "insert", "remove", "cut"]),
        st.floats(0, 1),
        st.binary(min_size=1, max_size=6)
        | st.sampled_from([b"\0\0\0\0", b"\xff\xff\xff\xff", b"[[[[", b"1e999", b"{"]),
    ),
    min_size=1,
    max_size=4,
)

POINT_FILES = [
    "laspy.las", "open3d.xyz", "open3d_ascii.pcd", "open3d_binary.ply",
    "open3d_ascii.ply", "pcl_binary.pcd", "pcl_compressed.pcd",
]  # fmt: skip


def changed(data, changes):
    for kind, place, new in changes:
        k = int(place * len(data))
        if kind == "set":
            data = data[:k] + new + data[k + len(new) :]
        elif kind == "insert":
            data = data[:k] + new + data[k:]
        elif kind == "remove":
            data = data[:k] + data[k + len(new) :]
        else:
            data = data[:k]
    return data


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Good files of each kind."""
    folder = tmp_path_factory.mktemp("fuzz")
    units = (np.arange(96, dtype=np.uint16).reshape(8, 12) * 500) % 7001
    cv2.imwrite(str(folder / "good.png"), units)
    cv2.imwrite(str(folder / "good.tiff"), units.astype(np.float32))
    np.save(folder / "good.npy", units.astype(np.float32))
    camera = {"fx": 6.0, "fy": 6.0, "cx": 5.5, "cy": 3.5, "width": 12, "height": 8}
    (folder / "camera.json").write_text(json.dumps(camera))
    even = {"first": -90.0, "last": 90, "count": 12}
    scanner = {"model": "spherical", "elevation_deg": [1, 0, -2], "azimuth_deg": even}
    (folder / "scanner.json").write_text(json.dumps(scanner))
    shape = {"type": "sphere", "center": [0, 0, 1], "radius": 0.5}
    shape["material"] = {"color": [1, 0.5, 0], "transmit": 0.5, "fresnel": True}
    light = {"type": "point", "position": [0, 0, 0], "intensity": [1, 1, 0.5]}
    scene = {"version": 1, "camera": camera, "shapes": [shape], "lights": [light]}
    scene["background"] = [0, 0, 0.5]
    (folder / "scene.json").write_text(json.dumps(scene))
    ball = {"type": "sphere", "center": [0, 0, 1], "radius": 0.5}
    plane = {"type": "plane", "point": [0, 0, 1], "normal": [0, 0, 1]}
    ground = {"type": "heightfield", "height": [[0, 1], [2, 1]]}
    ground["extent"] = [[0, 1], [0, 1]]
    both = {"type": "union", "shapes": [ball, plane, ground]}
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]
    cut = {"type": "difference", "shapes": [ball, both], "world_from_shapes": pose}
    (folder / "solid.json").write_text(json.dumps({"version": 1, "shapes": [cut]}))
    (folder / "preset.json").write_text(json.dumps(PRESETS["hard"].record()))
    for name in POINT_FILES:
        shutil.copy(Path(__file__).parent / "data" / name, folder)
    return folder


def read_or_refuse(read, folder, name, changes):
    data = (folder / name).read_bytes()
    path = folder / f"changed{(folder / name).suffix}"
    path.write_bytes(changed(data, changes))
    with contextlib.suppress(ValueError):
        read(path)


@pytest.mark.parametrize("name", ["good.png", "good.tiff", "good.npy"])
def test_changed_images_are_read_or_refused(folder, name, capfd):
    @EXAMPLES
    @given(CHANGES)
    def check(changes):
        read_or_refuse(lambda path: read_depth(path, 1e-3), folder, name, changes)
        if not name.endswith("npy"):
            read_or_refuse(read_mask, folder, name, changes)
        assert capfd.readouterr() == ("", "")

    check()


@FULL
@pytest.mark.parametrize("name", POINT_FILES)
def test_changed_points_are_read_or_refused(folder, name, capfd):
    for needed in ("lazrs", "lzf"):
        pytest.importorskip(needed)

    @EXAMPLES
    @given(CHANGES)
    def check(changes):
        read_or_refuse(read_points, folder, name, changes)
        assert capfd.readouterr() == ("", "")

    check()


@FULL
@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("tum", "depth.txt"),
        ("tum", "groundtruth.txt"),
        ("bop", "scene_camera.json"),
        ("bop", "scene_gt.json"),
        ("scannet", "pose/9.txt"),
        ("redwood", "trajectory.log"),
    ],
)
def test_changed_folders_are_read_or_refused(tmp_path, kind, name):
    path = MAKERS[kind](tmp_path / "freiburg1") / name
    data = path.read_bytes()

    @EXAMPLES
    @given(CHANGES)
    def check(changes):
        path.write_bytes(changed(data, changes))
        with contextlib.suppress(ValueError):
            # A checker of types would look into what `read_depth_folder` returns, and
            # wrap what is raised there.
            list(DepthFolder(LAYOUTS[kind](path.parents[name.count("/")]), SMALL))

    check()


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("camera.json", read_camera),
        ("scanner.json", read_camera),
        ("scene.json", read_scene),
        ("solid.json", read_scene),
        ("preset.json", lambda path: preset_named(str(path))),
    ],
)
def test_changed_records_are_read_or_refused(folder, name, read):
    @EXAMPLES
    @given(CHANGES)
    def check(changes):
        read_or_refuse(read, folder, name, changes)

    check()


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda part: (
        st.lists(part, max_size=4)
        | st.dictionaries(st.text(max_size=5), part, max_size=4)
    ),
    max_leaves=8,
)


@FULL
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("camera.json", read_camera),
        ("scanner.json", read_camera),
        ("scene.json", read_scene),
        ("solid.json", read_scene),
        ("preset.json", lambda path: preset_named(str(path))),
    ],
)
def test_records_with_other_values_are_read_or_refused(folder, name, read):
    good = json.loads((folder / name).read_text())
    keys = st.sampled_from(list(good))

    @EXAMPLES
    @given(keys, JSON)
    def check(key, value):
        path = folder / "other.json"
        path.write_text(json.dumps(good | {key: value}))
        with contextlib.suppress(ValueError):
            read(path)

    check()
