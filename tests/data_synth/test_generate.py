"""The same bytes in any order, by any worker, after any interruption."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest

import data_synth.shard
from data_synth.generate import generate, resume
from data_synth.manifest import Manifest
from data_synth.validate import validate
from tests.data_synth.small import (
    COUNT,
    SEED,
    SHARD_SIZE,
    SMALL,
    Here,
    checksums,
    small_dataset,
)
from tests.groups import DATASETS, FULL, RELEASE

pytestmark = DATASETS
OPTIONS = {"count": COUNT, "seed": SEED, "shard_size": SHARD_SIZE, "normals": True}


@pytest.fixture
def preset_file(tmp_path):
    path = tmp_path / "small.json"
    path.write_text(json.dumps(SMALL.record()))
    return path


def sealed(folder):
    """What the manifest says of the checksums; None where there is none, or not yet."""
    path = folder / "manifest.json"
    return (
        json.loads(path.read_text()).get("checksums_sha256") if path.exists() else None
    )


def test_two_runs_give_equal_bytes(tmp_path, bop):
    small_dataset(tmp_path, normals=True)
    assert checksums(tmp_path) == checksums(bop)
    names = ("manifest.json", "checksums/checksums.sha256")
    for path, other in ((tmp_path / name, bop / name) for name in names):
        assert (
            path.read_bytes().partition(b"made_by")[0]
            == other.read_bytes().partition(b"made_by")[0]
        )
    assert sealed(tmp_path) == sealed(bop) is not None


def test_another_seed_gives_other_bytes(tmp_path, bop):
    small_dataset(tmp_path, normals=True, seed=SEED + 1)
    assert set(checksums(tmp_path).values()).isdisjoint(checksums(bop).values())


def test_images_do_not_depend_on_the_shards(tmp_path, bop):
    small_dataset(tmp_path, normals=True, shard_size=3)
    for number in range(COUNT):
        paths = [
            folder / f"train/{number // size:06d}/depth/{number % size:06d}.png"
            for folder, size in ((tmp_path, 3), (bop, SHARD_SIZE))
        ]
        assert paths[0].read_bytes() == paths[1].read_bytes()


def test_parts_together_are_the_whole(tmp_path, bop):
    for part in (2, 0, 1):
        assert sealed(tmp_path) is None
        small_dataset(tmp_path, normals=True, shard=part, num_shards=3)
    assert checksums(tmp_path) == checksums(bop)
    assert sealed(tmp_path) == sealed(bop)
    # A part that begins once more changes nothing.
    before = (tmp_path / "manifest.json").read_bytes()
    assert small_dataset(tmp_path, normals=True, shard=1, num_shards=3) == []
    assert (tmp_path / "manifest.json").read_bytes() == before


def test_a_part_that_is_done_is_not_made_again(tmp_path):
    assert len(small_dataset(tmp_path, shard=0, num_shards=2)) == 2
    assert small_dataset(tmp_path, shard=0, num_shards=2) == []


@FULL
def test_a_pool_of_processes_gives_equal_bytes(tmp_path, bop, preset_file):
    generate(str(preset_file), output=tmp_path / "out", workers=1, **OPTIONS)
    assert checksums(tmp_path / "out") == checksums(bop)


@FULL
@pytest.mark.filterwarnings("ignore")  # of the cluster's, when it ends
def test_dask_gives_equal_bytes(tmp_path, bop):
    distributed = pytest.importorskip("dask.distributed")
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None
    )
    with cluster, distributed.Client(cluster) as client:
        executor = client.get_executor(pure=False)
        generate(SMALL, output=tmp_path / "out", executor=executor, **OPTIONS)
    assert checksums(tmp_path / "out") == checksums(bop)


@FULL
def test_killed_and_resumed_gives_equal_bytes(tmp_path, bop, preset_file):
    folder = tmp_path / "out"
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "data_synth", "generate", "--normals"),
            *("--preset", preset_file, "--count", str(COUNT), "--seed", str(SEED)),
            *("--shard-size", str(SHARD_SIZE), "--output", folder, "--workers", "1"),
        ],
        start_new_session=True,
    )
    train = folder / "train"
    while not (train.exists() and any(train.iterdir())):
        assert process.poll() is None
        time.sleep(0.02)
    process.kill()
    process.wait()
    # The worker ends with its parent, whoever killed that.
    for _ in range(500):
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            break
        time.sleep(0.02)
    else:
        os.killpg(process.pid, signal.SIGKILL)
        pytest.fail("a worker outlived its parent")
    assert not (folder / "checksums").exists() or len(checksums(folder)) < len(
        checksums(bop)
    )
    assert validate(folder)
    resume(folder, executor=Here())
    assert checksums(folder) == checksums(bop)
    assert sealed(folder) == sealed(bop)
    assert validate(folder) == []
    assert not list(train.glob(".*"))


@FULL
@pytest.mark.parametrize("seconds", [0.0, pytest.param(0.5, marks=RELEASE)])
def test_an_interrupt_is_one_line_and_the_rest_can_be_made(
    tmp_path, preset_file, seconds
):
    program = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from data_synth.__main__ import main; sys.exit(main())"
    )
    folder = tmp_path / "out"
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", program, "generate", "--normals"),
            *("--preset", preset_file, "--count", "400", "--seed", str(SEED)),
            *("--shard-size", "40", "--output", folder, "--workers", "1"),
        ],
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not (folder / "models" / "models_info.json").exists():
        assert process.poll() is None
        time.sleep(0.02)
    # The worker begins, or it is at work.
    time.sleep(seconds)
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=120)
    assert process.returncode == 130
    line = "impostor-synth: error: interrupted; resume makes what is missing"
    assert error.splitlines() == [line]
    assert sealed(folder) is None


def test_what_ended_before_the_last_line_is_sealed_by_resume(tmp_path, bop):
    folder = tmp_path / "out"
    shutil.copytree(bop, folder)
    record = json.loads((folder / "manifest.json").read_text())
    del record["checksums_sha256"]
    (folder / "manifest.json").write_text(json.dumps(record))
    assert resume(folder, executor=Here()) == []
    assert sealed(folder) == sealed(bop)
    assert validate(folder) == []


@pytest.mark.parametrize("layout", ["bop", "webdataset"])
def test_resume_makes_what_is_missing_and_nothing_else(tmp_path, bop, archives, layout):
    whole = {"bop": bop, "webdataset": archives}[layout]
    folder = tmp_path / "out"
    shutil.copytree(whole, folder)
    manifest = Manifest.read(folder)
    # Ended between the shard and its checksums; and before the shard.
    (folder / manifest.checksums_name(1)).unlink()
    lost = manifest.shard_path(folder, 2)
    shutil.rmtree(lost) if lost.is_dir() else lost.unlink()
    (lost.parent / f".{lost.name}.left").mkdir()
    (lost.parent / f".{lost.name}.left" / "half").write_text("a half")
    kept = manifest.shard_path(folder, 0).stat().st_mtime_ns
    assert sorted(r.shard for r in resume(folder, executor=Here())) == [1, 2]
    assert checksums(folder) == checksums(whole)
    assert manifest.shard_path(folder, 0).stat().st_mtime_ns == kept
    assert not list(lost.parent.glob(".*"))
    assert resume(folder, executor=Here()) == []


def test_a_full_disk_leaves_no_half_shard(tmp_path, monkeypatch):
    def full(values):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(data_synth.shard, "png_bytes", full)
    with pytest.raises(OSError, match="No space left"):
        small_dataset(tmp_path)
    assert list((tmp_path / "train").iterdir()) == []
    assert [p.name for p in (tmp_path / "checksums").iterdir()] == ["models.sha256"]


def test_a_limit_on_files_is_an_error_of_the_command(tmp_path, preset_file):
    """A real write fails, in a worker process."""
    command = (
        f"ulimit -f 1; exec {sys.executable} -m data_synth generate --preset "
        f"{preset_file} --count 2 --output {tmp_path / 'out'} --workers 1"
    )
    # XLA's cache may not grow, either; and Python would keep bytecode that is cut off.
    environment = {
        **os.environ,
        "JAX_ENABLE_COMPILATION_CACHE": "false",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, env=environment
    )
    assert done.returncode == 2
    assert done.stderr.startswith("impostor-synth: error: ")
    assert "File too large" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not list((tmp_path / "out").glob("train/*"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"count": 0}, "count must be a whole number from 1"),
        ({"count": 10**9}, "count must be a whole number from 1 to 100000000"),
        ({"count": 10**7, "shard_size": 1}, "at most 1000000 shards of 1 images"),
        ({"workers": 0}, "workers must be at least 1"),
        ({"shard": 2, "num_shards": 2}, "shard must be from 0 to 1"),
    ],
)
def test_what_is_refused_leaves_no_folder(tmp_path, options, message):
    with pytest.raises(ValueError, match=message):
        small_dataset(tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_an_empty_path_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="output must be the path of a folder"):
        small_dataset("")
    assert not list(tmp_path.iterdir())


def test_resume_refuses_another_maker(tmp_path, bop):
    folder = tmp_path / "out"
    shutil.copytree(bop, folder)
    path = folder / "manifest.json"
    record = json.loads(path.read_text())
    record["made_by"]["numpy"] = "0.1"
    path.write_text(json.dumps(record))
    with pytest.raises(ValueError, match=r"numpy was '0\.1'.*allow_other_maker"):
        resume(folder, executor=Here())
    assert resume(folder, executor=Here(), allow_other_maker=True) == []


def test_rejected_scenes_are_counted_by_rule(tmp_path):
    reports = small_dataset(tmp_path, count=20)
    counts = {}
    for report in reports:
        for rule, number in report.rejected.items():
            counts[rule] = counts.get(rule, 0) + number
    assert counts
    assert set(counts) <= {
        "no_room", "camera_inside", "visible_fraction", "smallest_outline",
    }  # fmt: skip
    labels = [
        label["rejected"]
        for path in sorted(tmp_path.glob("train/*/scene_cylinders.json"))
        for label in json.loads(path.read_text()).values()
    ]
    assert sum(n for label in labels for n in label.values()) == sum(counts.values())
