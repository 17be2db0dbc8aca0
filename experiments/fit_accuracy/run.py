"""Fit many noisy images of one can, and random scenes, and compare with the bound."""

__all__ = ["Config", "measure"]

import dataclasses
import importlib.util
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij
from experiments.errors import bound, error
from experiments.fit_accuracy.report import tables
from experiments.fitting import NORMAL_95, Fits, bias, fit_all, over_bound
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import (
    CAMERA,
    DISTANCE,
    SENSOR,
    FitCase,
    View,
    draw_can,
    draw_scene,
)
from impostor_jax.fit.fittable import CYLINDER

CASES = {
    f"{degrees:.0f}deg.{name}": FitCase((degrees, degrees), sigma, outliers)
    for degrees in (90.0, 60.0, 30.0, 10.0)
    for name, sigma, outliers in (
        ("1mm", 1e-3, 0.0),
        ("3mm", 3e-3, 0.0),
        ("outliers", 1e-3, 0.1),
    )
}

DETERMINED = (0, 1, 2, 3, 5)
"""Coordinates that the depths determine in every case: not the ends."""

PEER_CASES = ("90deg.1mm", "90deg.3mm", "90deg.outliers", "30deg.1mm")
"""Cases that the other programs fit, too."""

INTERVALS = {
    "white": FitCase((40.0, 80.0)),
    "correlated": FitCase((40.0, 80.0), 1e-3, 0, 3),
}
"""Noise whose intervals are counted, both ends of the can in view."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure the accuracy of fits."""

    run: RunConfig = RunConfig()
    seeds: int = 200
    """Images of each case."""

    draws: int = 1000
    """Images whose intervals are counted."""

    scenes: int = 1000
    """Random scenes."""

    peers: bool = True
    """Whether other programs fit, too."""

    peer_seeds: int = 20
    """Images of each case that the other programs fit: some take ten seconds for
    one."""


def fit_views(views: Sequence[View], **options: Any) -> Fits:
    """Fit each view as a user would, with no start."""

    def fit(view: View) -> ij.Fit:
        return ij.fit_cylinder(
            view.depth, CAMERA, mask=view.mask, sigma=view.sigma, **options
        )

    fit(views[0])
    return fit_all(fit, views)


def fit_by_peer(peer: str, views: Sequence[View]) -> Fits:
    """Fit the points of each view's wall, which spares a program the caps."""
    from experiments.fit_accuracy.peers import PEERS, points_of

    def fit(view: View) -> ij.Cylinder | None:
        points = points_of(view.depth, on_wall[id(view)], CAMERA)
        try:
            line = PEERS[peer](points, view.sigma, view.shape)
            return ij.Cylinder(*line, 1.0)
        except Exception:
            return None

    on_wall = {id(view): _on_wall(view) for view in views}
    return fit_all(fit, views)


def _on_wall(view: View) -> Bool[np.ndarray, "h w"]:
    """Pixels whose ray hits the wall of the can."""
    can = view.shape
    assert isinstance(can, ij.Cylinder)
    point = np.asarray(ij.render(can, CAMERA, outputs=("point",)).point)
    offset = np.where(view.mask[..., None], point, 0) - np.asarray(can.center)
    along = np.abs(offset @ np.asarray(can.axis))
    return view.mask & (along < float(can.height) / 2 * (1 - 1e-4))


def case_metrics(name: str, fits: Fits) -> Iterator[Metric]:
    """Error over the bound, bias and coverage of one case."""
    yield from fits.counts(name)
    if not (n := len(fits.views)):
        return
    bounds, deviations = fits.bounds(), fits.deviations
    facing = fits.bounds(least_cosine=0.3) if len(deviations) else bounds
    for k in DETERMINED:
        label, unit = f"{name}.{CYLINDER.coordinates[k]}", "rad" if k < 2 else "m"
        off = fits.errors[:, k]
        rms = np.sqrt(np.mean(off**2))
        yield _metric(f"{label}.rmse", rms, rms / np.sqrt(2 * n), unit, n)
        yield over_bound(f"{label}.over_bound", off, bounds[:, k])
        yield bias(f"{label}.bias_over_spread", off)
        if len(deviations):
            yield over_bound(f"{label}.over_bound_of_facing", off, facing[:, k])
            yield _interval_coverage(label, off, deviations[:, k])


def _metric(name: str, value: float, spread: float, unit: str, n: int) -> Metric:
    return Metric(name, float(value), float(spread), unit, "lower", n)


