"""Fit a can to one, two and four views around it, and compare with the joint bound."""

__all__ = ["Config", "measure"]

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from experiments.errors import error
from experiments.fit_views.report import COMPARED, tables
from experiments.fit_views.scenes import Around, draw_around
from experiments.fitting import bias, inside, over_bound, rmse
from experiments.recording import Metric
from experiments.running import RunConfig, main
from impostor_jax.fit.fittable import CYLINDER

NOISE = {"1mm": 1e-3, "3mm": 3e-3}

COUNTS = (1, 2, 4)
"""Views, evenly around the can."""

POSES = {"0.1mm": (1e-4, 2e-4), "0.5mm": (5e-4, 1e-3)}
"""What poses err by, in meters and radians."""

TOLD = {"as they err": True, "nothing": None, "exact": (0.0, 0.0)}
"""What is told of them: what they err by, if True."""

BEYOND = 4.0
"""Deviations from which a coordinate is wrong."""

BOUNDED = 10
"""One of so many cans whose bound is computed: it hardly differs between them."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure what more views of a can tell of it."""

    run: RunConfig = RunConfig()
    seeds: int = 200
    """Cans of each number of views and noise."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """Errors over the joint bound, deviations, biases, intervals and failures."""
    some = 1 if config.run.quick else None
    for noise, sigma in list(NOISE.items())[:some]:
        for count in (2,) if config.run.quick else COUNTS:
            rng = np.random.default_rng(config.seed)
            cans = [draw_around(count, sigma, rng) for _ in range(config.seeds)]
            yield from _compared(f"views.{count}.{noise}", cans)
    for label, off in list(POSES.items())[:some]:
        rng = np.random.default_rng(config.seed)
        cans = [draw_around(2, NOISE["1mm"], rng) for _ in range(config.seeds)]
        cans = [around.off(*off, rng) for around in cans]
        for told, pose_sigma in TOLD.items():
            how = off if pose_sigma is True else pose_sigma
            yield from _with_poses_off(f"poses.{label}.{told}", cans, how)


def _with_poses_off(
    label: str, cans: list[Around], pose_sigma: Any
) -> Iterator[Metric]:
    """What is wrong by how much where poses err, and does not say so."""
    errors, beyond = [], 0
    for around in cans:
        fit = around.fit(pose_sigma=pose_sigma)
        if fit.success:
            off = error(fit.cylinder, around.can)
            deviations = np.sqrt(np.diagonal(np.asarray(fit.covariance)))
            beyond += bool(np.any(np.abs(off) > BEYOND * deviations))
            errors.append(off)
    failures = len(cans) - len(errors)
    yield Metric(f"{label}.failures", failures, None, "cans", "lower", len(cans))
    share = beyond / len(errors) if errors else None
    yield Metric.share(f"{label}.beyond", share, len(errors), "lower")
    for name in ("radius", "center_first"):
        off = np.array(errors).reshape(len(errors), -1)
        k = CYLINDER.coordinates.index(name)
        yield rmse(f"{label}.{name}.rms", off[:, k], "m")


def _compared(label: str, cans: list[Around]) -> Iterator[Metric]:
    errors, deviations, failures = [], [], 0
    for around in cans:
        fit = around.fit()
        if not fit.success:
            failures += 1
            continue
        errors.append(error(fit.cylinder, around.can))
        deviations.append(np.sqrt(np.diagonal(np.asarray(fit.covariance))))
    yield Metric(f"{label}.failures", failures, None, "cans", "lower", len(cans))
    errors, deviations = np.array(errors), np.array(deviations)
    some = cans[::BOUNDED]
    least = np.array([around.bound() for around in some])
    reachable = np.array([around.bound(reachable=True) for around in some])
    for name in COMPARED:
        k = CYLINDER.coordinates.index(name)
        off = errors[:, k]
        yield over_bound(f"{label}.{name}.over_bound", off, least[:, k])
        yield over_bound(f"{label}.{name}.over_reachable", off, reachable[:, k])
        yield rmse(f"{label}.{name}.rms", off, "m")
        yield bias(f"{label}.{name}.bias", off)
        yield inside(f"{label}.{name}.inside", off, deviations[:, k])


if __name__ == "__main__":
    main(Config, measure, tables, Config(seeds=2))
