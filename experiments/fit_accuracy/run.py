"""Fit many noisy images of one can, and random scenes, and compare with the bound."""

__all__ = ["Config", "run"]

import dataclasses
import importlib.util
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np
import tyro
from jaxtyping import Bool, Float

import impostor_jax as ij
from experiments.fit_accuracy.bound import bound, error
from experiments.fit_accuracy.cases import CAMERA, CASES, DISTANCE, Case, View, draw
from experiments.fit_accuracy.report import draw as draw_figures
from experiments.fit_accuracy.report import tables
from experiments.fit_accuracy.scenes import SENSOR, random_scene
from experiments.recording import Metric, result_folder, save_run
from impostor_jax.fit.fittable import CYLINDER

T = TypeVar("T")

HERE = Path(__file__).parent

DETERMINED = (0, 1, 2, 3, 5)
"""Coordinates that the depths determine in every case: not the ends."""

PEER_CASES = ("90deg.1mm", "90deg.3mm", "90deg.outliers", "30deg.1mm")
"""Cases that the other programs fit, too."""

INTERVALS = {"white": Case((40.0, 80.0)), "correlated": Case((40.0, 80.0), 1e-3, 0, 3)}
"""Noise whose intervals are counted, both ends of the can in view."""

NORMAL_95 = 1.96
"""Half the width of the 95 percent interval of a normal deviate."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure the accuracy of fits."""

    quick: bool = False
    """Few images of one case: a trial of the code, no measurement."""

    seeds: int = 200
    """Images of each case."""

    draws: int = 1000
    """Images whose intervals are counted."""

    scenes: int = 1000
    """Random scenes."""

    peer_seeds: int = 20
    """Images of each case that the other programs fit: some take ten seconds for one.
    0 leaves them out."""

    output: Path | None = None
    """Folder of the results; the experiment's own by default, a temporary one with
    --quick."""


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


def fit_views(
    views: Sequence[View], sigma: float, with_bounds: bool = True, **options: Any
) -> Fits:
    """Fit each view as a user would, with no start."""

    def fit(view: View) -> ij.Fit:
        done = ij.fit_cylinder(
            view.depth, CAMERA, mask=view.mask, sigma=sigma, **options
        )
        return jax.block_until_ready(done)

    fit(views[0])
    fits, seconds = _timed(fit, views)
    good = [(view, fit) for view, fit in zip(views, fits, strict=True) if fit.success]
    variances = [np.diagonal(np.asarray(fit.covariance)) for _, fit in good]
    bounds = [
        [bound(view.can, CAMERA, view.mask, sigma, least) for least in (0.0, 0.3)]
        if with_bounds
        else [np.full(7, np.nan)] * 2
        for view, _ in good
    ]
    of_all = np.array(bounds).reshape(-1, 2, 7)
    errors = [error(fit.cylinder, view.can) for view, fit in good]
    return Fits(
        errors=np.array(errors).reshape(-1, 7),
        deviations=np.sqrt(variances).reshape(-1, 7),
        bounds=of_all[:, 0],
        bounds_facing=of_all[:, 1],
        failures=len(views) - len(good),
        seconds=float(np.median(seconds)),
    )


def fit_by_peer(peer: str, views: Sequence[View], sigma: float) -> Fits:
    """Fit the points of each view's wall, which spares a program the caps."""
    from experiments.fit_accuracy.peers import PEERS, points_of

    def fit(view: View):
        try:
            found = PEERS[peer](
                points_of(view.depth, view.wall, CAMERA), sigma, view.can
            )
        except Exception:
            return None
        return found if np.all(np.isfinite(found[2])) else None

    lines, seconds = _timed(fit, views)
    good = [(v, line) for v, line in zip(views, lines, strict=True) if line is not None]
    errors, bounds = [], []
    for view, (point, axis, radius) in good:
        # The point of the axis that is nearest to the can's center.
        center = np.asarray(view.can.center, float)
        point = point + axis * ((center - point) @ axis)
        found = ij.Cylinder(point, axis, radius, view.can.height)
        errors.append(error(found, view.can))
        bounds.append(bound(view.can, CAMERA, view.mask, sigma))
    return Fits(
        errors=np.array(errors).reshape(-1, 7),
        deviations=None,
        bounds=np.array(bounds).reshape(-1, 7),
        bounds_facing=np.full((len(good), 7), np.nan),
        failures=len(views) - len(good),
        seconds=float(np.median(seconds)),
    )


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
    spread = float(np.sqrt(part * (1 - part) / n))
    return Metric(f"{label}.coverage_95", part, spread, "1", "higher", n)


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
        views = [draw(case, int(seed)) for seed in seeds]
        parts.append(fit_views(views, case.sigma, with_bounds=False, errors=errors))
    deviations = [part.deviations for part in parts if part.deviations is not None]
    found, reported = np.concatenate([p.errors for p in parts]), np.vstack(deviations)
    return [
        _coverage(f"interval.{name}.{coordinate}", found[:, k], reported[:, k])
        for k, coordinate in enumerate(CYLINDER.coordinates)
    ]