def _interval_coverage(
    label: str, errors: Float[np.ndarray, " n"], deviations: Float[np.ndarray, " n"]
) -> Metric:
    """Part of the 95 percent intervals that hold the truth, of those that end."""
    known = np.isfinite(deviations)
    holds = np.abs(errors[known]) <= NORMAL_95 * deviations[known]
    return Metric.share(f"{label}.coverage_95", float(np.mean(holds)), len(holds))


def interval_metrics(name: str, count: int) -> Iterator[Metric]:
    """Coverage of the intervals of each coordinate."""
    case = INTERVALS[name]
    errors = "correlated" if case.correlation else "independent"
    parts = []
    # All images of a measurement at once would not fit into memory.
    for seeds in np.array_split(np.arange(count), -(-count // 50)):
        views = [draw_can(case, int(seed)) for seed in seeds]
        fits = fit_views(views, errors=errors)
        parts.append((fits.errors, fits.deviations))
    found, reported = map(np.concatenate, zip(*parts, strict=True))
    for k, coordinate in enumerate(CYLINDER.coordinates):
        yield _interval_coverage(
            f"interval.{name}.{coordinate}", found[:, k], reported[:, k]
        )


def height_metrics(seeds: int) -> list[Metric]:
    """Height with both ends seen and the mask an outline."""
    views = [draw_can(INTERVALS["white"], seed) for seed in range(seeds)]
    fits = fit_views(views, mask_meaning="outline")
    known = np.isfinite(fits.deviations[:, 6])
    pixels = fits.errors[known, 6] / (DISTANCE / CAMERA.matrix()[0, 0])
    n = len(pixels)
    rms, mean = np.sqrt(np.mean(pixels**2)), np.mean(pixels)
    return [
        Metric("height.failures", seeds - n, None, "1", "lower", seeds),
        _metric("height.rmse", rms, rms / np.sqrt(2 * n), "pixel", n),
        _metric("height.bias", mean, rms / np.sqrt(n), "pixel", n),
        _interval_coverage("height", fits.errors[:, 6], fits.deviations[:, 6]),
    ]


def scene_metrics(count: int) -> list[Metric]:
    """Random scenes, with no start given."""
    within, far, failed = 0, [], 0
    for seed in range(count):
        view = draw_scene(seed)
        fit = ij.fit_cylinder(view.depth, CAMERA, mask=view.mask, sigma=SENSOR)
        if not bool(fit.success):
            failed += 1
            continue
        deviation = np.sqrt(np.diagonal(np.asarray(fit.covariance)))
        off = np.abs(error(fit.cylinder, view.shape))
        ratio = np.where(np.isfinite(deviation), off / deviation, 0).max()
        if ratio > 5:
            least = bound(view)
            least = np.maximum(np.where(np.isfinite(least), least, 0), deviation)
            ratio = np.where(np.isfinite(deviation), off / least, 0).max()
        within += ratio <= 5
        if ratio > 10:
            far.append(seed)
    if far:
        print("false successes, seeds:", *far)
    return [
        Metric.share("scenes.within_5", within / count, count),
        Metric("scenes.failures", failed / count, None, "1", "lower", count),
        Metric("scenes.false_success", len(far) / count, None, "1", "lower", count),
    ]


def measure(config: Config) -> Iterator[Metric]:
    """Measure all cases.

    Raises:
        ValueError: The other programs are not installed.
    """
    if config.peers and importlib.util.find_spec("cylfit") is None:
        raise ValueError(
            "the other programs are not installed: pip install '.[bench]', or leave "
            "them out with --no-peers"
        )
    for name in ("60deg.1mm",) if config.run.quick else CASES:
        views = [draw_can(CASES[name], seed) for seed in range(config.seeds)]
        yield from case_metrics(name, fit_views(views))
        if name in PEER_CASES and config.peers:
            from experiments.fit_accuracy.peers import PEERS

            for peer in PEERS:
                fits = fit_by_peer(peer, views[: config.peer_seeds])
                yield from case_metrics(f"{peer}.{name}", fits)
    for name in ("white",) if config.run.quick else INTERVALS:
        yield from interval_metrics(name, config.draws)
    if not config.run.quick:
        # Each needs a program of its own to be compiled.
        yield from height_metrics(config.seeds)
        yield from scene_metrics(config.scenes)


if __name__ == "__main__":
    main(Config, measure, tables, Config(seeds=2, draws=2, peers=False))
