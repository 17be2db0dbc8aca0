"""Fits of many images by one program, and their errors beside the bound."""

__all__ = [
    "NORMAL_95",
    "Fits",
    "bias",
    "fit_all",
    "fit_cylinder",
    "in_turn",
    "inside",
    "over_bound",
    "rmse",
    "tested",
]

import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

import jax
import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.errors import bound, error
from experiments.recording import Metric
from experiments.scenes import CAMERA, Shape, View

NORMAL_95 = 1.96
"""Half the width of the 95 percent interval of a normal deviate."""

Case = TypeVar("Case")
Said = TypeVar("Said")


@dataclasses.dataclass(frozen=True)
class Fits:
    """Those that succeeded.

    Attributes:
        views: What they are of.
        errors: Estimate less truth.
        deviations: That were reported; none where a program reports none.
        failures: Number of views without a fit.
        milliseconds: Median time of a fit.
    """

    views: list[View]
    errors: Float[np.ndarray, "n k"]
    deviations: Float[np.ndarray, "m c"]
    failures: int
    milliseconds: float

    def bounds(self, **options: Any) -> Float[np.ndarray, "n k"]:
        """The bound of each view."""
        return np.array([bound(view, **options) for view in self.views])

    def counts(self, label: str) -> Iterator[Metric]:
        """Failures and time."""
        n = len(self.views) + self.failures
        yield Metric(f"{label}.failures", self.failures, None, "images", "lower", n)
        yield Metric(f"{label}.time", self.milliseconds, None, "ms", "lower", n)


def fit_all(
    fit: Callable[[View], ij.Fit | Shape | None], views: Sequence[View]
) -> Fits:
    """Fit each view, and take the time.

    Args:
        fit: Fits, or finds a shape; None where it fails.
        views: The images.
    """
    good, shapes, deviations, seconds = [], [], [], []
    for view in views:
        start = time.perf_counter()
        found = jax.block_until_ready(fit(view))
        seconds.append(time.perf_counter() - start)
        if found is None or (isinstance(found, ij.Fit) and not found.success):
            continue
        good.append(view)
        if isinstance(found, ij.Fit):
            deviations.append(np.sqrt(np.diagonal(np.asarray(found.covariance))))
            found = found.shape
        shapes.append(found)
    pairs = zip(shapes, good, strict=True)
    return Fits(
        views=good,
        errors=np.array([error(shape, view.shape) for shape, view in pairs]),
        deviations=np.array(deviations),
        failures=len(views) - len(good),
        milliseconds=1e3 * float(np.median(seconds)),
    )


def fit_cylinder(view: View, **options: Any) -> ij.Fit:
    """Fit a view as a user would, with no start."""
    return ij.fit_cylinder(
        view.depth, CAMERA, mask=view.mask, sigma=view.sigma, **options
    )


def in_turn(
    program: Callable[[Case], Said], cases: Sequence[Case]
) -> tuple[list[Said], float]:
    """What a program says of each case, and the median time in milliseconds."""
    program(cases[0])  # compiles, which takes no part in its time
    said, seconds = [], []
    for case in cases:
        start = time.perf_counter()
        said.append(program(case))
        seconds.append(time.perf_counter() - start)
    return said, 1e3 * float(np.median(seconds))


def over_bound(
    name: str, errors: Float[np.ndarray, " n"], bounds: Float[np.ndarray, " n"]
) -> Metric:
    """Root mean square of a coordinate's errors over that of their bounds."""
    n = len(errors)
    ratio = float(np.sqrt(np.mean(errors**2) / np.mean(bounds**2)))
    return Metric(name, ratio, ratio / np.sqrt(2 * n), "1", "lower", n)


def bias(name: str, errors: Float[np.ndarray, " n"]) -> Metric:
    """Mean error of a coordinate over the spread of its errors."""
    n = len(errors)
    value = float(np.mean(errors) / np.std(errors))
    return Metric(name, value, float(1 / np.sqrt(n)), "1", "lower", n)


def rmse(
    name: str, errors: Float[np.ndarray, " n"], unit: str, scale: float = 1
) -> Metric:
    """Root mean square of a coordinate's errors, which are multiplied by `scale`."""
    n = len(errors)
    if n == 0:
        return Metric(name, None, None, unit, "lower", 0)
    value = scale * float(np.sqrt(np.mean(errors**2)))
    return Metric(name, value, value / np.sqrt(2 * n), unit, "lower", n)


def inside(
    name: str, errors: Float[np.ndarray, " *n"], deviations: Float[np.ndarray, " *n"]
) -> Metric:
    """Part of the 95 percent intervals that hold the truth, of those that end."""
    known = np.isfinite(deviations)
    holds = np.abs(errors[known]) <= NORMAL_95 * deviations[known]
    part = float(np.mean(holds)) if holds.size else None
    return Metric.share(name, part, holds.size)


def tested(
    label: str,
    tests: Iterable[ij.BoreTest | ij.TaperTest],
    is_needed: bool,
    statistics: Mapping[str, float],
) -> Iterator[Metric]:
    """How often another shape is taken to be needed at the 1 % level.

    Args:
        label: Of the case.
        tests: Of its images.
        is_needed: Whether it is.
        statistics: Percentiles of the statistic that are told, by their names.
    """
    pairs = [(bool(test.is_needed()), float(test.statistic)) for test in tests]
    n, better = len(pairs), "higher" if is_needed else "lower"
    needed, values = np.array(pairs).T
    known = values[np.isfinite(values)]
    yield Metric.share(f"{label}.needed", float(np.mean(needed)), n, better)
    yield Metric(f"{label}.failures", n - len(known), None, "images", "lower", n)
    for name, percent in statistics.items():
        value = float(np.percentile(known, percent))
        yield Metric(f"{label}.statistic.{name}", value, None, "1", better, len(known))
