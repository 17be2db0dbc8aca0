"""Reading a dataset that is not as it should be."""

import json
import shutil
import tarfile

import cv2
import numpy as np
import pytest

from data_synth.camera_draw import CameraDraw
from data_synth.distribution import Fixed
from data_synth.manifest import Manifest
from impostor_jax.io.dataset import read_dataset, sensor_of
from impostor_jax.io.depth_folder import read_depth_folder
from tests.data_synth.small import COUNT, SMALL, small_dataset
from tests.groups import DATASETS, FULL

pytestmark = DATASETS


def test_an_archive_can_be_read_alone(archives):
    path = archives / "train" / "shard-000001.tar"
    keys = [image.key for image in read_dataset(path)]
    assert keys == [f"000001_{k:06d}" for k in range(4)]


def test_a_scene_is_a_folder_of_bop(bop):
    scene = read_dataset(bop)[:4]
    frames = read_depth_folder(bop / "train" / "000000")
    assert len(frames) == 4
    for image, frame in zip(scene, frames, strict=True):
        assert image.key == f"000000_{frame.name}"
        np.testing.assert_allclose(frame.depth, image.depth, rtol=1e-6)
        np.testing.assert_array_equal(frame.masks, image.mask)
        np.testing.assert_allclose(frame.camera.matrix(), image.camera.matrix())


