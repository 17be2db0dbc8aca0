"""The commands, as a user types them."""

import hashlib
import json
import shutil
import sys

import cv2
import pytest

from data_synth.__main__ import main
from data_synth.checksums import seal
from data_synth.preview import preview
from data_synth.validate import validate
from impostor_jax import workers
from tests.data_synth.small import COUNT, HEIGHT, SMALL, WIDTH, small_dataset
from tests.groups import DATASETS, FULL

pytestmark = DATASETS


@pytest.fixture
def call(monkeypatch):
    """Run a command in this process; its exit code."""

    def run_here(*arguments):
        monkeypatch.setattr(sys, "argv", ["impostor-synth", *map(str, arguments)])
        try:
            return main()
        except SystemExit as stop:
            return stop.code

    return run_here


def test_describe_lists_the_presets(call, capsys):
    assert call("describe") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines] == [
        "bench", "tabletop_cans", "pipes", "tree_trunks", "tree_scan",
        "inside_pipe", "hard", "mixed_table", "color_table", "everyday_things",
        "no_cylinders",
    ]  # fmt: skip


def test_describe_json_is_a_preset_again(call, capsys, tmp_path):
    assert call("describe", "hard", "--json") == 0
    path = tmp_path / "hard.json"
    path.write_text(capsys.readouterr().out)
    assert call("describe", path) == 0
    assert "Dropout" in capsys.readouterr().out


@FULL
def test_validate_finds_a_good_dataset_good(call, capsys, bop, archives):
    for folder in (bop, archives):
        assert call("validate", folder) == 0
        assert f"{COUNT} images are good" in capsys.readouterr().out


@FULL
def test_validate_names_what_is_wrong(call, capsys, bop, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(bop, folder)
    changed = folder / "train" / "000000" / "depth" / "000000.png"
    changed.write_bytes(changed.read_bytes()[:-1])
    (folder / "train" / "000001" / "mask" / "000000_000000.png").unlink()
    (folder / "checksums" / "000002.sha256").unlink()
    assert call("validate", folder) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        "train/000000/depth/000000.png has changed since it was written",
        "train/000001/mask/000000_000000.png is missing",
        "shard 2 is missing; resume makes it",
    ]


def test_validate_reads_the_labels_too(bop, tmp_path):
    """Labels that were changed with all checksums are found by what they say."""
    folder = tmp_path / "out"
    shutil.copytree(bop, folder)
    path = folder / "train" / "000000" / "scene_gt_info.json"
    sums = folder / "checksums" / "000000.sha256"
    before = path.read_bytes()
    record = json.loads(before)
    record["0"][0]["visib_fract"] = 0.0
    path.write_text(json.dumps(record))
    digests = [hashlib.sha256(data).hexdigest() for data in (before, path.read_bytes())]
    sums.write_text(sums.read_text().replace(*digests))
    assert validate(folder) == [
        "checksums/000000.sha256 has changed since it was written"
    ]
    seal(folder, {"checksums/000000.sha256"})
    assert validate(folder) == ["000000_000000: visible fractions and masks disagree"]


def test_preview_draws_a_sheet_of_the_first_images(call, bop, tmp_path):
    path = tmp_path / "sheet.png"
    assert call("preview", bop, "--output", path, "--count", 5) == 0
    sheet = cv2.imread(str(path))
    assert sheet.shape == (2 * round(320 * HEIGHT / WIDTH), 3 * 320, 3)
    # The sixth place is blank.
    assert (sheet[-100:, -300:] == 255).all()
    assert sheet[:100, :300].std() > 10


def test_resume_says_what_was_made(call, capsys, bop, tmp_path):
    shutil.copytree(bop, tmp_path / "out")
    assert call("resume", tmp_path / "out") == 0
    assert "nothing was missing; --repair" in capsys.readouterr().out


def error_of(call, capsys, *arguments):
    """The one line on stderr of a command that is refused."""
    assert call(*arguments) == 2
    found = capsys.readouterr()
    assert found.out == ""
    (line,) = found.err.splitlines()
    assert line.startswith("impostor-synth: error: ")
    return line


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"--preset": "shelf"}, "preset must be one of bench"),
        ({"--output": "/proc/x"}, "can be made in the folder"),
        ({"--preset": "shelf.json"}, "'shelf.json' does not exist"),
        ({"--output": ""}, "--output must not be empty"),
        ({"--count": "0"}, "count must be a whole number from 1"),
        ({"--count": "-3"}, "count must be a whole number from 1"),
        ({"--seed": "-1"}, "seed must be a whole number from 0"),
        ({"--shard-size": "0"}, "shard_size must be a whole number from 1"),
        ({"--workers": "0"}, "workers must be at least 1"),
        ({"--num-shards": "2"}, "shard must be given where num_shards is 2"),
        ({"--num-shards": "2", "--shard": "2"}, "shard must be from 0 to 1"),
        ({"--num-shards": "0", "--shard": "0"}, "num_shards must be at least 1"),
        ({"--sensor": "none.json"}, "sensor file 'none.json'"),
        ({"--format": "zip"}, "zip"),
        ({"--count": "many"}, "many"),
    ],
)
def test_bad_arguments_are_one_line_and_exit_with_2(
    call, capsys, tmp_path, changes, message
):
    given = {"--preset": "bench", "--count": "1", "--output": str(tmp_path / "out")}
    words = [word for pair in (given | changes).items() for word in pair]
    assert message in error_of(call, capsys, "generate", *words)
    assert not (tmp_path / "out").exists()


