"""Videos of drawn scenes, and their labels."""

import dataclasses
import json

import numpy as np
import pytest

import impostor_jax as ij
from data_synth.appearance import Appearance
from data_synth.distribution import Fixed
from data_synth.generate import generate
from data_synth.manifest import Manifest
from data_synth.validate import validate
from tests.data_synth.small import SMALL, checksums, small_dataset
from tests.groups import DATASETS

pytestmark = DATASETS

MOVING = dataclasses.replace(SMALL, clutter=Fixed(1))


@pytest.fixture(scope="module")
def videos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("videos") / "dataset"
    small_dataset(folder, MOVING, count=24, sequence=12)
    return folder


def test_a_video_shows_one_scene_that_moves(videos):
    assert not validate(videos)
    images = list(ij.read_dataset(videos))
    assert len(images) == 24
    for video in (images[:12], images[12:]):
        first, last = video[0], video[-1]
        np.testing.assert_allclose(
            [image.seconds for image in video], np.arange(12) / 30, atol=1e-6
        )
        np.testing.assert_array_equal(first.camera_from_world, np.eye(4))
        for image in video:
            np.testing.assert_array_equal(image.identity, first.identity)
            np.testing.assert_array_equal(
                image.cylinders.radius, first.cylinders.radius
            )
        assert not np.allclose(last.camera_from_world, np.eye(4))
        # Clutter goes to and fro; what stands there is still in the world, or moves by
        # less than its way.
        back = np.linalg.inv(last.camera_from_world)
        there = np.asarray(last.cylinders.center) @ back[:3, :3].T + back[:3, 3]
        off = np.linalg.norm(there - np.asarray(first.cylinders.center), axis=1)
        assert off[-1] > 0.01
        assert (off[:-1] < 0.12).all()
        up = np.asarray(last.cylinders.axis) @ back[:3, :3].T
        np.testing.assert_allclose(up, first.cylinders.axis, atol=1e-6)


def test_readings_are_new_in_each_image(videos):
    first, second = ij.read_dataset(videos)[:2]
    both = (first.depth > 0) & (second.depth > 0)
    assert (first.depth != second.depth)[both].mean() > 0.5


def test_poses_are_where_bop_has_them(videos):
    folder = ij.read_depth_folder(videos / "train" / "000000")
    image = ij.read_dataset(videos)[5]
    np.testing.assert_allclose(
        np.asarray(folder[5].camera.camera_from_world.translation),
        image.camera_from_world[:3, 3],
        atol=1e-6,
    )


def test_a_video_in_an_archive_is_the_same(videos, tmp_path):
    small_dataset(
        tmp_path / "archive", MOVING, count=12, sequence=12, layout="webdataset"
    )
    (image,) = ij.read_dataset(tmp_path / "archive")[7:8]
    same = ij.read_dataset(videos)[7]
    np.testing.assert_array_equal(image.depth, same.depth)
    np.testing.assert_array_equal(image.camera_from_world, same.camera_from_world)
    np.testing.assert_array_equal(image.identity, same.identity)


def test_a_manifest_says_that_it_is_of_videos(videos, bop):
    assert Manifest.read(videos).is_sequence
    assert "is_sequence" not in json.loads((bop / "manifest.json").read_text())


def test_the_same_seed_makes_the_same_video(videos, tmp_path):
    small_dataset(tmp_path / "again", MOVING, count=12, sequence=12)
    again = checksums(tmp_path / "again")
    assert again == {name: checksums(videos)[name] for name in again}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"placement": ("around",), "ground": False}, "sequence must be None for a"),
        ({"appearance": Appearance()}, "sequence must be None for images in color"),
    ],
)
def test_what_cannot_move_is_refused(changes, message, tmp_path):
    preset = dataclasses.replace(SMALL, **changes)
    with pytest.raises(ValueError, match=message):
        generate(preset, 4, tmp_path / "no", sequence=4)
