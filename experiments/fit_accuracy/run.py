"""Fit many noisy images of one can, and random scenes, and compare with the bound."""

__all__ = ["Config", "measure"]

import dataclasses
import importlib.util
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import jax
import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij
from experiments.errors import bound, error
from experiments.fit_accuracy.report import draw, tables
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import (
    CAMERA,
    DISTANCE,
    SENSOR,
    Case,
    View,
    draw_can,
    draw_scene,
)
from impostor_jax.fit.fittable import CYLINDER

T = TypeVar("T")

CASES = {
    f"{degrees:.0f}deg.{name}": Case((degrees, degrees), sigma, outliers)
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

INTERVALS = {"white": Case((40.0, 80.0)), "correlated": Case((40.0, 80.0), 1e-3, 0, 3)}
"""Noise whose intervals are counted, both ends of the can in view."""

NORMAL_95 = 1.96
"""Half the width of the 95 percent interval of a normal deviate."""


@dataclasses.dataclass(frozen=True)
class Config(RunConfig):
    """Measure the accuracy of fits."""

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


@dataclasses.dataclass(frozen=True)
class Fits:
    """Fits of many views by one program, those that failed left out.

    Attributes:
        errors: In the coordinates of `Fit.covariance`.
        deviations: That were reported; None where a program reports none.
        bounds: Cramér-Rao bound of all the mask's pixels.
        bounds_facing: The same without those seen at a cosine below 0.3.
        failures: Number of views without a fit.
        seconds: Median time of a fit.
    """

    errors: Float[np.ndarray, "n 7"]
    deviations: Float[np.ndarray, "n 7"] | None
    bounds: Float[np.ndarray, "n 7"]
    bounds_facing: Float[np.ndarray, "n 7"]
    failures: int
    seconds: float


def fit_views(views: Sequence[View], with_bounds: bool = True, **options: Any) -> Fits:
    """Fit each view as a user would, with no start."""

    def fit(view: View) -> ij.Fit:
        done = ij.fit_cylinder(
            view.depth, CAMERA, mask=view.mask, sigma=view.sigma, **options
        )
        return jax.block_until_ready(done)

    fit(views[0])
    fits, seconds = _timed(fit, views)
    good = [(view, fit) for view, fit in zip(views, fits, strict=True) if fit.success]
    variances = [np.diagonal(np.asarray(fit.covariance)) for _, fit in good]
    bounds = [
        [bound(view, least) for least in (0.0, 0.3)]
        if with_bounds
        else [np.full(7, np.nan)] * 2
        for view, _ in good
    ]
    of_all = np.array(bounds).reshape(-1, 2, 7)
    errors = [error(fit.cylinder, view.shape) for view, fit in good]
    return Fits(
        errors=np.array(errors).reshape(-1, 7),
        deviations=np.sqrt(variances).reshape(-1, 7),
        bounds=of_all[:, 0],
        bounds_facing=of_all[:, 1],
        failures=len(views) - len(good),
        seconds=float(np.median(seconds)),
    )


def fit_by_peer(peer: str, views: Sequence[View]) -> Fits:
    """Fit the points of each view's wall, which spares a program the caps."""
    from experiments.fit_accuracy.peers import PEERS, points_of

    def fit(view: View):
        points = points_of(view.depth, on_wall[id(view)], CAMERA)
        try:
            found = PEERS[peer](points, view.sigma, view.shape)
        except Exception:
            return None
        return found if np.all(np.isfinite(found[2])) else None

    on_wall = {id(view): _on_wall(view) for view in views}
    lines, seconds = _timed(fit, views)
    good = [(v, line) for v, line in zip(views, lines, strict=True) if line is not None]
    errors, bounds = [], []
    for view, (point, axis, radius) in good:
        can = view.shape
        assert isinstance(can, ij.Cylinder)
        # The point of the axis that is nearest to the can's center.
        center = np.asarray(can.center, float)
        point = point + axis * ((center - point) @ axis)
        errors.append(error(ij.Cylinder(point, axis, radius, can.height), can))
        bounds.append(bound(view))
    return Fits(
        errors=np.array(errors).reshape(-1, 7),
        deviations=None,
        bounds=np.array(bounds).reshape(-1, 7),
        bounds_facing=np.full((len(good), 7), np.nan),
        failures=len(views) - len(good),
        seconds=float(np.median(seconds)),
    )


def _on_wall(view: View) -> Bool[np.ndarray, "h w"]:
    """Pixels whose ray hits the wall of the can."""
    can = view.shape
    assert isinstance(can, ij.Cylinder)
    point = np.asarray(ij.render(can, CAMERA, outputs=("point",)).point)
    offset = np.where(view.mask[..., None], point, 0) - np.asarray(can.center)
    along = np.abs(offset @ np.asarray(can.axis))
    return view.mask & (along < float(can.height) / 2 * (1 - 1e-4))


def _timed(
    fit: Callable[[View], T], views: Sequence[View]
) -> tuple[list[T], list[float]]:
    """What a fit returns for each view, and the seconds that it takes."""
    done, seconds = [], []
    for view in views:
        start = time.perf_counter()
        done.append(fit(view))
        seconds.append(time.perf_counter() - start)
    return done, seconds


def case_metrics(name: str, fits: Fits) -> list[Metric]:
    """Error over the bound, bias and coverage of one case."""
    n = len(fits.errors)
    total = n + fits.failures
    metrics = [
        Metric(f"{name}.failures", fits.failures, None, "1", "lower", total),
        Metric(f"{name}.time", 1e3 * fits.seconds, None, "ms", "lower", total),
    ]
    if not n:
        return metrics
    rms, spread = _rms(fits.errors), np.std(fits.errors, axis=0)
    for k in DETERMINED:
        label, unit = f"{name}.{CYLINDER.coordinates[k]}", "rad" if k < 2 else "m"
        relative = 1 / np.sqrt(2 * n)
        ratio = rms[k] / _rms(fits.bounds)[k]
        bias = np.mean(fits.errors[:, k]) / spread[k]
        metrics += [
            _metric(f"{label}.rmse", rms[k], rms[k] * relative, unit, n),
            _metric(f"{label}.over_bound", ratio, ratio * relative, "1", n),
            _metric(f"{label}.bias_over_spread", bias, 1 / np.sqrt(n), "1", n),
        ]
        if fits.deviations is not None:
            facing = rms[k] / _rms(fits.bounds_facing)[k]
            metrics += [
                _metric(f"{label}.over_bound_of_facing", facing, facing * relative,
                        "1", n),
                _coverage(label, fits.errors[:, k], fits.deviations[:, k]),
            ]  # fmt: skip
    return metrics


def _rms(values: Float[np.ndarray, "n 7"]) -> Float[np.ndarray, "7"]:
    return np.sqrt(np.mean(values**2, axis=0))


def _metric(name: str, value: float, spread: float, unit: str, n: int) -> Metric:
    return Metric(name, float(value), float(spread), unit, "lower", n)


def _coverage(
    label: str, errors: Float[np.ndarray, " n"], deviations: Float[np.ndarray, " n"]
) -> Metric:
    """Part of the 95 percent intervals that hold the truth, of those that end."""
    known = np.isfinite(deviations)
    part, n = float(np.mean(_holds(errors, deviations)[known])), int(np.sum(known))
    return Metric.share(f"{label}.coverage_95", part, n)


def _holds(
    errors: Float[np.ndarray, "*n"], deviations: Float[np.ndarray, "*n"]
) -> Bool[np.ndarray, "*n"]:
    return np.abs(errors) <= NORMAL_95 * deviations


def interval_metrics(name: str, count: int) -> list[Metric]:
    """Coverage of the intervals of each coordinate."""
    case = INTERVALS[name]
    errors = "correlated" if case.correlation else "independent"
    parts = []
    # All images of a measurement at once would not fit into memory.
    for seeds in np.array_split(np.arange(count), -(-count // 50)):
        views = [draw_can(case, int(seed)) for seed in seeds]
        parts.append(fit_views(views, with_bounds=False, errors=errors))
    deviations = [part.deviations for part in parts if part.deviations is not None]
    found, reported = np.concatenate([p.errors for p in parts]), np.vstack(deviations)
    return [
        _coverage(f"interval.{name}.{coordinate}", found[:, k], reported[:, k])
        for k, coordinate in enumerate(CYLINDER.coordinates)
    ]


def height_metrics(seeds: int) -> list[Metric]:
    """Height with both ends seen and the mask an outline."""
    views = [draw_can(INTERVALS["white"], seed) for seed in range(seeds)]
    fits = fit_views(views, with_bounds=False, mask_meaning="outline")
    assert fits.deviations is not None
    known = np.isfinite(fits.deviations[:, 6])
    pixels = fits.errors[known, 6] / (DISTANCE / CAMERA.matrix()[0, 0])
    n = len(pixels)
    rms, bias = np.sqrt(np.mean(pixels**2)), np.mean(pixels)
    return [
        Metric("height.failures", seeds - n, None, "1", "lower", seeds),
        _metric("height.rmse", rms, rms / np.sqrt(2 * n), "pixel", n),
        _metric("height.bias", bias, rms / np.sqrt(n), "pixel", n),
        _coverage("height", fits.errors[:, 6], fits.deviations[:, 6]),
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
    for name in ("60deg.1mm",) if config.quick else CASES:
        views = [draw_can(CASES[name], seed) for seed in range(config.seeds)]
        yield from case_metrics(name, fit_views(views))
        if name in PEER_CASES and config.peers:
            from experiments.fit_accuracy.peers import PEERS

            for peer in PEERS:
                fits = fit_by_peer(peer, views[: config.peer_seeds])
                yield from case_metrics(f"{peer}.{name}", fits)
    for name in ("white",) if config.quick else INTERVALS:
        yield from interval_metrics(name, config.draws)
    if not config.quick:
        # Each needs a program of its own to be compiled.
        yield from height_metrics(config.seeds)
        yield from scene_metrics(config.scenes)


if __name__ == "__main__":
    main(Config, measure, draw, tables, Config(seeds=2, draws=2, peers=False))
