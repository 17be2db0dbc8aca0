"""Fit cylinders to what is almost one, and ask whether the deviations know."""

__all__ = ["Config", "measure"]

import dataclasses
import warnings
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import impostor_jax as ij
from experiments.near_cylinders.report import tables
from experiments.near_cylinders.scenes import (
    CAMERA,
    KINDS,
    SIGMA,
    Thing,
    draw_thing,
)
from experiments.recording import Metric
from experiments.running import RunConfig, main

WRONG = 3.0
"""Deviations beyond which an answer is wrong."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how far off fits of what is almost a cylinder are."""

    run: RunConfig = RunConfig()
    count: int = 40
    """Images of each thing."""
    seed: int = 2026
    """Of all draws."""


class Answer(NamedTuple):
    """What a fit says of one.

    Attributes:
        success: Whether it says that it is right.
        departs: Whether it says that the wall departs from a cylinder's.
        off: Error of the radius beyond the wall's own, or of the axis, whichever is
            more, in standard deviations.
        without: The same in those without the part that is due to the wall's form.
        radius: Standard deviation of the radius, in meters.
    """

    success: bool
    departs: bool
    off: float
    without: float
    radius: float


def measure(config: Config) -> Iterator[Metric]:
    """Fit each kind."""
    kinds = dict(list(KINDS.items())[: 2 if config.run.quick else None])
    for name, kind in kinds.items():
        rng = np.random.default_rng(config.seed)
        found = [answer_to(draw_thing(kind, rng)) for _ in range(config.count)]
        yield from told(name, found)


def answer_to(thing: Thing) -> Answer:
    """Fit a cylinder to the true mask, told the noise."""
    with warnings.catch_warnings():
        # Of outlines that lie beside the fit's.
        warnings.simplefilter("ignore", UserWarning)
        fit = ij.fit_cylinder(thing.depth, CAMERA, mask=thing.mask, sigma=SIGMA)
    if not bool(fit.success):
        return Answer(False, bool(fit.form.departs), 0.0, 0.0, np.inf)
    departs, std = bool(fit.form.departs), float(fit.std.radius)
    return Answer(True, departs, _off(fit, thing), _off(fit, thing, "form"), std)


def _off(fit: ij.Fit, thing: Thing, without: str | None = None) -> float:
    """Error of radius or axis in deviations, or in those without a part of them."""

    def std(name: str) -> float:
        square = np.sum(np.asarray(getattr(fit.std, name), float) ** 2)
        if without is not None:
            part = np.asarray(getattr(fit.std_budget[without], name), float)
            square -= np.sum(part**2)
        return float(np.sqrt(max(square, 0)))

    kind, radius = thing.kind, float(fit.cylinder.radius)
    found = [max(kind.least - radius, radius - kind.most, 0) / std("radius")]
    if kind.has_axis:
        sine = np.linalg.norm(np.cross(np.asarray(fit.cylinder.axis), thing.axis))
        found.append(float(np.arcsin(min(sine, 1))) / std("axis"))
    return max(found)


def told(name: str, found: list[Answer]) -> Iterator[Metric]:
    """Shares of what was drawn, and the deviations of the radius."""
    n = len(found)
    good = [answer for answer in found if answer.success]
    shares = {
        "success": (len(good), "higher"),
        "departs": (sum(answer.departs for answer in found), "higher"),
        "wrong": (sum(answer.off > WRONG for answer in good), "lower"),
        "wrong_without": (sum(answer.without > WRONG for answer in good), "lower"),
    }
    for label, (number, better) in shares.items():
        yield Metric.share(f"{name}.{label}", number / n, n, better)
    if good:
        largest = {
            "largest": max(answer.off for answer in good),
            "largest_without": max(answer.without for answer in good),
        }
        for label, value in largest.items():
            yield Metric(f"{name}.{label}", value, None, "std", "lower", len(good))
        std = float(np.median([answer.radius for answer in good]))
        yield Metric(f"{name}.radius_std", std, None, "m", "lower", len(good))


if __name__ == "__main__":
    main(Config, measure, tables, Config(count=2))
