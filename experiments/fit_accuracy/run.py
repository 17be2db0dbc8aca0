"""Fit many noisy images of one can, and compare with the bound."""

__all__ = ["Config", "measure"]

import dataclasses
import importlib.util
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool

import impostor_jax as ij
from experiments.fit_accuracy.report import tables
from experiments.fitting import (
    Fits,
    bias,
    fit_all,
    fit_cylinder,
    inside,
    over_bound,
    rmse,
)
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import (
    CAMERA,
    DISTANCE,
    FitCase,
    View,
    draw_can,
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

    peers: bool = True
    """Whether other programs fit, too."""

    peer_seeds: int = 20
    """Images of each case that the other programs fit: some take ten seconds for
    one."""


def fit_views(views: Sequence[View], **options: Any) -> Fits:
    """Fit each view as a user would, with no start."""

    def fit(view: View) -> ij.Fit:
        return fit_cylinder(view, **options)

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
    if not fits.views:
        return
    bounds, deviations = fits.bounds(), fits.deviations
    facing = fits.bounds(least_cosine=0.3) if len(deviations) else bounds
    for k in DETERMINED:
        label, unit = f"{name}.{CYLINDER.coordinates[k]}", "rad" if k < 2 else "m"
        off = fits.errors[:, k]
        yield rmse(f"{label}.rmse", off, unit)
        yield over_bound(f"{label}.over_bound", off, bounds[:, k])
        yield bias(f"{label}.bias_over_spread", off)
        if len(deviations):
            yield over_bound(f"{label}.over_bound_of_facing", off, facing[:, k])
            yield inside(f"{label}.coverage_95", off, deviations[:, k])


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
        label = f"interval.{name}.{coordinate}.coverage_95"
        yield inside(label, found[:, k], reported[:, k])


def height_metrics(seeds: int) -> list[Metric]:
    """Height with both ends seen and the mask an outline."""
    views = [draw_can(INTERVALS["white"], seed) for seed in range(seeds)]
    fits = fit_views(views, mask_meaning="outline")
    known = np.isfinite(fits.deviations[:, 6])
    pixels = fits.errors[known, 6] / (DISTANCE / CAMERA.matrix()[0, 0])
    n, mean = len(pixels), float(np.mean(pixels))
    error = rmse("height.rmse", pixels, "pixel")
    spread = float(np.sqrt(np.mean(pixels**2) / n))
    return [
        Metric("height.failures", seeds - n, None, "1", "lower", seeds),
        error,
        Metric("height.bias", mean, spread, "pixel", "lower", n),
        inside("height.coverage_95", fits.errors[:, 6], fits.deviations[:, 6]),
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


if __name__ == "__main__":
    main(Config, measure, tables, Config(seeds=2, draws=2, peers=False))
