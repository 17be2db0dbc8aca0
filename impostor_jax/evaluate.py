"""Fitting the cylinders of a dataset, and comparing the fits with what is there.

Renderer, sensor and fit in one loop: errors say how far a fit is off, errors over their
deviations whether it says so itself.
"""

__all__ = [
    "BINS",
    "LEVELS",
    "CylinderOutcome",
    "Summary",
    "by_visibility",
    "coverage",
    "evaluate",
    "standardized",
    "summarize",
    "table",
]

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Sequence

import cv2
import jax
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.effort import Effort
from impostor_jax.fit.cylinder import fit_cylinder
from impostor_jax.fit.parameterization import COORDINATES
from impostor_jax.fit.request import MIN_READINGS
from impostor_jax.fit.result import FitResult
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.io.dataset_shard import LabeledImage
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.sensor.base import AbstractDepthNoise

BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
"""Bounds of the visible fractions that are told apart."""

LEVELS = {"68 %": 1.0, "95 %": 1.959964}
"""Intervals whose coverage is counted, by their half widths in deviations."""


@dataclasses.dataclass(frozen=True)
class CylinderOutcome:
    """How the fit of one cylinder went.

    Attributes:
        key: Of its image.
        number: Of the cylinder in it.
        visible_fraction: Part of its silhouette that is seen.
        num_readings: In the part that is seen.
        status: How the fit ended.
        success: Whether that is a success; else there are no errors.
        errors: Fitted less true, by the name of the coordinate, in meters and radians;
            of those that the image determines. The axes' ends are matched.
        deviations: What the fit says they are off by.
        radius_m: The true one.
    """

    key: str
    number: int
    visible_fraction: float
    num_readings: int
    status: str
    success: bool
    errors: dict[str, float]
    deviations: dict[str, float]
    radius_m: float


def evaluate(
    images: Iterable[LabeledImage],
    sensor: AbstractDepthNoise,
    erode_px: int = 0,
    effort: Effort | str = "balanced",
) -> Iterator[list[CylinderOutcome]]:
    """Fit every cylinder that is seen, each with the mask of its visible part.

    Cylinders of too few readings for a fit are left out.

    Args:
        images: Of a dataset.
        sensor: Weighs the readings.
        erode_px: How many pixels deep the edges of masks are left out: a sensor may mix
            readings there with those behind, of which a fit does not know.
        effort: Of the fits, as in `fit_cylinder`.

    Returns:
        For each image, the outcomes of its cylinders.
    """
    for image in images:
        outcomes = []
        for number, visible in enumerate(image.mask):
            mask = _eroded(visible, erode_px)
            num_readings = int(np.count_nonzero(mask & (image.depth > 0)))
            if num_readings < MIN_READINGS:
                continue
            fit = fit_cylinder(
                image.depth, image.camera, mask=mask, sigma=sensor, effort=effort
            )
            truth = jax.tree.map(lambda x, k=number: np.asarray(x)[k], image.cylinders)
            errors, deviations = _errors(fit, truth) if fit.success else ({}, {})
            outcome = CylinderOutcome(
                key=image.key,
                number=number,
                visible_fraction=float(image.visible_fraction[number]),
                num_readings=num_readings,
                status=str(fit.status),
                success=bool(fit.success),
                errors=errors,
                deviations=deviations,
                radius_m=float(truth.radius),
            )
            outcomes.append(outcome)
        yield outcomes


def _eroded(mask: Bool[np.ndarray, "h w"], depth_px: int) -> Bool[np.ndarray, "h w"]:
    around = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    kept = cv2.erode(mask.astype(np.uint8), around, iterations=depth_px)
    return kept > 0


def _errors(
    fit: FitResult, truth: Cylinder
) -> tuple[dict[str, float], dict[str, float]]:
    """Errors and deviations of the coordinates that the image determines."""
    found = jax.tree.map(lambda x: np.asarray(x, np.float64), fit.cylinder)
    first, second = np.asarray(tangent_basis(fit.cylinder.axis), np.float64)
    axis = np.asarray(truth.axis, np.float64)
    axis = axis / np.linalg.norm(axis)
    sign = 1.0 if axis @ found.axis >= 0 else -1.0
    offset = found.center - truth.center
    # Centers that lie apart along the axis, where an end is not seen, are not compared
    # across it: what is beside the fitted center is another point of the true axis.
    across = offset - (offset @ axis) * axis
    values = {
        # From the true axis to the fitted one.
        "axis_first": -sign * (axis @ first),
        "axis_second": -sign * (axis @ second),
        "center_first": across @ first,
        "center_second": across @ second,
        "center_along": offset @ found.axis,
        "radius": found.radius - truth.radius,
        "height": found.height - truth.height,
    }
    variances = np.diag(np.asarray(fit.covariance, np.float64))
    known = [k for k, v in enumerate(variances) if np.isfinite(v) and v > 0]
    if not bool(fit.ends_seen.all()):
        known = [k for k in known if COORDINATES[k] not in ("center_along", "height")]
    names = [COORDINATES[k] for k in known]
    deviations = {COORDINATES[k]: float(np.sqrt(variances[k])) for k in known}
    return {name: float(values[name]) for name in names}, deviations


