"""Fits of many images by one program, and their errors beside the bound."""

__all__ = ["NORMAL_95", "Fits", "bias", "fit_all", "in_turn", "over_bound"]

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import jax
import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.errors import bound, error
from experiments.recording import Metric
from experiments.scenes import Shape, View

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
