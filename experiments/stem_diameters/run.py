"""Measure diameters of stems in laser scans, beside circles and other programs."""

__all__ = ["Config", "measure"]

import dataclasses
import importlib.util
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from data_synth.presets import PRESETS
from data_synth.roughness import Roughness
from experiments.errors import joint_bound
from experiments.find_accuracy.program import MissingProgramError
from experiments.fitting import in_turn, inside, over_bound, rmse
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.stem_diameters.programs import (
    OURS,
    PEERS,
    PRACTICE,
    Estimate,
    Program,
)
from experiments.stem_diameters.report import tables
from experiments.stem_diameters.stems import Scan, draw_scan
from impostor_jax.fit.fittable import CYLINDER

DISTANCES = (5.0, 10.0, 20.0, 30.0)
"""Of the stems, in meters."""

NOISE_MM = (2, 5, 20)
"""Standard deviation of a range, in millimeters."""

BARK_DISTANCE, BARK_MM = 10.0, 2
"""Distance and noise of stems with bark."""

BARK = PRESETS["tree_scan"].roughness

RADIUS = CYLINDER.coordinates.index("radius")

GROSS = 0.5
"""Part of its diameter by which an estimate is off that counts as a failure."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how exactly scans tell the diameters of stems."""

    run: RunConfig = RunConfig()
    seeds: int = 60
    """Stems of each case."""
    peer_seeds: int = 8
    """Stems of each case that the other programs fit."""
    bark_seeds: int = 12
    """Stems with bark: a fit of one takes seconds."""
    bounded: int = 60
    """Stems of each case whose bound is computed."""
    peers: bool = True
    """Whether other programs fit, too."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """All distances and noises, and stems with bark.

    Raises:
        ValueError: The other programs are not installed.
    """
    if config.peers and importlib.util.find_spec("cylfit") is None:
        raise ValueError(
            "the other programs are not installed: pip install '.[bench]', or leave "
            "them out with --no-peers"
        )
    if config.run.quick:
        yield from _compared("30m.5mm", 30.0, 5, None, config)
        return
    for distance in DISTANCES:
        for noise_mm in NOISE_MM:
            label = f"{distance:.0f}m.{noise_mm}mm"
            yield from _compared(label, distance, noise_mm, None, config)
    few = dataclasses.replace(config, seeds=config.bark_seeds)
    label = f"bark.{BARK_DISTANCE:.0f}m.{BARK_MM}mm"
    yield from _compared(label, BARK_DISTANCE, BARK_MM, BARK, few)


def _compared(
    label: str, distance: float, noise_mm: int, bark: Roughness | None, config: Config
) -> Iterator[Metric]:
    """What every program makes of the same stems."""
    rng = np.random.default_rng(config.seed)
    sigma = noise_mm / 1e3
    scans = [draw_scan(distance, sigma, bark, rng) for _ in range(config.seeds)]
    # Of stems with bark the bound is unknown, and neighbors err together there alone.
    bounds = [] if bark else [_bounds(scan) for scan in scans[: config.bounded]]
    for name, program in OURS.items():
        if bark or name != "correlated":
            found = _found_by(program, scans)
            yield from found.accuracy(f"{label}.{name}")
            yield from found.honesty(f"{label}.{name}", bounds)
    for name, program in PRACTICE.items():
        yield from _found_by(program, scans).accuracy(f"{label}.{name}")
    for name, program in PEERS.items() if config.peers else ():
        try:
            found = _found_by(program, scans[: config.peer_seeds])
        except MissingProgramError as missing:
            print(missing)
            continue
        yield from found.accuracy(f"{label}.{name}")


def _bounds(scan: Scan) -> tuple[float, float]:
    """Least deviation of a diameter, and what grazing readings leave reachable."""
    views, cameras = [scan.view], [scan.camera]
    least, reachable = (
        2 * float(joint_bound(views, cameras, reachable=is_reachable)[RADIUS])
        for is_reachable in (False, True)
    )
    return least, reachable


@dataclasses.dataclass(frozen=True)
class Found:
    """What a program says of some stems.

    Attributes:
        errors: Of the diameters, in meters; NaN where it failed.
        deviations: Of the diameters, as reported, in meters.
        milliseconds: Median time.
    """

    errors: Float[np.ndarray, " n"]
    deviations: Float[np.ndarray, " n"]
    milliseconds: float

    def accuracy(self, label: str) -> Iterator[Metric]:
        """Failures and time, root mean square and mean of the errors."""
        total, off = len(self.errors), self.errors[np.isfinite(self.errors)]
        n = len(off)
        yield Metric.share(f"{label}.failures", 1 - n / total, total, "lower")
        yield Metric(f"{label}.time", self.milliseconds, None, "ms", "lower", total)
        if n:
            yield rmse(f"{label}.rmse", off, "m")
            mean, spread = float(np.mean(off)), float(np.std(off)) / n**0.5
            yield Metric(f"{label}.bias", mean, spread, "m", "lower", n)

    def honesty(
        self, label: str, bounds: Sequence[tuple[float, float]]
    ) -> Iterator[Metric]:
        """Errors over the bounds of the first stems, and intervals that hold."""
        good = np.isfinite(self.errors)
        if np.any(good):
            yield inside(f"{label}.inside", self.errors[good], self.deviations[good])
        for name, least in zip(
            ("over_bound", "over_reachable"), zip(*bounds, strict=True), strict=False
        ):
            # Those of thin and of thick stems differ by far: each error by its own.
            over = self.errors[: len(least)] / np.array(least)
            over = over[np.isfinite(over)]
            if len(over):
                yield over_bound(f"{label}.{name}", over, np.ones_like(over))


def _found_by(program: Program, scans: Sequence[Scan]) -> Found:
    """Run a program; what is off by far counts as a failure."""
    said, median = in_turn(program, scans)
    errors, deviations = [], []
    for scan, one in zip(scans, said, strict=True):
        estimate = one or Estimate(np.nan)
        error = estimate.diameter - scan.diameter
        errors.append(error if abs(error) < GROSS * scan.diameter else np.nan)
        deviations.append(estimate.deviation)
    return Found(np.array(errors), np.array(deviations), median)


if __name__ == "__main__":
    main(Config, measure, tables, Config(seeds=2, bounded=1, peers=False))
