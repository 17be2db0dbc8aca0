"""What was changed, emptied or lost in a dataset is found, and made again."""

import hashlib
import json
import shutil

import pytest

from data_synth.generate import resume
from data_synth.validate import validate
from tests.data_synth.small import Here, checksums
from tests.groups import DATASETS, FULL

pytestmark = DATASETS


@pytest.fixture(params=["bop", "archives"])
def whole(request):
    """A good dataset, of either layout."""
    return request.getfixturevalue(request.param)


@pytest.fixture
def copy(whole, tmp_path):
    """One that a test may spoil."""
    shutil.copytree(whole, tmp_path / "out")
    return tmp_path / "out"


def files(folder):
    """The bytes of all files of a dataset."""
    paths = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): p.read_bytes() for p in paths}


def repaired(folder):
    """Numbers of the shards that are made again."""
    return sorted(r.shard for r in resume(folder, executor=Here(), repair=True))


def a_file_of(folder, shard):
    """Of the pictures of a shard, or the archive that holds them."""
    archive = folder / "train" / f"shard-{shard:06d}.tar"
    if archive.exists():
        return archive
    return folder / "train" / f"{shard:06d}" / "depth" / "000001.png"


def spoil_picture(folder):
    path = a_file_of(folder, 1)
    path.write_bytes(path.read_bytes()[:-20])
    return f"{path.relative_to(folder)} has changed since it was written"


def lose_picture(folder):
    path = a_file_of(folder, 1)
    path.unlink()
    if path.suffix == ".tar":
        return "shard 1 is missing; resume makes it"
    return f"{path.relative_to(folder)} is missing"


def empty_checksums(folder):
    """And spoil what they were of."""
    spoil_picture(folder)
    (folder / "checksums" / "000001.sha256").write_text("")
    return "checksums/000001.sha256 has changed since it was written"


def forge_checksums(folder):
    """As if the spoiled picture had always been there."""
    before = checksums(folder)
    spoil_picture(folder)
    path = a_file_of(folder, 1)
    name = str(path.relative_to(folder))
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    sums = folder / "checksums" / "000001.sha256"
    sums.write_text(sums.read_text().replace(before[name], digest))
    return "checksums/000001.sha256 has changed since it was written"


@pytest.mark.parametrize(
    "spoil", [spoil_picture, lose_picture, empty_checksums, forge_checksums]
)
def test_a_shard_that_has_changed_is_found_and_made_again(copy, whole, spoil):
    problem = spoil(copy)
    assert problem in validate(copy)
    assert repaired(copy) == [1]
    assert files(copy) == files(whole)
    assert validate(copy) == []
    assert repaired(copy) == []


@pytest.mark.parametrize("name", ["obj_000001.ply", "models_info.json"])
def test_models_that_have_changed_are_found_and_made_again(copy, whole, name):
    path = copy / "models" / name
    path.write_bytes(path.read_bytes() + b" ")
    assert validate(copy) == [f"models/{name} has changed since it was written"]
    path.unlink()
    assert validate(copy) == [f"models/{name} is missing"]
    shutil.rmtree(copy / "models")
    assert f"models/{name} is missing" in validate(copy)
    assert repaired(copy) == []
    assert files(copy) == files(whole)


def test_the_list_of_checksums_is_made_again(copy, whole):
    path = copy / "checksums" / "checksums.sha256"
    path.write_text("")
    assert validate(copy) == [
        "checksums/checksums.sha256 has changed since it was written"
    ]
    assert repaired(copy) == []
    assert files(copy) == files(whole)


def test_checksums_that_cannot_be_trusted_are_all_made_again(bop, tmp_path):
    shutil.copytree(bop, tmp_path / "out")
    folder = tmp_path / "out"
    empty_checksums(folder)
    (folder / "checksums" / "checksums.sha256").unlink()
    assert "checksums/checksums.sha256 is missing" in validate(folder)
    # Without --repair nobody calls good what is there.
    resume(folder, executor=Here())
    assert validate(folder)
    assert repaired(folder) == [0, 1, 2]
    assert files(folder) == files(bop)


def test_a_dataset_that_was_never_whole_is_repaired(bop, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(bop, folder)
    record = json.loads((folder / "manifest.json").read_text())
    del record["checksums_sha256"]
    (folder / "manifest.json").write_text(json.dumps(record, indent=2) + "\n")
    (folder / "checksums" / "checksums.sha256").unlink()
    assert validate(folder) == [
        "the manifest has no digest of the checksums; resume adds it"
    ]
    (folder / "checksums" / "000002.sha256").write_text("")
    assert repaired(folder) == [2]
    assert validate(folder) == []
    assert checksums(folder) == checksums(bop)


def test_a_file_that_is_in_no_checksum_is_found_and_kept(copy):
    for name in ("models/note.txt", "train/note.txt"):
        (copy / name).write_text("mine")
    assert validate(copy) == [
        "models/note.txt is in no checksum file",
        "train/note.txt is in no checksum file",
    ]
    assert repaired(copy) == []
    assert (copy / "train" / "note.txt").read_text() == "mine"


def test_a_shard_with_another_file_is_not_made_again(bop, tmp_path):
    shutil.copytree(bop, tmp_path / "out")
    note = tmp_path / "out" / "train" / "000000" / "note.txt"
    note.write_text("mine")
    assert validate(tmp_path / "out") == [
        "train/000000/note.txt is in no checksum file"
    ]
    assert repaired(tmp_path / "out") == []
    assert note.read_text() == "mine"


@FULL
def test_missing_shards_are_one_line(bop, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(bop, folder)
    record = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps({**record, "count": 400_000}))
    lines = validate(folder)
    assert "shards 3 to 99999 are missing; resume makes them" in lines
    assert len(lines) < 5
