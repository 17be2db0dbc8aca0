"""Fit many noisy balls and cups, compare with the bound, and test cups and cans."""

__all__ = ["Config", "measure"]

import dataclasses
from collections.abc import Iterator

import numpy as np

import impostor_jax as ij
from experiments.fit_shapes.report import CHI_SQUARED, COORDINATES, tables
from experiments.fitting import bias, fit_all, fit_cylinder, over_bound, tested
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import CAMERA, View, draw_ball, draw_cup

FITS = {"sphere": ij.fit_sphere, "frustum": ij.fit_frustum}

NOISE = {"1mm": 1e-3, "3mm": 3e-3}

ANGLES = {"90deg": (90.0, 90.0), "60deg": (60.0, 60.0), "30deg": (30.0, 30.0)}
"""Between the axis of a cup and the view; its narrow end faces the camera."""

TAPER = 0.25
"""Of the cups that are compared with the bound."""

TESTED = (30.0, 150.0)
"""Angles between axis and view of the cups and cans that are tested for a taper."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure the accuracy of fits of spheres and frusta, and the test of a taper."""

    run: RunConfig = RunConfig()
    seeds: int = 200
    """Images of each case."""
    tested: int = 200
    """Cups of each taper, and cans."""
    taper: float = 0.05
    """Of the cups that are tested."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """Compare fits with the bound, and test for a taper."""
    for noise, sigma in list(NOISE.items())[: 1 if config.run.quick else None]:
        rng = np.random.default_rng(config.seed)
        balls = [draw_ball(sigma, rng) for _ in range(config.seeds)]
        yield from compared(f"sphere.{noise}", balls)
        for angle, degrees in {} if config.run.quick else ANGLES.items():
            rng = np.random.default_rng(config.seed)
            cups = [draw_cup(TAPER, degrees, sigma, rng) for _ in range(config.seeds)]
            yield from compared(f"frustum.{angle}.{noise}", cups)
    if not config.run.quick:
        for taper in (0.0, config.taper / 10, config.taper):
            yield from tapered(taper, config)


def compared(label: str, views: list[View]) -> Iterator[Metric]:
    """Errors over the bound, biases, and failures, of fits without a start."""
    kind = label.split(".")[0]

    def fit(view: View) -> ij.Fit:
        return FITS[kind](view.depth, CAMERA, mask=view.mask, sigma=view.sigma)

    fits = fit_all(fit, views)
    yield from fits.counts(label)
    bounds = {
        "over_bound": fits.bounds(),
        "over_reachable": fits.bounds(reachable=True),
    }
    for k, name in enumerate(COORDINATES[kind]):
        off = fits.errors[:, k]
        for suffix, least in bounds.items():
            yield over_bound(f"{label}.{name}.{suffix}", off, least[:, k])
        yield bias(f"{label}.{name}.bias", off)


def tapered(taper: float, config: Config) -> Iterator[Metric]:
    """How often a taper is taken to be needed, and the statistics."""
    rng = np.random.default_rng(config.seed)
    views = (draw_cup(taper, TESTED, NOISE["1mm"], rng) for _ in range(config.tested))
    tests = (ij.test_taper(fit_cylinder(view)) for view in views)
    label = f"taper.{100 * taper:g}%"
    percents = {f"p{percent}": percent for percent in CHI_SQUARED}
    yield from tested(label, tests, taper > 0, percents)


if __name__ == "__main__":
    main(Config, measure, tables, Config(seeds=2))