@dataclasses.dataclass(frozen=True)
class Summary:
    """What the outcomes of some cylinders have in common; NaN where there are none.

    Attributes:
        count: Number of cylinders.
        failures: How many fits failed, and say so.
        wrong: How many of those that succeeded are off by more than a fifth of the
            radius.
        radius_mm: Median of the absolute error.
        axis_deg: Median angle between the axes.
        center_mm: Median distance of the center from the true axis.
        height_mm: Median of the absolute error, where both ends are seen.
        spread: Of errors over deviations: 1.4826 times the median of their absolute
            values, 1 of normal ones.
        coverage: Share of the errors within each of `LEVELS`.
    """

    count: int
    failures: int
    wrong: int
    radius_mm: float
    axis_deg: float
    center_mm: float
    height_mm: float
    spread: float
    coverage: dict[str, float]


def summarize(outcomes: Sequence[CylinderOutcome]) -> Summary:
    """Sum up the outcomes of some cylinders."""
    good = [outcome for outcome in outcomes if outcome.success]
    scaled = standardized(good)

    def median(*names: str) -> float:
        lengths = [
            np.linalg.norm([outcome.errors[name] for name in names])
            for outcome in good
            if all(name in outcome.errors for name in names)
        ]
        return float(np.median(lengths)) if lengths else float("nan")

    return Summary(
        count=len(outcomes),
        failures=len(outcomes) - len(good),
        wrong=sum(abs(o.errors.get("radius", 0.0)) > o.radius_m / 5 for o in good),
        radius_mm=1e3 * median("radius"),
        axis_deg=float(np.degrees(median("axis_first", "axis_second"))),
        center_mm=1e3 * median("center_first", "center_second"),
        height_mm=1e3 * median("height"),
        spread=_spread(scaled),
        coverage=coverage(scaled),
    )


def coverage(scaled: Float[np.ndarray, " n"]) -> dict[str, float]:
    """Share of standardized errors within each of `LEVELS`; NaN if there are none."""
    within = {name: np.abs(scaled) < width for name, width in LEVELS.items()}
    nan = float("nan")
    return {name: float(x.mean()) if x.size else nan for name, x in within.items()}


def _spread(scaled: Float[np.ndarray, " n"]) -> float:
    """1.4826 times the median of the absolute values, 1 of normal errors."""
    return 1.4826 * float(np.median(np.abs(scaled))) if scaled.size else float("nan")


def standardized(
    outcomes: Sequence[CylinderOutcome], name: str | None = None
) -> Float[np.ndarray, " n"]:
    """Errors over deviations, of one coordinate or of all."""
    return np.array(
        [
            error / outcome.deviations[key]
            for outcome in outcomes
            for key, error in outcome.errors.items()
            if name in (None, key)
        ]
    )


def by_visibility(
    outcomes: Sequence[CylinderOutcome],
) -> dict[str, list[CylinderOutcome]]:
    """Outcomes by the visible fraction of their cylinders, in the bins of `BINS`."""
    bins: dict[str, list[CylinderOutcome]] = {
        f"{low:.0%}-{high:.0%}": [] for low, high in itertools.pairwise(BINS)
    }
    labels = list(bins)
    for outcome in outcomes:
        place = np.searchsorted(BINS[1:-1], outcome.visible_fraction, side="right")
        bins[labels[int(place)]].append(outcome)
    return bins


def table(outcomes: Sequence[CylinderOutcome]) -> str:
    """Table of the outcomes by visibility, and of the coverage by coordinate."""
    titles = ("visible", "number", "failed", "wrong", "radius mm", "axis deg")
    titles += ("center mm", "height mm", "spread", *LEVELS)
    lines = ["".join(f"{title:>10}" for title in titles)]
    for title, some in [*by_visibility(outcomes).items(), ("all", outcomes)]:
        if not some:
            continue
        s = summarize(some)
        numbers = (s.radius_mm, s.axis_deg, s.center_mm, s.height_mm)
        line = f"{title:>10}{s.count:>10}{s.failures:>10}{s.wrong:>10}"
        line += "".join(f"{number:>10.3f}" for number in numbers)
        line += f"{s.spread:>10.2f}"
        lines.append(line + "".join(f"{part:>10.1%}" for part in s.coverage.values()))
    good = [outcome for outcome in outcomes if outcome.success]
    for name in COORDINATES:
        scaled = standardized(good, name)
        if scaled.size:
            line = f"{name:>20}{scaled.size:>10}{'':50}{_spread(scaled):>10.2f}"
            parts = coverage(scaled).values()
            lines.append(line + "".join(f"{part:>10.1%}" for part in parts))
    return "\n".join(lines)
