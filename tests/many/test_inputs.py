"""What files, folders, lists and patterns stand for."""

import numpy as np
import pytest

from impostor_jax.io.camera_file import CameraFile
from impostor_jax.many.inputs import items_of
from impostor_jax.many.items import CloudFile, FolderFrame, ImageFile
from tests.data_synth.small import small_dataset
from tests.groups import DATASETS
from tests.io.test_depth_folder import MAKERS, NAMES, SMALL, UNITS, image


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Images of two sets, under the same names."""
    for name in ("one/depth/a", "one/depth/b", "two/depth/a"):
        path = tmp_path / f"{name}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, np.ones((2, 3), np.float32))
    (tmp_path / "one" / "depth" / "notes.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def names(*given, **options):
    return [item.name for item in items_of(given, "camera.json", **options)]


def test_names_begin_at_the_folder_that_images_have_in_common(folder):
    assert names("one/depth") == ["a", "b"]
    assert names("one/depth/a.npy", "two/depth") == ["one/depth/a", "two/depth/a"]
    assert names("*/depth/*") == ["one/depth/a", "one/depth/b", "two/depth/a"]
    assert names("one/*", "two/depth/a.npy") == [
        "one/depth/a", "one/depth/b", "two/depth/a",
    ]  # fmt: skip


def test_endings_tell_images_of_one_name_apart(folder):
    np.save(folder / "one" / "depth" / "c.npy", np.ones((2, 3)))
    (folder / "one" / "depth" / "a.tiff").write_bytes(b"")
    assert names("one/depth") == ["a.npy", "a.tiff", "b", "c"]


def test_a_list_is_seen_from_its_folder_and_may_name_what_is_missing(folder):
    lines = "depth/b.npy", "", "../two/depth/a.npy", "none"
    (folder / "one" / "list.txt").write_text("\n".join(lines))
    items = items_of(["one/list.txt"], "camera.json")
    assert [item.name for item in items] == ["one/depth/b", "two/depth/a", "one/none"]
    assert isinstance(items[2], ImageFile)
    assert items[2].path.name == "none"


def test_cameras_and_masks_are_found_by_patterns(folder):
    items = items_of(
        ["*/depth/*.npy"], "{folder}/../camera.json", ["masks/{name}_0.png"], "labels"
    )
    last = items[-1]
    assert isinstance(last, ImageFile)
    assert last.camera == last.path.parent / ".." / "camera.json"
    assert str(last.beside) == "masks/a_0.png"
    assert last.meaning == "labels"
    (folder / "masks").mkdir()
    one = items_of(["*/depth/*.npy"], "camera.json", ["masks"])[0]
    assert isinstance(one, ImageFile)
    assert str(one.beside) == "masks/one/depth/a.png"


@pytest.mark.parametrize("kind", MAKERS)
def test_a_folder_of_a_dataset_has_its_own_cameras(kind, tmp_path):
    MAKERS[kind](tmp_path / "set" / "first")
    MAKERS[kind](tmp_path / "set" / "second")
    camera = CameraFile(SMALL, None) if kind in ("tum", "redwood") else None
    items = items_of([str(tmp_path / "set" / "*")], camera)
    assert [item.name for item in items] == [
        f"{folder}/{name}" for folder in ("first", "second") for name in NAMES[kind]
    ]
    shown = items[0].read()
    assert shown.depth is not None
    assert shown.depth.shape == (2, 3)
    assert shown.camera is not None
    assert shown.camera.camera_from_world is not None
    if kind == "bop":
        assert np.unique(shown.labels).tolist() == [0, 1, 2]
        assert items[1].read().labels is None
    told = items[0].fingerprint()
    assert items[0].fingerprint() == told
    assert isinstance(items[0], FolderFrame)
    image(items[0].shot.depth, UNITS + 1)
    assert items[0].fingerprint() != told


@DATASETS
@pytest.mark.parametrize("layout", ["bop", "webdataset"])
def test_a_dataset_of_ours_has_masks_and_keys(layout, tmp_path):
    small_dataset(tmp_path / "set", count=6, layout=layout)
    items = items_of([tmp_path / "set"])
    assert [item.name for item in items][3:5] == ["000000_000003", "000001_000000"]
    shown = items[4].read()
    assert shown.depth is not None
    assert shown.labels is not None
    assert shown.labels.max() >= 1
    assert shown.depth[shown.labels == 0].size
    assert np.median(shown.depth[shown.labels > 0]) > 0.1


def test_without_a_camera_files_are_clouds(folder):
    (folder / "c.xyz").write_text("0 0 1\n")
    (item,) = items_of(["c.xyz"])
    assert isinstance(item, CloudFile)
    np.testing.assert_array_equal(item.read().points, [[0, 0, 1]])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((), "a depth image must be given"),
        (("none",), "'none' does not exist"),
        (("none/*",), "must match depth images"),
        (("one",), "must hold depth images, got none"),
        (("one/depth", "one/depth/b.npy"), "must be different, got 'b.npy' twice"),
    ],
)
def test_what_stands_for_nothing_is_refused(folder, given, message):
    with pytest.raises(ValueError, match=message):
        names(*given)


def test_masks_that_do_not_go_with_the_images_are_refused(folder, tmp_path):
    with pytest.raises(ValueError, match="got 1 for 2"):
        names("one/depth", beside=["a.png"])
    MAKERS["bop"](tmp_path / "bop")
    with pytest.raises(ValueError, match="mask must not be given of datasets"):
        items_of(["bop"], None, ["a.png"])