def test_shards_that_are_not_whole_are_not_read(bop, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(bop, folder)
    (folder / "train" / "000001").rename(folder / "train" / ".000001.half")
    with pytest.raises(ValueError, match=r"must have 10 images, but .*1' is missing"):
        read_dataset(folder)
    keys = [image.key for image in read_dataset(folder, allow_partial=True)]
    assert {key.split("_")[0] for key in keys} == {"000000", "000002"}


def test_a_missing_label_file_is_named(bop, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(bop, folder)
    (folder / "train" / "000000" / "scene_gt_info.json").unlink()
    with pytest.raises(ValueError, match=r"scene_gt_info of scene .* does not exist"):
        list(read_dataset(folder))


def test_a_broken_archive_is_named(archives, tmp_path):
    path = tmp_path / "shard-000000.tar"
    data = (archives / "train" / path.name).read_bytes()
    path.write_bytes(b"x" * 2000 + data[2000:])
    with pytest.raises(ValueError, match=r"archive .*shard-000000.tar' is broken"):
        list(read_dataset(path))


def test_an_archive_without_a_label_is_broken(archives, tmp_path):
    path = tmp_path / "shard-000000.tar"
    with (
        tarfile.open(archives / "train" / path.name) as source,
        tarfile.open(path, "w") as copy,
    ):
        for member in source:
            if not member.name.endswith("cylinders.json"):
                copy.addfile(member, source.extractfile(member))
    with pytest.raises(ValueError, match="cylinders"):
        list(read_dataset(path))


def test_a_manifest_without_a_sensor_is_refused():
    with pytest.raises(ValueError, match="type of sensor of the manifest"):
        sensor_of({})


@FULL
def test_a_lens_is_read_with_its_camera(tmp_path):
    import dataclasses

    camera = CameraDraw(
        count=1, width=64, height=48, focal=Fixed(52.0),
        distortion=(Fixed(-0.1), Fixed(0.02)),
    )  # fmt: skip
    small_dataset(tmp_path, dataclasses.replace(SMALL, camera=camera), count=2)
    images = list(read_dataset(tmp_path))
    for image in images:
        np.testing.assert_allclose(image.camera.distortion, [-0.1, 0.02, 0, 0, 0])
    # One object: a lens takes long to make.
    assert images[0].camera is images[1].camera


def test_images_are_counted_indexed_and_read_again(bop, archives):
    for path in (bop, archives):
        images = read_dataset(path)
        assert len(images) == COUNT
        keys = [image.key for image in images]
        assert keys == [image.key for image in images]
        assert [images[k].key for k in range(COUNT)] == keys
        assert images[-1].key == keys[-1]
        assert [image.key for image in images[3:6]] == keys[3:6]
        np.testing.assert_array_equal(images[5].depth, list(images)[5].depth)
        with pytest.raises(IndexError, match="index must be below 10"):
            images[COUNT]


def spoiled(whole, folder, change):
    """A copy in which one label file of scene 1 is another."""
    shutil.copytree(whole, folder)
    name, edit = change
    path = folder / "train" / "000001" / f"{name}.json"
    record = json.loads(path.read_text())
    edit(record)
    path.write_text(json.dumps(record))
    return folder


@pytest.mark.parametrize(
    ("name", "edit", "message"),
    [
        ("scene_cylinders", lambda r: r.pop("3"), "scene_cylinders of .* lacks '3'"),
        ("scene_camera", lambda r: r.update(x=r.pop("2")), "scene_camera .* lacks '2'"),
        ("scene_camera", lambda r: r["2"].pop("depth_scale"), "lack 'depth_scale'"),
        ("scene_camera", lambda r: r["2"].update(depth_scale=True), "depth_scale must"),
        ("scene_gt_info", lambda r: r["2"].pop(), "gt_info must have . cylinders"),
        ("scene_gt_info", lambda r: r.update({"2": 5}), "image 2 of scene .* broken"),
        ("scene_cylinders", lambda r: r["2"].update(camera=5), "image 2 of scene"),
        ("scene_cylinders", lambda r: r["2"].pop("camera"), "2 of .* lack 'camera'"),
        (
            "scene_cylinders",
            lambda r: r["2"]["cylinders"][0].update(radius_m=-1),
            "image 2 of scene .*000001.*radius must be positive",
        ),
        (
            "scene_cylinders",
            lambda r: r["2"]["camera"].update(width=10**12),
            "image 2 of scene .*000001.* at most 268435456 pixels",
        ),
    ],
)  # fmt: skip
def test_a_label_that_is_broken_is_named_with_its_file(
    bop, tmp_path, name, edit, message
):
    images = read_dataset(spoiled(bop, tmp_path / "out", (name, edit)))
    assert images[0].key == "000000_000000"
    with pytest.raises(ValueError, match=message):
        images[6]
    with pytest.raises(ValueError, match=message):
        list(images)


@pytest.mark.parametrize("folder", ["depth", "mask_visib"])
def test_a_picture_of_another_size_is_named(bop, tmp_path, folder):
    shutil.copytree(bop, tmp_path / "out")
    (path, *_) = (tmp_path / "out" / "train" / "000001" / folder).glob("000002*")
    cv2.imwrite(str(path), np.zeros((9, 9), np.uint16))
    with pytest.raises(ValueError, match=r"shape \(48, 64\), got \(9, 9\) in '"):
        read_dataset(tmp_path / "out")[6]


def test_an_archive_that_is_cut_off_is_named(archives, tmp_path):
    shutil.copytree(archives, tmp_path / "out")
    path = tmp_path / "out" / "train" / "shard-000001.tar"
    data = path.read_bytes()
    with tarfile.open(path) as archive:
        ends = [m.offset_data + m.size for m in archive]
    for end in (ends[-1] - 5, ends[-1] // 2, ends[len(ends) // 2] // 512 * 512):
        path.write_bytes(data[:end])
        with pytest.raises(ValueError, match=r"shard-000001\.tar"):
            list(read_dataset(tmp_path / "out"))


def test_four_of_six_images_are_refused(archives, tmp_path):
    shutil.copytree(archives, tmp_path / "out")
    path = tmp_path / "out" / "train" / "shard-000001.tar"
    with tarfile.open(path) as source, tarfile.open(tmp_path / "few.tar", "w") as few:
        for member in source:
            if member.name < "000001_000002":
                few.addfile(member, source.extractfile(member))
    shutil.copy(tmp_path / "few.tar", path)
    with pytest.raises(ValueError, match="must have 4 images, got 2"):
        list(read_dataset(tmp_path / "out"))
    assert len(read_dataset(path)) == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": None}, "count must be a whole number"),
        ({"count": "6"}, "count must be a whole number"),
        ({"shard_size": 0}, "shard_size must be a whole number from 1"),
        ({"layout": "zip"}, "layout must be one of bop, webdataset"),
        ({"count": 10**9}, "count must be a whole number from 1 to 100000000"),
    ],
)
def test_a_manifest_that_is_broken_is_named(bop, tmp_path, change, message):
    record = json.loads((bop / "manifest.json").read_text())
    (tmp_path / "manifest.json").write_text(json.dumps(record | change))
    for read in (read_dataset, Manifest.read):
        with pytest.raises(ValueError, match=f"manifest of dataset .*: {message}"):
            read(tmp_path)
