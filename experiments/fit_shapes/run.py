"""Fit noisy balls, cups and tubes, compare with the bound, and test cans for others."""

__all__ = ["Config", "measure"]

import dataclasses
from collections.abc import Iterator

import numpy as np

import impostor_jax as ij
from experiments.fit_shapes.report import (
    CHI_SQUARED,
    COORDINATES,
    SIZES,
    draw,
    tables,
)
from experiments.fitting import Fits, bias, fit_all, over_bound
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import (
    CAMERA,
    View,
    draw_ball,
    draw_cup,
    draw_tube,
    seen_plainly,
)

FITS = {"sphere": ij.fit_sphere, "frustum": ij.fit_frustum, "tube": ij.fit_tube}

NOISE = {"1mm": 1e-3, "3mm": 3e-3}

ANGLES = {"90deg": (90.0, 90.0), "60deg": (60.0, 60.0), "30deg": (30.0, 30.0)}
"""Between the axis of a cup and the view; its narrow end faces the camera."""

TAPER = 0.25
"""Of the cups that are compared with the bound."""

INTO = {"50deg": (50.0, 50.0), "35deg": (35.0, 35.0), "20deg": (20.0, 20.0)}
"""Between the axis of a tube and the view, from which its bore is seen into; through
the last one sees the wall behind."""

INNER_RADIUS = 0.035
"""Of the tubes that are compared with the bound, in meters."""

BORES = {"none": 0.0, "4 mm": 0.004, "10 mm": 0.01, "35 mm": 0.035}
"""Inner radii, in meters, of what is tested for a bore."""

ONTO = (20.0, 70.0)
"""Angles between its axis and the view, from which an end of it is seen."""

NORMAL_95 = 1.96
"""Half the width of the 95 percent interval of a normal deviate."""

TESTED = (30.0, 150.0)
"""Angles between axis and view of the cups and cans that are tested for a taper."""

LEVEL = 0.01
"""P-value below which a taper is taken to be needed."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure the accuracy of fits of spheres, frusta and tubes, and tests of cans."""

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
    """Compare fits with the bound, and test for a bore and a taper."""
    for noise, sigma in list(NOISE.items())[: 1 if config.run.quick else None]:
        rng = np.random.default_rng(config.seed)
        balls = [draw_ball(sigma, rng) for _ in range(config.seeds)]
        yield from compared(f"sphere.{noise}", balls)
        for angle, degrees in {} if config.run.quick else ANGLES.items():
            rng = np.random.default_rng(config.seed)
            cups = [draw_cup(TAPER, degrees, sigma, rng) for _ in range(config.seeds)]
            yield from compared(f"frustum.{angle}.{noise}", cups)
        for angle, degrees in {} if config.run.quick else INTO.items():
            rng = np.random.default_rng(config.seed)
            tubes = [
                draw_tube(INNER_RADIUS, degrees, sigma, rng)
                for _ in range(config.seeds)
            ]
            yield from compared(f"tube.{angle}.{noise}", tubes)
        for bore in {} if config.run.quick else BORES:
            yield from bored(bore, noise, config)
    if not config.run.quick:
        for taper in (0.0, config.taper / 10, config.taper):
            yield from tested(taper, config)


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
    if kind == "tube":
        yield from intervals(label, fits)
        told = told_by_ends(fits.views)
        bounds = {name: np.where(np.isfinite(b), b, told) for name, b in bounds.items()}
    for k, name in enumerate(COORDINATES[kind]):
        off = fits.errors[:, k]
        for suffix, least in bounds.items():
            yield over_bound(f"{label}.{name}.{suffix}", off, least[:, k])
        yield bias(f"{label}.{name}.bias", off)


def told_by_ends(views: list[View]) -> np.ndarray:
    """What an exact image of each view tells a fit of a tube.

    Depths leave its far end open; the places where it stops in the image tell that,
    each uniform within a pixel.
    """
    fits = [
        ij.fit_tube(
            seen_plainly(view),
            CAMERA,
            mask=view.mask,
            sigma=view.sigma,
            initial=view.shape,
        )
        for view in views
    ]
    return np.array([np.sqrt(np.diagonal(np.asarray(f.covariance))) for f in fits])


def intervals(label: str, fits: Fits) -> Iterator[Metric]:
    """How often the 95 % intervals of a tube's sizes hold the truth."""
    for name in SIZES:
        k = COORDINATES["tube"].index(name)
        inside = np.abs(fits.errors[:, k]) < NORMAL_95 * fits.deviations[:, k]
        share, n = float(np.mean(inside)), len(inside)
        yield Metric.share(f"{label}.{name}.inside", share, n, "higher")


def bored(bore: str, noise: str, config: Config) -> Iterator[Metric]:
    """How often a bore is taken to be needed, and the statistics."""
    label = f"bore.{bore}, {noise}"
    rng = np.random.default_rng(config.seed)
    statistics, needed = [], []
    for _ in range(config.tested):
        view = draw_tube(BORES[bore], ONTO, NOISE[noise], rng)
        fit = ij.fit_cylinder(view.depth, CAMERA, mask=view.mask, sigma=view.sigma)
        test = ij.test_bore(fit)
        statistics.append(float(test.statistic))
        needed.append(bool(test.is_needed(LEVEL)))
    n, known = len(needed), np.array(statistics)[np.isfinite(statistics)]
    better = "higher" if BORES[bore] else "lower"
    yield Metric.share(f"{label}.needed", float(np.mean(needed)), n, better)
    yield Metric(f"{label}.failures", n - len(known), None, "images", "lower", n)
    for name, value in {"least": known.min(), "most": known.max()}.items():
        path = f"{label}.statistic.{name}"
        yield Metric(path, float(value), None, "1", better, len(known))


def tested(taper: float, config: Config) -> Iterator[Metric]:
    """How often a taper is taken to be needed, and the statistics."""
    label = f"taper.{100 * taper:g}%"
    rng = np.random.default_rng(config.seed)
    statistics, needed = [], []
    for _ in range(config.tested):
        view = draw_cup(taper, TESTED, NOISE["1mm"], rng)
        fit = ij.fit_cylinder(view.depth, CAMERA, mask=view.mask, sigma=NOISE["1mm"])
        test = ij.test_taper(fit)
        statistics.append(float(test.statistic))
        needed.append(bool(test.is_needed(LEVEL)))
    n, known = len(needed), np.array(statistics)[np.isfinite(statistics)]
    better = "higher" if taper else "lower"
    yield Metric.share(f"{label}.needed", float(np.mean(needed)), n, better)
    yield Metric(f"{label}.failures", n - len(known), None, "images", "lower", n)
    for percent in CHI_SQUARED:
        value = float(np.percentile(known, percent))
        name = f"{label}.statistic.p{percent}"
        yield Metric(name, value, None, "1", better, len(known))


if __name__ == "__main__":
    main(Config, measure, draw, tables, Config(seeds=2))
