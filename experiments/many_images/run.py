"""Search a dataset in one process, in several and by dask, and kill what does it."""

__all__ = ["Config", "measure"]

import contextlib
import dataclasses
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from distributed import LocalCluster

from data_synth.distribution import Fixed
from data_synth.generate import generate
from data_synth.preset import CameraDraw, Preset, Rules
from data_synth.presets import PRESETS
from experiments.many_images.report import tables
from experiments.recording import Metric
from experiments.running import RunConfig, main
from impostor_jax.io.atomic import write_json
from impostor_jax.io.dataset import read_manifest, sensor_of
from impostor_jax.io.sensor_record import sensor_record
from impostor_jax.many.results import read_results
from impostor_jax.sensor.gaussian import ConstantNoise

PRESET = "tabletop_cans"

PART = "quarter"
"""Name of a smaller dataset, on which what is no rate is tried."""

TOLD = ("seconds",)
"""Columns that differ from run to run."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure the rate of many images, and whether a kill or broken files matter."""

    run: RunConfig = RunConfig()
    count: int = 400
    """Images of the dataset."""
    broken: int = 10
    """Images of it whose files are cut short."""
    kills: int = 3
    """Times that a worker is killed, and times that a whole run is."""
    seed: int = 0
    """Of the dataset, of the broken images and of the moments of the kills."""


class Ran(NamedTuple):
    """What came of a command.

    Attributes:
        code: Its exit code.
        seconds: That it took.
        mebibytes: Largest resident set of any of its processes.
        results: The table, a column each.
        bytes: Of the table's file.
    """

    code: int
    seconds: float
    mebibytes: float
    results: dict[str, np.ndarray]
    bytes: int


