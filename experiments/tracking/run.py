"""Follow cans through videos: identities, intervals, and time."""

__all__ = ["Config", "measure"]

import dataclasses
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import impostor_jax as ij
from data_synth.distribution import Fixed
from data_synth.generate import generate
from data_synth.presets import PRESETS
from experiments.fitting import inside, rmse
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.tracking.real_time import real_time, times, track_of
from experiments.tracking.report import COMPARED, tables
from experiments.tracking.scenes import CAMERA, hidden_video, table_video
from impostor_jax.evaluate_tracks import evaluate_tracks, score_tracks, track_errors

SIGMA = 1e-3

SCALES = {"white": 0.0, "scale": 0.01}
"""Deviation of the scale of a video."""

HIDDEN = 20
"""Images for which a can is hidden."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how cylinders are followed."""

    run: RunConfig = RunConfig()
    videos: int = 12
    """Of each case."""
    images: int = 40
    """Of a video."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """Intervals by sensor, identities, and times."""
    cases = list(SCALES)[:1] if config.run.quick else list(SCALES)
    for case in cases:
        yield from _intervals(case, config)
    yield _hidden(config)
    rng = np.random.default_rng(config.seed)
    yield from real_time(list(table_video(4 * config.images, SIGMA, 0.0, rng)), SIGMA)
    if not config.run.quick:
        yield from _drawn(config)
        yield from _times(config)


def _intervals(case: str, config: Config) -> Iterator[Metric]:
    """Errors of the tracks of cans on a table, in the last image of each video."""
    scale, noise = SCALES[case], ij.ConstantNoise(SIGMA)
    sensor = ij.ScaleError(noise, scale) if scale else noise
    errors: dict[str, list[float]] = {name: [] for name in COMPARED}
    told: dict[str, list[float]] = {name: [] for name in COMPARED}
    falls, num_cans = [], 0
    for seed in range(config.videos):
        rng = np.random.default_rng([config.seed, seed])
        tracker = ij.Tracker(CAMERA, sensor)
        first: dict[int, float] = {}
        tracks, cans = (), []
        for frame in table_video(config.images, SIGMA, scale * rng.normal(), rng):
            tracks = tracker.step(
                frame.depth, camera_from_world=frame.camera_from_world
            )
            cans = frame.cans
            for track in tracks:
                first.setdefault(track.identity, float(track.std.radius))
        num_cans += len(cans)
        for can in cans:
            track = track_of(can, tracks)
            if track is None:
                continue
            falls.append(float(track.std.radius) / first[track.identity])
            off, deviation = track_errors(track, can)
            for name in off:
                errors[name].append(off[name])
                told[name].append(deviation[name])
    label = f"intervals.{case}"
    missed = num_cans - len(errors["radius"])
    yield Metric(f"{label}.missed", missed, None, "cans", "lower", num_cans)
    for name in COMPARED:
        off = np.array(errors[name])
        yield inside(f"{label}.{name}.inside", off, np.array(told[name]))
        unit = "rad" if name.startswith("axis") else "m"
        yield rmse(f"{label}.{name}.rms", off, unit)
    fall = float(np.median(falls))
    yield Metric(f"{label}.radius.fall", fall, None, "1", "lower", len(falls))


def _hidden(config: Config) -> Metric:
    """Share of cans that have their identity after they were hidden."""
    kept = []
    for seed in range(config.videos):
        rng = np.random.default_rng([config.seed, 1, seed])
        tracker = ij.Tracker(CAMERA, SIGMA)
        first = last = None
        for frame in hidden_video(6, HIDDEN, 4, SIGMA, rng):
            track = track_of(frame.cans[0], tracker.step(frame.depth))
            last = None if track is None else track.identity
            first = last if first is None else first
        kept.append(last is not None and last == first)
    return Metric.share("hidden.kept", float(np.mean(kept)), len(kept))


def _drawn(config: Config) -> Iterator[Metric]:
    """Counts of tracks of drawn videos, which a whole sensor has read."""
    base = PRESETS["tabletop_cans"]
    for case, clutter in (("tabletop", 0), ("tabletop_clutter", 1)):
        preset = dataclasses.replace(base, clutter=Fixed(clutter))
        count = max(2, config.videos // 2) * config.images
        with tempfile.TemporaryDirectory() as folder:
            generate(
                preset, count, Path(folder) / case, config.seed,
                sequence=config.images, clean=False, workers=1,
            )  # fmt: skip
            images = ij.read_dataset(Path(folder) / case)
            score = score_tracks(evaluate_tracks(images, preset.sensor))
        label, n = f"videos.{case}", score.num_truths
        yield Metric(f"{label}.truths", n, None, "1", "higher", score.num_images)
        yield Metric.share(f"{label}.missed", score.num_missed / n, n, "lower")
        yield Metric(f"{label}.false", score.num_false, None, "1", "lower", n)
        yield Metric(f"{label}.switches", score.num_switches, None, "1", "lower", n)
        yield Metric(f"{label}.mota", score.mota, None, "1", "higher", n)
        for name in ("radius", "center_first"):
            share = score.coverage.get(name)
            yield Metric.share(f"{label}.{name}.inside", share, n)


def _times(config: Config) -> Iterator[Metric]:
    """Time of an image with four cans: tracked, searched, and found alone."""
    rng = np.random.default_rng(config.seed)
    frames = list(table_video(4 * config.images, SIGMA, 0.0, rng))
    spent: dict[str, list[float]] = {"tracked": [], "searched": []}
    every = 15
    for _ in range(2):
        # The first time programs are compiled.
        spent = {"tracked": [], "searched": []}
        tracker = ij.Tracker(CAMERA, SIGMA, search_every=every)
        for k, frame in enumerate(frames):
            start = time.perf_counter()
            tracker.step(frame.depth, camera_from_world=frame.camera_from_world)
            name = "tracked" if k % every else "searched"
            spent[name].append(time.perf_counter() - start)
    spent["find_cylinders"] = []
    for frame in frames[:12]:
        start = time.perf_counter()
        ij.find_cylinders(frame.depth, CAMERA, SIGMA)
        spent["find_cylinders"].append(time.perf_counter() - start)
    for name, seconds in spent.items():
        yield from times(f"time.{name}", seconds)


if __name__ == "__main__":
    main(Config, measure, tables, Config(videos=1, images=3))
