"""Make a dataset, kill and resume it, and fit all of its cylinders."""

__all__ = ["Config", "measure"]

import dataclasses
import functools
import itertools
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from data_synth.batch import batch_of
from data_synth.capture import BATCH, capture_keys
from data_synth.distribution import Fixed
from data_synth.generate import generate
from data_synth.images import STAGES, Plan, captured, draw_scenes
from data_synth.manifest import Manifest
from data_synth.preset import CameraDraw, Preset, Rules
from data_synth.presets import PRESETS
from data_synth.preview import preview
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.synthetic_benchmark.report import tables
from experiments.timing import sample
from impostor_jax.evaluate import (
    Outcome,
    by_visibility,
    evaluate,
    interval_coverage,
    standardized,
    summarize,
)
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.io.atomic import write_json
from impostor_jax.io.dataset import read_dataset, read_manifest, sensor_of
from impostor_jax.io.depth_image import png_bytes, write_image
from impostor_jax.sensor.gaussian import ConstantNoise

P = TypeVar("P")
R = TypeVar("R")

PRESET = "tabletop_cans"

PICTURED = ("tabletop_cans", "hard", "inside_pipe")


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how fast datasets are made, whether a kill matters, and how fits do."""

    run: RunConfig = RunConfig()
    count: int = 1000
    """Images of the dataset."""
    workers: int = 2
    """Processes that make it."""
    repeats: int = 5
    """Times that it is made, and its pictures are coded alone, in turns."""
    others: tuple[int, ...] = (200, 3000)
    """Images of further datasets, of which the memory is measured."""
    kills: int = 20
    """Times that a run is killed and resumed."""
    eroded: int = 250
    """Images whose cylinders are fitted without the edges of their masks, too."""
    seed: int = 0
    """Of the dataset and of the moments of the kills."""


def measure(config: Config) -> Iterator[Metric]:
    """Make datasets, kill runs, fit, and draw pictures."""
    preset = _small(PRESETS[PRESET]) if config.run.quick else PRESETS[PRESET]
    # Processes share what they compile, and a second run compiles nothing.
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", tempfile.mkdtemp())
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
    assert config.run.output is not None
    with tempfile.TemporaryDirectory() as home:
        whole = Path(home) / "whole"
        yield from speed(preset, whole, config)
        yield from killed(Path(home), config)
        yield from fitted(whole, config)
        if not config.run.quick:
            picture = config.run.output / "figures" / "presets.png"
            pictures(Path(home), picture, config.seed)


def _small(preset: Preset) -> Preset:
    """Scenes of its kind in small images, which are made and fitted fast."""
    camera = CameraDraw(count=1, width=160, height=120, focal=Fixed(150.0))
    return dataclasses.replace(
        preset,
        camera=camera,
        count=Fixed(2),
        sensor=ConstantNoise(0.001),
        rules=Rules(visible_fraction=0.1, smallest_outline=100),
    )


def speed(preset: Preset, whole: Path, config: Config) -> list[Metric]:
    """Rate, what the time goes into, what coding alone would allow, and memory."""
    file, home = whole.parent / "preset.json", whole.parent
    write_json(file, preset.record())
    make = functools.partial(_made, file, config=config)
    if not config.run.quick:
        make(home / "warm", config.workers)
    n = config.count
    runs = {count: make(home / str(count), count) for count in config.others}
    # In turns, since the machine may be slower now than it was then.
    made, alone = [], []
    for repeat in range(config.repeats):
        folder = whole if repeat == 0 else home / "again"
        made.append(make(folder, n))
        alone.append(config.workers * n / _coding_seconds(folder, config.workers))
        shutil.rmtree(home / "again", ignore_errors=True)
    runs[n], coding = made[0], np.array(alone)
    rate = np.array([n / run.seconds for run in made])
    ms = {name: np.array([run.milliseconds[name] for run in made]) for name in STAGES}
    total = np.sum(list(ms.values()), axis=0)
    steady = 1e3 * config.workers / total
    part = _rendering_part(preset, config.seed)
    stages = {
        "drawing": ms["drawing"],
        "rendering": part * ms["capturing"],
        "noise": (1 - part) * ms["capturing"],
        "coding": ms["coding"],
        "writing": ms["writing"],
    }
    metrics = [
        sample("speed.rate", rate, "images/s", "higher"),
        sample("speed.rate_after_start", steady, "images/s", "higher"),
        sample("speed.rate_of_coding_alone", coding, "images/s", "higher"),
        sample("speed.rate_over_coding", rate / coding, "1", "higher"),
        sample("speed.steady_over_coding", steady / coding, "1", "higher"),
    ]
    for count in sorted(runs):
        memory = runs[count].mebibytes
        metrics.append(
            Metric(f"memory.{count}_images", memory, None, "MiB", "lower", 1)
        )
    for stage, each in stages.items():
        metrics.append(sample(f"time.{stage}", each, "ms"))
        metrics.append(sample(f"share.{stage}", each / total, "1"))
    return metrics


@dataclasses.dataclass(frozen=True)
class Made:
    """What a run of the command took: time, that of its stages, and memory.

    Attributes:
        seconds: Of the whole command.
        milliseconds: That a process spends on each image, stage by stage.
        mebibytes: Largest resident set of any of its processes.
    """

    seconds: float
    milliseconds: dict[str, float]
    mebibytes: float


def _made(preset: Path, output: Path, count: int, config: Config) -> Made:
    """Make a dataset as a user does."""
    size = -(-count // (5 * config.workers))
    words = ["--preset", str(preset), "--count", str(count), "--output", str(output)]
    words += ["--seed", str(config.seed), "--shard-size", str(size)]
    started = time.perf_counter()
    process = _command("generate", *words, config=config, stdout=subprocess.PIPE)
    assert process.stdout is not None
    with process.stdout:
        text = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - started
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    (line,) = re.findall(r"ms of a process for an image: (.*)", text)
    spent = {name: float(ms) for name, ms in map(str.split, line.split(", "))}
    return Made(seconds, spent, usage.ru_maxrss / 1024)


def _rendering_part(preset: Preset, seed: int) -> float:
    """Part of rendering in the time of rendering and noise, which are one program.

    That of scenes none of which keeps the rules, so that none is read, over that of
    the same scenes when all are.
    """
    manifest = Manifest(
        preset, "timed", BATCH, seed, BATCH, "bop", clean=True, normals=False
    )
    plan = Plan.of(manifest)
    number, attempt = np.arange(BATCH, dtype=np.uint32), np.zeros(BATCH, np.uint32)
    keys = capture_keys(plan.key, number, attempt)
    scenes = draw_scenes(plan, keys[0], range(BATCH))
    scenes = {k: scene for k, scene in scenes.items() if scene.failure is None}
    batch, least = batch_of(plan.manifest.preset, plan.cameras, scenes), []
    for rules in (Rules(1.0, 10**8), Rules(0.0, 0)):
        own = dataclasses.replace(preset, rules=rules)
        timed = dataclasses.replace(
            plan, manifest=dataclasses.replace(manifest, preset=own)
        )
        times = []
        for _ in range(10):
            started = time.perf_counter()
            captured(timed, keys[1], batch)
            times.append(time.perf_counter() - started)
        least.append(min(times))
    return least[0] / least[1]


def _coding_seconds(whole: Path, workers: int) -> float:
    """Time of all processes to code a dataset's pictures and nothing else."""
    paths = [str(path) for path in sorted(whole.glob("train/*/*/*.png"))]
    parts = [paths[k::workers] for k in range(workers)]
    return sum(_in_processes(_coded, parts))