def height_metrics(seeds: int) -> list[Metric]:
    """Height with both ends seen and the mask an outline."""
    case = INTERVALS["white"]
    views = [draw(case, seed) for seed in range(seeds)]
    fits = fit_views(views, case.sigma, with_bounds=False, mask_meaning="outline")
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
        scene = random_scene(seed)
        fit = ij.fit_cylinder(scene.depth, CAMERA, mask=scene.mask, sigma=SENSOR)
        if not bool(fit.success):
            failed += 1
            continue
        deviation = np.sqrt(np.diagonal(np.asarray(fit.covariance)))
        off = np.abs(error(fit.cylinder, scene.cylinder))
        ratio = np.where(np.isfinite(deviation), off / deviation, 0).max()
        if ratio > 5:
            least = bound(scene.cylinder, CAMERA, scene.mask, scene.sigma)
            least = np.maximum(np.where(np.isfinite(least), least, 0), deviation)
            ratio = np.where(np.isfinite(deviation), off / least, 0).max()
        within += ratio <= 5
        if ratio > 10:
            far.append(seed)
    if far:
        print("false successes, seeds:", *far)
    share = within / count
    return [
        Metric("scenes.within_5", share, float(np.sqrt(share * (1 - share) / count)),
               "1", "higher", count),
        Metric("scenes.failures", failed / count, None, "1", "lower", count),
        Metric("scenes.false_success", len(far) / count, None, "1", "lower", count),
    ]  # fmt: skip


def run(config: Config) -> Path:
    """Measure and record; returns the folder of the results.

    Raises:
        ValueError: A count is not positive, the other programs are not installed, or
            the code is not committed.
    """
    for name in ("seeds", "draws", "scenes"):
        if getattr(config, name) < 1:
            raise ValueError(f"{name} must be at least 1, got {getattr(config, name)}")
    cases, noises = tuple(CASES), tuple(INTERVALS)
    if config.quick:
        # No heights and no scenes: each needs a program of its own to be compiled.
        config = dataclasses.replace(config, seeds=2, draws=2, scenes=1, peer_seeds=0)
        cases, noises = ("60deg.1mm",), ("white",)
    if config.peer_seeds and importlib.util.find_spec("cylfit") is None:
        raise ValueError(
            "the other programs are not installed: pip install '.[bench]', or leave "
            "them out with --peer-seeds 0"
        )
    folder = result_folder(config.output, HERE, quick=config.quick)
    start = time.perf_counter()
    metrics = []
    for name in cases:
        views = [draw(CASES[name], seed) for seed in range(config.seeds)]
        metrics += case_metrics(name, fit_views(views, CASES[name].sigma))
        if name in PEER_CASES and config.peer_seeds:
            from experiments.fit_accuracy.peers import PEERS

            for peer in PEERS:
                fits = fit_by_peer(peer, views[: config.peer_seeds], CASES[name].sigma)
                metrics += case_metrics(f"{peer}.{name}", fits)
        print(name, f"{time.perf_counter() - start:.0f} s")
    if not config.quick:
        metrics += height_metrics(config.seeds)
    for name in noises:
        metrics += interval_metrics(name, config.draws)
    print("intervals", f"{time.perf_counter() - start:.0f} s")
    if not config.quick:
        metrics += scene_metrics(config.scenes)
    save_run(
        folder,
        metrics,
        config,
        seed=0,
        dtype=str(ij.Cylinder((0, 0, 1), (0, 0, 1), 1, 1).radius.dtype),
        seconds=time.perf_counter() - start,
        quick=config.quick,
    )
    draw_figures(folder)
    return folder


if __name__ == "__main__":
    try:
        written = run(tyro.cli(Config))
    except ValueError as problem:
        sys.exit(str(problem))
    print(f"{tables(written)}\n\nwritten to {written}")