def test_a_missing_dask_leaves_no_folder(call, capsys, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "dask.distributed", None)
    words = ("--preset", "bench", "--count", 1, "--output", tmp_path / "out")
    line = error_of(call, capsys, "generate", *words, "--dask", "tcp://none")
    assert "dask needs the extra scale" in line
    assert not (tmp_path / "out").exists()


def test_an_interrupt_says_how_to_go_on(call, capsys, tmp_path, monkeypatch):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(workers, "ProcessPoolExecutor", interrupt)
    words = ("--preset", "bench", "--count", 1, "--output", tmp_path / "out")
    assert call("generate", *words) == 130
    assert capsys.readouterr().err == (
        "impostor-synth: error: interrupted; resume makes what is missing\n"
    )


@pytest.mark.parametrize("name", ["sheet.txt", "sheet", "none/sheet.png"])
def test_a_sheet_that_cannot_be_written_is_refused(call, capsys, bop, tmp_path, name):
    line = error_of(call, capsys, "preview", bop, "--output", tmp_path / name)
    assert "output must" in line
    assert not list(tmp_path.iterdir())


def test_resume_repairs(call, capsys, bop, tmp_path):
    shutil.copytree(bop, tmp_path / "out")
    assert call("resume", tmp_path / "out", "--repair") == 0
    assert "nothing was missing or changed" in capsys.readouterr().out


def test_a_folder_that_is_not_empty_is_refused(call, capsys, bop, tmp_path):
    (tmp_path / "note.txt").write_text("mine")
    words = ("generate", "--preset", "bench", "--count", 1, "--output")
    line = error_of(call, capsys, *words, tmp_path)
    assert "output must be an empty folder" in line
    assert "resume" in error_of(call, capsys, *words, bop)
    assert "file" in error_of(call, capsys, *words, tmp_path / "note.txt")
    assert (tmp_path / "note.txt").read_text() == "mine"


@FULL
def test_a_part_of_another_dataset_is_refused(tmp_path):
    small_dataset(tmp_path, shard=0, num_shards=3)
    with pytest.raises(ValueError, match="holds a dataset"):
        small_dataset(tmp_path, shard=1, num_shards=3, seed=8)


@pytest.mark.parametrize("command", ["resume", "validate", "preview"])
def test_a_folder_without_a_manifest_is_a_clear_error(call, capsys, tmp_path, command):
    line = error_of(call, capsys, command, tmp_path)
    assert "manifest of dataset" in line
    assert "does not exist" in line


def test_a_manifest_of_another_version_is_refused(call, capsys, bop, tmp_path):
    record = json.loads((bop / "manifest.json").read_text())
    (tmp_path / "manifest.json").write_text(json.dumps({**record, "version": 2}))
    assert "must be 1" in error_of(call, capsys, "resume", tmp_path)
    (tmp_path / "manifest.json").write_text(json.dumps({"version": 1}))
    assert "is broken" in error_of(call, capsys, "resume", tmp_path)


def test_a_preview_needs_images(tmp_path):
    small_dataset(tmp_path, count=1, shard=1, num_shards=2)
    with pytest.raises(ValueError, match="has no images yet"):
        preview(tmp_path, tmp_path / "sheet.png")


@FULL
def test_progress_is_quiet_in_a_pipe_and_the_summary_says_all(
    call, capsys, tmp_path, monkeypatch
):
    path = tmp_path / "small.json"
    path.write_text(json.dumps(SMALL.record()))
    # In this process, which has the program compiled.
    from tests.data_synth.small import Here

    monkeypatch.setattr(workers, "ProcessPoolExecutor", lambda *_, **__: Here())
    words = ("generate", "--preset", path, "--count", 4, "--output", tmp_path / "out")
    assert call(*words) == 0
    found = capsys.readouterr()
    assert found.err == ""
    assert "4 images in" in found.out
    for stage in ("drawing", "capturing", "coding", "writing"):
        assert f"{stage} " in found.out