def measure(config: Config) -> Iterator[Metric]:
    """Make a dataset, then search it in all these ways."""
    preset = _small(PRESETS[PRESET]) if config.run.quick else PRESETS[PRESET]
    # Processes share what they compile.
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", tempfile.mkdtemp())
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        for part, count in (("whole", config.count), (PART, config.count // 4)):
            generate(preset, count, home / part, config.seed, clean=False, workers=2)
        sensor = sensor_of(read_manifest(home / "whole"))
        write_json(home / "sensor.json", sensor_record(sensor))
        _ran(home, PART)
        few, whole = _ran(home, PART), _ran(home, "whole")
        yield from _rates("one", whole, config.count)
        yield _memory(PART, few)
        yield _memory("whole", whole)
        yield from _rates("two", two := _ran(home, "whole", workers=2), config.count)
        yield _equal("two", whole, two)
        cluster = LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0"
        )
        with cluster:
            dask = _ran(home, "whole", "--dask", cluster.scheduler_address)
        yield from _rates("dask", dask, config.count)
        yield _equal("dask", whole, dask)
        parquet = _ran(home, PART, workers=2, ending=".parquet")
        rows = len(few.results["image"])
        yield Metric("bytes.csv", few.bytes / rows, None, "bytes", "lower", rows)
        size = parquet.bytes / rows
        yield Metric("bytes.parquet", size, None, "bytes", "lower", rows)
        few = _ran(home, PART, workers=2)
        yield from _killed(home, few, config)
        yield from _broken(home, few, config)


def _small(preset: Preset) -> Preset:
    """Scenes of its kind in small images, which are made and searched fast."""
    camera = CameraDraw(count=1, width=160, height=120, focal=Fixed(150.0))
    return dataclasses.replace(
        preset,
        camera=camera,
        count=Fixed(1),
        sensor=ConstantNoise(0.001),
        rules=Rules(visible_fraction=0.1, smallest_outline=100),
    )


def _command(home: Path, dataset: str, *more: str, table: str) -> subprocess.Popen:
    """Begin the command in a process group of its own."""
    words = ["find", str(home / dataset), "--sensor", str(home / "sensor.json")]
    words += ["--only-table", "--output", str(home / "out"), "--table", table]
    command = [sys.executable, "-m", "impostor_jax", *words, *more]
    return subprocess.Popen(
        command,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _ran(
    home: Path, dataset: str, *more: str, workers: int = 1, ending: str = ".csv"
) -> Ran:
    """Run the command from its start to its end."""
    if "--dask" not in more:
        more = (*more, "--workers", str(workers))
    table, started = home / f"results{ending}", time.perf_counter()
    process = _command(home, dataset, *more, table=str(table))
    return _ended(process, table, started)


def _ended(process: subprocess.Popen, table: Path, started: float) -> Ran:
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - started
    process.returncode = os.waitstatus_to_exitcode(status)
    results = read_results(table) if process.returncode >= 0 else {}
    size = table.stat().st_size if table.exists() else 0
    mebibytes = usage.ru_maxrss / 1024
    return Ran(process.returncode, seconds, mebibytes, results, size)


def _rates(name: str, ran: Ran, count: int) -> list[Metric]:
    hours = ran.seconds / 3600
    return [
        Metric(f"rate.{name}", count / hours, None, "images/h", "higher", 1),
        Metric(f"start.{name}", ran.seconds, None, "s", "lower", 1),
    ]


def _memory(name: str, ran: Ran) -> Metric:
    return Metric(f"memory.{name}", ran.mebibytes, None, "MiB", "lower", 1)


def _same(one: Ran, other: Ran, rows: np.ndarray | None = None) -> float:
    """Part of the rows of a table that another has at their places."""
    if {*one.results} != {*other.results}:
        return 0.0
    same = np.ones(len(one.results["image"]), bool)
    for name, values in one.results.items():
        if name not in TOLD:
            others = other.results[name]
            if len(others) != len(values):
                return 0.0
            pairs = zip(values, others, strict=True)
            same &= [np.array_equal(a, b, equal_nan=_is_number(a)) for a, b in pairs]
    return float(np.mean(same if rows is None else same[rows]))


def _is_number(value: object) -> bool:
    return np.issubdtype(np.asarray(value).dtype, np.floating)


def _equal(name: str, one: Ran, other: Ran) -> Metric:
    rows = len(one.results["image"])
    return Metric(f"equal.{name}", _same(one, other), None, "1", "higher", rows)


def _killed(home: Path, whole: Ran, config: Config) -> Iterator[Metric]:
    """Kill a worker, or all, at moments drawn evenly over the time of a run."""
    rng = np.random.default_rng(config.seed)
    table = home / "results.csv"
    equal: dict[str, list[float]] = {"worker": [], "run": []}
    for kind, parts in equal.items():
        for _ in range(config.kills):
            # What is not begun cannot be killed.
            moment = rng.uniform(0.3, 0.9) * whole.seconds
            started = time.perf_counter()
            process = _command(home, PART, "--workers", "2", table=str(table))
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(moment)
            if kind == "run":
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
                ran = _ran(home, PART, "--resume", workers=2)
            else:
                os.kill(_workers_of(process.pid)[-1], signal.SIGKILL)
                ran = _ended(process, table, started)
            parts.append(_same(whole, ran))
        share = float(np.mean(np.array(parts) == 1))
        yield Metric.share(f"killed.{kind}.equal", share, config.kills)


def _workers_of(pid: int) -> list[int]:
    """Processes that a process began, the last one last."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    return [int(child) for child in children.split()]


def _broken(home: Path, whole: Ran, config: Config) -> Iterator[Metric]:
    """Cut images short, and compare the rows of the others."""
    folder = shutil.copytree(home / PART, home / "broken")
    images = sorted(folder.glob("train/*/depth/*.png"))
    rng = np.random.default_rng(config.seed)
    for number in rng.choice(len(images), config.broken, replace=False):
        images[number].write_bytes(images[number].read_bytes()[:1000])
    ran = _ran(home, "broken", workers=2)
    failed = ran.results["status"] == "failed"
    bad = {*ran.results["image"][failed]}
    names = whole.results["image"]
    left = Ran(0, 0, 0, _rows(whole, [name not in bad for name in names]), 0)
    kept = Ran(0, 0, 0, _rows(ran, ~failed), 0)
    yield Metric("broken.failed", len(bad), None, "images", "higher", config.broken)
    yield Metric("broken.code", ran.code, None, "1", "lower", 1)
    same, count = _same(left, kept), len(kept.results["image"])
    yield Metric("broken.equal", same, None, "1", "higher", count)


def _rows(ran: Ran, which: object) -> dict[str, np.ndarray]:
    return {k: v[np.asarray(which)] for k, v in ran.results.items() if k != "reason"}


TRIAL = Config(count=8, broken=1, kills=1)

if __name__ == "__main__":
    main(Config, measure, tables, TRIAL)