def _in_processes(function: Callable[[P], R], parts: Sequence[P]) -> list[R]:
    """What a function makes of each part; of one alone in this process."""
    if len(parts) == 1:
        return [function(parts[0])]
    with ProcessPoolExecutor(len(parts), get_context("spawn")) as pool:
        return list(pool.map(function, parts))


def _coded(paths: Sequence[str]) -> float:
    seconds = 0.0
    for path in paths:
        picture = cv2.imread(path, cv2.IMREAD_UNCHANGED)
        assert picture is not None
        started = time.perf_counter()
        png_bytes(picture)
        seconds += time.perf_counter() - started
    return seconds


def killed(home: Path, config: Config) -> Iterator[Metric]:
    """How often a run that was killed and resumed gives the bytes of one that was not.

    Every other kill is of the process that a user sees alone, the rest of all at once.
    """
    rng = np.random.default_rng(config.seed)
    preset, whole, folder = home / "preset.json", home / "unkilled", home / "killed"
    write_json(preset, _small(PRESETS[PRESET]).record())
    words = [
        *("--preset", str(preset), "--count", str(config.count)),
        *("--seed", str(config.seed), "--shard-size", str(-(-config.count // 50))),
    ]
    seconds = 0.0
    for _ in range(1 if config.run.quick else 2):
        # The second time nothing is compiled, as in the runs that are killed.
        shutil.rmtree(whole, ignore_errors=True)
        started = time.perf_counter()
        made = _command("generate", *words, "--output", str(whole), config=config)
        assert made.wait() == 0
        seconds = time.perf_counter() - started
    equal, done, shards = 0, [], _num_shards(whole)
    for trial in range(config.kills):
        words_there = [*words, "--output", str(folder)]
        process = _command("generate", *words_there, config=config)
        time.sleep(rng.uniform(0, seconds))
        if trial % 2:
            os.kill(process.pid, signal.SIGKILL)
        else:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        _wait_for_group(process.pid)
        done.append(_num_shards(folder) / shards)
        # Killed before the manifest: nothing was begun, nothing is there to resume.
        begun = (folder / "manifest.json").exists()
        again = ["resume", str(folder)] if begun else ["generate", *words_there]
        assert _command(*again, config=config).wait() == 0
        equal += _checksums(folder) == _checksums(whole)
        shutil.rmtree(folder)
    n = config.kills
    yield Metric("killed.equal", equal / n, None, "1", "higher", n)
    middle, spread = float(np.mean(done)), float(np.std(done))
    yield Metric("killed.done_before", middle, spread, "1", "higher", n)


def _command(
    name: str, *words: str, config: Config, stdout: int = subprocess.DEVNULL
) -> subprocess.Popen:
    return subprocess.Popen(
        [
            *(sys.executable, "-m", "data_synth", name, *words),
            *("--workers", str(config.workers)),
        ],
        start_new_session=True,
        stdout=stdout,
        text=True,
    )


def _wait_for_group(group: int) -> None:
    """Wait until the workers have noticed that their parent is gone."""
    while True:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)


def _checksums(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.glob("checksums/*")}


def _num_shards(folder: Path) -> int:
    return len(list(folder.glob("checksums/[0-9]*")))


def fitted(whole: Path, config: Config) -> Iterator[Metric]:
    """Errors against visibility, and coverage of the intervals."""
    step = config.workers
    for name, erode_px in (("fit", 0), ("eroded", 1)):
        most = config.eroded if erode_px else config.count
        parts = [(whole, erode_px, most, first, step) for first in range(step)]
        found = _in_processes(_fitted_part, parts)
        outcomes = [outcome for part, _ in found for outcome in part]
        times = [milliseconds for _, part in found for milliseconds in part]
        yield sample(f"{name}.time", times, "ms")
        for label, some in [("all", outcomes), *by_visibility(outcomes).items()]:
            yield from _summary(f"{name}.{label}", some)
        good = [outcome for outcome in outcomes if outcome.success]
        for coordinate in CYLINDER.coordinates:
            scaled = standardized(good, coordinate)
            label = f"{name}.{coordinate}"
            yield from _levels(label, interval_coverage(scaled), scaled.size)


def _fitted_part(
    part: tuple[Path, int, int, int, int],
) -> tuple[list[Outcome], list[float]]:
    """Outcomes of every so many of a dataset's images, and milliseconds a fit."""
    whole, erode_px, most, first, step = part
    sensor = sensor_of(read_manifest(whole))
    images = itertools.islice(read_dataset(whole), first, most, step)
    outcomes: list[Outcome] = []
    times, started = [], time.perf_counter()
    for some in evaluate(images, sensor, erode_px):
        outcomes += some
        ended = time.perf_counter()
        times.append(1e3 * (ended - started) / max(len(some), 1))
        started = ended
    return outcomes, times


def _summary(label: str, outcomes: Sequence[Outcome]) -> Iterator[Metric]:
    s, n = summarize(outcomes), len(outcomes)
    yield Metric(f"{label}.number", n, None, "fits", "higher", n)
    yield Metric(f"{label}.failures", s.failures, None, "fits", "lower", n)
    yield Metric(f"{label}.wrong", s.wrong, None, "fits", "lower", n)
    for name, unit in (
        ("radius_mm", "mm"),
        ("axis_deg", "deg"),
        ("center_mm", "mm"),
        ("height_mm", "mm"),
        ("spread", "1"),
    ):
        value = getattr(s, name)
        known = float(value) if np.isfinite(value) else None
        yield Metric(f"{label}.{name}", known, None, unit, "lower", n)
    yield from _levels(f"{label}.coverage", s.interval_coverage, n)


def _levels(label: str, parts: dict[str, float], n: int) -> Iterator[Metric]:
    """Shares of errors within the intervals, with the standard error of n of them."""
    for level, part in parts.items():
        known = part if np.isfinite(part) else None
        yield Metric.share(f"{label}.{level}", known, n)


def pictures(home: Path, output: Path, seed: int) -> None:
    """Draw four images each of some presets."""
    sheets = []
    for name in PICTURED:
        generate(name, 4, home / name, seed, workers=1)
        preview(home / name, home / f"{name}.png", 4)
        sheets.append(cv2.imread(str(home / f"{name}.png")))
    write_image(output, np.hstack(sheets))


if __name__ == "__main__":
    trial = Config(count=4, workers=1, repeats=1, others=(), kills=1, eroded=1)
    main(Config, measure, tables, trial)
