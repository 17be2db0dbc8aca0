"""Measure what errors across the ray do to fits of images, scans and points."""

__all__ = ["Config", "measure"]

import dataclasses
import time
from collections.abc import Iterator, Sequence

import numpy as np

from experiments.cross_ray_noise.programs import (
    PROGRAMS,
    Estimate,
    Program,
    is_for,
)
from experiments.cross_ray_noise.report import draw, tables
from experiments.cross_ray_noise.scenes import CASES, Case, Reading, read
from experiments.recording import Metric
from experiments.running import RunConfig, main

NORMAL_95 = 1.96
"""Half the width of the 95 percent interval of a normal deviate."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how far off radii are whose readings err across their rays."""

    run: RunConfig = RunConfig()
    seeds: int = 10
    """Readings of each case."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """All sources, kinds of error and sizes."""
    cases = CASES[1:2] + CASES[-1:] if config.run.quick else CASES
    for case in cases:
        rng = np.random.default_rng(config.seed)
        readings = [read(case, rng) for _ in range(config.seeds)]
        if case.told is not None:
            far = float(np.linalg.norm(readings[0].points[0] - readings[0].origin))
            true = float(np.hypot(case.across, case.angle * far))
            yield Metric(f"{case.label}.across", true, None, "m", "lower", 1)
        for name, program in PROGRAMS.items():
            if is_for(name, case):
                yield from _judged(f"{case.label}.{name}", program, case, readings)


def _judged(
    label: str, program: Program, case: Case, readings: Sequence[Reading]
) -> Iterator[Metric]:
    """Failures, time, errors and intervals of a program."""
    program(case, readings[0])  # compiles, which takes no part in its time
    found, seconds = [], []
    for reading in readings:
        start = time.perf_counter()
        found.append(program(case, reading) or Estimate(np.nan))
        seconds.append(time.perf_counter() - start)
    radius, deviation, across = np.array(found).T
    off = radius - case.radius
    good = np.isfinite(off)
    n, total = int(np.count_nonzero(good)), len(off)
    yield Metric.share(f"{label}.failures", 1 - n / total, total, "lower")
    milliseconds = 1e3 * float(np.median(seconds))
    yield Metric(f"{label}.time", milliseconds, None, "ms", "lower", total)
    if not n:
        return
    off, deviation, across = off[good], deviation[good], across[good]
    rms, mean, spread = map(float, (np.sqrt(np.mean(off**2)), off.mean(), off.std()))
    yield Metric(f"{label}.rmse", rms, rms / (2 * n) ** 0.5, "m", "lower", n)
    yield Metric(f"{label}.bias", mean, spread / n**0.5, "m", "lower", n)
    over = mean / max(spread, 1e-12)
    yield Metric(f"{label}.bias_over_spread", over, n**-0.5, "1", "lower", n)
    if np.all(np.isfinite(deviation)):
        inside = float(np.mean(np.abs(off) <= NORMAL_95 * deviation))
        yield Metric.share(f"{label}.inside", inside, n)
    if np.all(np.isfinite(across)):
        median, scatter = float(np.median(across)), float(across.std())
        yield Metric(f"{label}.across", median, scatter, "m", "lower", n)


if __name__ == "__main__":
    main(Config, measure, draw, tables, Config(seeds=3))
