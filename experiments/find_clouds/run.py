"""Search clouds with known cylinders, and score what is found."""

__all__ = ["Config", "measure"]

import dataclasses
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import impostor_jax as ij
from experiments.find_accuracy.program import MissingProgramError
from experiments.find_clouds.programs import ONLY, OURS, PROGRAMS
from experiments.find_clouds.report import tables
from experiments.find_clouds.scenes import KINDS, draw_cloud
from experiments.fitting import inside, rmse
from experiments.recording import Metric
from experiments.running import RunConfig, main
from impostor_jax.caching import keep_compiled
from impostor_jax.matching import (
    RIGHT,
    Comparison,
    Detection,
    Truth,
    compare,
    score_of,
)

SIZES = (10_000, 100_000, 1_000_000)
"""Points of the clouds whose search is timed."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how well cylinders are found in clouds."""

    run: RunConfig = RunConfig()
    count: int = 20
    """Clouds of each kind."""
    seed: int = 100
    """Of the first."""
    workers: int = 2
    """Processes that search."""
    programs: tuple[str, ...] = tuple(PROGRAMS)
    """That search: any of these."""
    kinds: tuple[str, ...] = tuple(KINDS)
    """That are searched: any of these."""


def measure(config: Config) -> Iterator[Metric]:
    """Score all programs on all kinds of clouds, then time ours."""
    keep_compiled()
    programs = list(config.programs)
    pooled: dict[str, list[Comparison]] = {program: [] for program in programs}
    for kind in config.kinds:
        for program in tuple(programs):
            if kind not in ONLY.get(program, KINDS):
                continue
            seeds = range(config.seed, config.seed + config.count)
            jobs = [(program, kind, seed, config.run.quick) for seed in seeds]
            try:
                results = _searched(jobs, config.workers)
            except MissingProgramError as missing:
                print(f"{program} is left out: {missing}")
                programs.remove(program)
                continue
            truths, found, seconds = zip(*results, strict=True)
            compared = [compare(*pair) for pair in zip(truths, found, strict=True)]
            pooled[program] += compared
            label = f"{program}.{kind}"
            yield from _scores(label, compared)
            yield from _errors(label, truths, found, compared)
            yield Metric(
                f"{label}.seconds",
                float(np.median(seconds)),
                None,
                "s",
                "lower",
                len(seconds),
            )
    for program in programs:
        # Some are for other kinds alone.
        if not (compared := pooled[program]):
            continue
        error = score_of(compared).calibration.error
        known = None if np.isnan(error) else float(error)
        n = sum(len(one.confidence) for one in compared)
        yield Metric(f"{program}.calibration_error", known, None, "1", "lower", n)
    yield from _times(config)


Job = tuple[str, str, int, bool]
"""Program, kind and seed of a cloud, and whether it is a small one."""


def _searched(
    jobs: Sequence[Job], workers: int
) -> list[tuple[Truth, list[Detection], float]]:
    if workers == 1:
        return [_search(job) for job in jobs]
    with ProcessPoolExecutor(workers) as pool:
        return list(pool.map(_search, jobs))


def _search(job: Job) -> tuple[Truth, list[Detection], float]:
    """What is in a cloud, what is found there, and in how long."""
    keep_compiled()
    program, kind, seed, is_small = job
    cloud = draw_cloud(kind, seed, is_small)
    start = time.perf_counter()
    found = list(PROGRAMS[program](cloud))
    return cloud.truth, found, time.perf_counter() - start


def _scores(label: str, compared: Sequence[Comparison]) -> Iterator[Metric]:
    score, n = score_of(compared), len(compared)
    for level, value in score.average_precision.items():
        known = None if np.isnan(value) else float(value)
        yield Metric(f"{label}.ap.{level}", known, None, "1", "higher", n)
    recall = score.recall["standard"]
    known = None if np.isnan(recall) else float(recall)
    yield Metric.share(f"{label}.recall", known, max(score.num_truths, 1))
    false = float(score.sure_false_per_image["standard"])
    yield Metric(f"{label}.false", false, None, "1/cloud", "lower", n)
    yield Metric(f"{label}.truths", float(score.num_truths), None, "1", "higher", n)


def _errors(
    label: str,
    truths: Sequence[Truth],
    found: Sequence[Sequence[Detection]],
    compared: Sequence[Comparison],
) -> Iterator[Metric]:
    """Errors of the radii of what is right, and whether intervals hold them."""
    off, deviation = [], []
    for truth, own, one in zip(truths, found, compared, strict=True):
        matches = one.matches["standard"]
        for k in np.flatnonzero(matches.verdict == RIGHT).tolist():
            off.append(own[k].radius - truth.radius[matches.truth[k]])
            deviation.append(own[k].radius_std)
    if not off:
        return
    errors, told = np.array(off), np.array(deviation)
    yield rmse(f"{label}.radius", errors, "mm", 1e3)
    if np.all(np.isfinite(told)):
        yield inside(f"{label}.inside", errors, told)


def _times(config: Config) -> Iterator[Metric]:
    """How long a search of a forest takes, by the number of its points."""
    cloud = draw_cloud("forest", config.seed, config.run.quick)
    order = np.random.default_rng(0).permutation(len(cloud.points))
    for size in SIZES:
        own = order[:size]
        points, origins = cloud.points[own], cloud.origins[own]
        ij.find_cylinders_in_points(points, origins)
        start = time.perf_counter()
        found = ij.find_cylinders_in_points(points, origins)
        seconds = time.perf_counter() - start
        label = f"{OURS}.forest of {len(own)}"
        yield Metric(f"{label}.warm", seconds, None, "s", "lower", 1)
        yield Metric(f"{label}.found", len(found), None, "1", "higher", 1)


if __name__ == "__main__":
    quick = Config(count=1, workers=1, kinds=("table",))
    main(Config, measure, tables, quick)
