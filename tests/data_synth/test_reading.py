"""Reading a dataset that is not as it should be."""

import shutil
import tarfile

import numpy as np
import pytest

from data_synth.distribution import Fixed
from data_synth.preset import CameraDraw
from impostor_jax.io.dataset import read_dataset, sensor_of
from tests.data_synth.small import SMALL, small_dataset
from tests.groups import DATASETS

pytestmark = DATASETS


def test_an_archive_can_be_read_alone(archives):
    path = archives / "train" / "shard-000001.tar"
    keys = [image.key for image in read_dataset(path)]
    assert keys == [f"000001_{k:06d}" for k in range(4)]


def test_shards_that_are_not_whole_are_not_read(bop, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(bop, folder)
    (folder / "train" / "000001").rename(folder / "train" / ".000001.half")
    keys = [image.key for image in read_dataset(folder)]
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
