"""Fit walls whose readings err across their rays, and see whether intervals hold."""

__all__ = ["Config", "measure"]

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from experiments.cross_ray_noise.programs import OURS, PRACTICE, Program
from experiments.cross_ray_noise.report import tables
from experiments.cross_ray_noise.scenes import KINDS, SIZES, Wall, draw_wall
from experiments.fitting import bias, in_turn, inside
from experiments.recording import Metric
from experiments.running import RunConfig, main


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure what errors across the rays do to a radius."""

    run: RunConfig = RunConfig()
    seeds: int = 48
    """Walls of each case."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """Every kind of error, reader and size."""
    if config.run.quick:
        yield from _compared("image", "small", "all directions", config)
        return
    for reader, kinds in KINDS.items():
        for size in SIZES[reader]:
            for kind in kinds:
                yield from _compared(reader, size, kind, config)


def _compared(reader: str, size: str, kind: str, config: Config) -> Iterator[Metric]:
    """What every program makes of the same walls."""
    # Of each case its own, so that cases are independent.
    rng = np.random.default_rng([config.seed, *f"{reader} {size} {kind}".encode()])
    walls = [draw_wall(reader, size, kind, rng) for _ in range(config.seeds)]
    for name, program in {**OURS, **PRACTICE}.items():
        # One who knows that rays are exact tells so.
        if not (kind == "exact" and name == "told"):
            yield from _found_by(f"{reader}.{size}.{kind}.{name}", program, walls)


def _found_by(label: str, program: Program, walls: Sequence[Wall]) -> Iterator[Metric]:
    """Failures and time, mean error, bias over the spread, intervals that hold."""
    said, median = in_turn(program, walls)
    errors, deviations = [], []
    for wall, estimate in zip(walls, said, strict=True):
        if estimate is not None:
            errors.append(estimate.radius - wall.radius)
            deviations.append(estimate.deviation)
    total, n, off = len(walls), len(errors), np.array(errors)
    yield Metric.share(f"{label}.failures", 1 - n / total, total, "lower")
    yield Metric(f"{label}.time", median, None, "ms", "lower", total)
    if n > 1:
        spread = float(np.std(off)) / n**0.5
        yield Metric(f"{label}.mean", float(np.mean(off)), spread, "m", "lower", n)
        yield bias(f"{label}.bias", off)
        yield inside(f"{label}.inside", off, np.array(deviations))


if __name__ == "__main__":
    main(Config, measure, tables, Config(seeds=2))
