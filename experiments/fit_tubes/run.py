"""Fit many noisy tubes, compare with the bound, and test cans and tubes for a bore."""

__all__ = ["Config", "measure"]

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.errors import bound
from experiments.fit_tubes.report import SIZES, tables
from experiments.fitting import (
    Fits,
    bias,
    fit_all,
    fit_cylinder,
    inside,
    over_bound,
    tested,
)
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import CAMERA, View, draw_tube, seen_plainly
from impostor_jax.fit.fittable import TUBE

NOISE = {"1mm": 1e-3, "3mm": 3e-3}

INTO = {"50deg": (50.0, 50.0), "35deg": (35.0, 35.0), "20deg": (20.0, 20.0)}
"""Between the axis of a tube and the view, from which its bore is seen into; through
the last one sees the wall behind."""

INNER_RADIUS = 0.035
"""Of the tubes that are compared with the bound, in meters."""

BORES = {"none": 0.0, "4 mm": 0.004, "10 mm": 0.01, "35 mm": 0.035}
"""Inner radii, in meters, of what is tested for a bore."""

ONTO = (20.0, 70.0)
"""Angles between its axis and the view, from which an end of it is seen."""

BOUNDED = 10
"""One of so many views whose bound is computed: it hardly differs between them."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure the accuracy of fits of tubes, and the test of a bore."""

    run: RunConfig = RunConfig()
    seeds: int = 200
    """Images of each case."""
    tested: int = 200
    """Cans, and tubes of each bore."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """Compare fits with the bound, and test for a bore."""
    some = 1 if config.run.quick else None
    for noise, sigma in list(NOISE.items())[:some]:
        for angle, degrees in list(INTO.items())[:some]:
            rng = np.random.default_rng(config.seed)
            tubes = [
                draw_tube(INNER_RADIUS, degrees, sigma, rng)
                for _ in range(config.seeds)
            ]
            yield from compared(f"tube.{angle}.{noise}", tubes)
        for bore in {} if config.run.quick else BORES:
            yield from bored(bore, noise, config)


def compared(label: str, views: list[View]) -> Iterator[Metric]:
    """Errors over the bound, biases, intervals and failures, without a start."""

    def fit(view: View) -> ij.Fit:
        return ij.fit_tube(view.depth, CAMERA, mask=view.mask, sigma=view.sigma)

    fits = fit_all(fit, views)
    yield from fits.counts(label)
    least = bounds(fits)
    for name in SIZES:
        k = TUBE.coordinates.index(name)
        off = fits.errors[:, k]
        yield over_bound(f"{label}.{name}.over_bound", off, least[:, k])
        yield bias(f"{label}.{name}.bias", off)
        yield inside(f"{label}.{name}.inside", off, fits.deviations[:, k])


def bounds(fits: Fits) -> Float[np.ndarray, "n k"]:
    """The bound of some views.

    Depths leave the far end of a tube open; the places where it stops in the image tell
    of it, each uniform within a pixel. What all that tells is what a fit to an exact
    image says.
    """
    found = []
    for view in fits.views[::BOUNDED]:
        tube = view.shape
        assert isinstance(tube, ij.Solid)
        fit = ij.fit_tube(
            seen_plainly(view), CAMERA, mask=view.mask, sigma=view.sigma, initial=tube
        )
        of_all = np.sqrt(np.diagonal(np.asarray(fit.covariance)))
        of_depths = bound(view)
        found.append(np.where(np.isfinite(of_depths), of_depths, of_all))
    return np.array(found)


def bored(bore: str, noise: str, config: Config) -> Iterator[Metric]:
    """How often a bore is taken to be needed, and the statistics."""
    rng = np.random.default_rng(config.seed)
    views = (
        draw_tube(BORES[bore], ONTO, NOISE[noise], rng) for _ in range(config.tested)
    )
    tests = (ij.test_bore(fit_cylinder(view)) for view in views)
    extremes = {"least": 0, "most": 100}
    yield from tested(f"bore.{bore}, {noise}", tests, BORES[bore] > 0, extremes)


if __name__ == "__main__":
    main(Config, measure, tables, Config(seeds=2))
