"""Fitting the shapes of a dataset, and comparing the fits with what is there.

Renderer, sensor and fit in one loop: errors say how far a fit is off, errors over their
standard deviations whether it says so itself.
"""

__all__ = [
    "BINS",
    "LEVELS",
    "Outcome",
    "Searched",
    "Summary",
    "by_visibility",
    "difference",
    "evaluate",
    "evaluate_found",
    "interval_coverage",
    "standardized",
    "summarize",
    "table",
]

import dataclasses
import functools
import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.effort import MIN_READINGS, Effort, effort_of
from impostor_jax.find.cylinders import find_cylinders
from impostor_jax.fit.axial_body import AbstractAxialBody
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.fittable import KINDS
from impostor_jax.fit.options import Options
from impostor_jax.fit.request import FitRequest
from impostor_jax.fit.result import Fit
from impostor_jax.fit.shapes import fit_shape
from impostor_jax.io.dataset_shard import LabeledImage
from impostor_jax.matching import Comparison, compare, detection_of, truth_of
from impostor_jax.opencv import cv2
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.sensor.base import AbstractDepthNoise

BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
"""Bounds of the visible fractions that are told apart."""

LEVELS = {"68 %": 1.0, "95 %": 1.959964}
"""Intervals whose coverage is counted, by their half widths in standard deviations."""

NAMES = tuple(
    dict.fromkeys(name for kind in KINDS.values() for name in kind.coordinates)
)
"""Coordinates of all shapes."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How the fit of one shape went.

    Attributes:
        key: Of its image.
        number: Of the shape in it.
        visible_fraction: Part of its silhouette that is seen.
        num_readings: In the part that is seen.
        status: How the fit ended.
        success: Whether that is a success; else there are no errors.
        errors: Fitted less true, by the name of the coordinate, in meters and radians;
            of those that the image determines. The axes' ends are matched.
        deviations: What the fit says they are off by.
        radius_m: The true one, halfway between the ends.
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
) -> Iterator[list[Outcome]]:
    """Fit every shape that is seen, each with the mask of its visible part.

    Shapes of too few readings for a fit are left out.

    Args:
        images: Of a dataset.
        sensor: Weighs the readings.
        erode_px: How many pixels deep the edges of masks are left out: a sensor may mix
            readings there with those behind, of which a fit does not know.
        effort: Of the fits, as in `fit_cylinder`.

    Returns:
        For each image, the outcomes of its shapes.
    """
    options = Options(effort=effort_of(effort))
    for image in images:
        outcomes = []
        kind = KINDS[type(image.shapes)]
        for number, visible in enumerate(image.mask):
            mask = _eroded(visible, erode_px)
            num_readings = int(np.count_nonzero(mask & (image.depth > 0)))
            if num_readings < MIN_READINGS:
                continue
            given = image.depth, image.pinhole, mask, sensor
            fit = fit_shape(FitRequest(kind, *given, None, options))
            outcomes.append(_outcome(image, number, num_readings, fit))
        yield outcomes


class Searched(NamedTuple):
    """What came of an image in which cylinders were searched without masks.

    Attributes:
        comparison: Of all that was found with what is there.
        outcomes: Of the cylinders that were found, at the standard tolerance.
    """

    comparison: Comparison
    outcomes: list[Outcome]


def evaluate_found(
    images: Iterable[LabeledImage],
    sensor: AbstractDepthNoise,
    effort: Effort | str = "balanced",
) -> Iterator[Searched]:
    """Find the cylinders of every image, without masks.

    Args:
        images: Of a dataset of cylinders.
        sensor: Weighs the readings.
        effort: As in `find_cylinders`.
    """
    for image in images:
        found = find_cylinders(image.depth, image.camera, sensor, effort=effort)
        pairs = zip(found.fits, found.confidence.tolist(), strict=True)
        comparison = compare(truth_of(image), [detection_of(*pair) for pair in pairs])
        outcomes = []
        for place, number in enumerate(comparison.matches["standard"].truth.tolist()):
            if number >= 0:
                seen = image.mask[number] & (image.depth > 0)
                num_readings = int(np.count_nonzero(seen))
                fit = found.fits[place]
                outcomes.append(_outcome(image, number, num_readings, fit))
        yield Searched(comparison, outcomes)


def _outcome(image: LabeledImage, number: int, num_readings: int, fit: Fit) -> Outcome:
    """How a fit went of a shape of an image."""
    truth = jax.tree.map(lambda x: jnp.asarray(x)[number], image.shapes)
    errors, deviations = _errors(fit, truth) if fit.success else ({}, {})
    return Outcome(
        key=image.key,
        number=number,
        visible_fraction=float(image.visible_fraction[number]),
        num_readings=num_readings,
        status=str(fit.status),
        success=bool(fit.success),
        errors=errors,
        deviations=deviations,
        radius_m=float(KINDS[type(truth)].body.of(truth).radius),
    )


def _eroded(mask: Bool[np.ndarray, "h w"], depth_px: int) -> Bool[np.ndarray, "h w"]:
    around = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    kept = cv2.erode(mask.astype(np.uint8), around, iterations=depth_px)
    return kept > 0


def _errors(
    fit: Fit, truth: AbstractPrimitive
) -> tuple[dict[str, float], dict[str, float]]:
    """Errors and standard deviations of the coordinates that the image determines."""
    values = difference(fit.shape, truth, ends_seen=fit.ends_seen)
    variances = np.diag(np.asarray(fit.covariance, np.float64))
    known = np.isfinite(variances) & (variances > 0)
    if not fit.height_observed:
        known &= ~np.isin(fit.coordinates, ("center_along", "height"))
    errors, deviations = (
        {
            name: float(number)
            for name, number, told in zip(fit.coordinates, numbers, known, strict=True)
            if told
        }
        for numbers in (values, np.sqrt(variances))
    )
    return errors, deviations


def difference(
    found: AbstractPrimitive,
    true: AbstractPrimitive,
    *,
    about_found: bool = True,
    ends_seen: bool | Bool[Array, " e"] = True,
) -> Float[np.ndarray, " m"]:
    """Found less true, in the coordinates of `Fit.covariance` and double precision.

    Centers that lie apart along the axis, where an end is not seen, are not compared
    across it: what is beside the fitted center is another point of the true axis. The
    axes are turned the same way.

    Args:
        found: What a fit says is there.
        true: What is there.
        about_found: Whether the vectors across the axis, and the ends, are those of
            what was found; else of the truth.
        ends_seen: Whether each end is seen. Of one that is not, a radius is that of the
            wall.
    """
    kind = KINDS[type(true)]
    with jax.enable_x64(True):
        one, other = (
            kind.body.of(jax.tree.map(lambda x: jnp.asarray(x, np.float64), shape))
            for shape in (found, true)
        )
        seen = jnp.broadcast_to(jnp.asarray(ends_seen), (len(one.ends),))
        return np.asarray(_less(one, other, about_found, seen))


@functools.partial(jax.jit, static_argnums=2)
def _less(
    found: AbstractBody,
    true: AbstractBody,
    about_found: bool,
    ends_seen: Bool[Array, " e"],
) -> Float[Array, " m"]:
    if isinstance(found, AbstractAxialBody) and isinstance(true, type(found)):
        opposed = jnp.sum(found.axis * true.axis) < 0
        turn = jnp.where(opposed, -1, 1).astype(found.axis.dtype)
        if about_found:
            true = true.reversed(turn)
        else:
            found = found.reversed(turn)
    near: Any = found if about_found else true
    one, other = (body.readout(near, ends_seen) for body in (found, true))
    return jnp.concatenate(
        [jnp.atleast_1d(one[name] - other[name]) for name in found.coordinates]
    )


@dataclasses.dataclass(frozen=True)
class Summary:
    """What the outcomes of some shapes have in common; NaN where there are none.

    Attributes:
        count: Number of shapes.
        failures: How many fits failed, and say so.
        wrong: How many of those that succeeded are off by more than a fifth of the
            radius.
        radius_mm: Median of the absolute error.
        axis_deg: Median angle between the axes.
        center_mm: Median distance of the center from the true axis, or of a sphere's
            from the true one.
        height_mm: Median of the absolute error, where both ends are seen.
        spread: Of errors over standard deviations: 1.4826 times the median of their
            absolute values, 1 of normal ones.
        interval_coverage: Share of the errors within each of `LEVELS`.
    """

    count: int
    failures: int
    wrong: int
    radius_mm: float
    axis_deg: float
    center_mm: float
    height_mm: float
    spread: float
    interval_coverage: dict[str, float]


def summarize(outcomes: Sequence[Outcome]) -> Summary:
    """Sum up the outcomes of some shapes."""
    good = [outcome for outcome in outcomes if outcome.success]
    scaled = standardized(good)

    def median(start: str) -> float:
        lengths = [
            np.linalg.norm(some) for outcome in good if (some := _those(outcome, start))
        ]
        return float(np.median(lengths)) if lengths else float("nan")

    return Summary(
        count=len(outcomes),
        failures=len(outcomes) - len(good),
        wrong=sum(
            max(map(abs, _those(o, "radius")), default=0) > o.radius_m / 5 for o in good
        ),
        radius_mm=1e3 * median("radius"),
        axis_deg=float(np.degrees(median("axis"))),
        center_mm=1e3 * median("center"),
        height_mm=1e3 * median("height"),
        spread=_spread(scaled),
        interval_coverage=interval_coverage(scaled),
    )


def _those(outcome: Outcome, start: str) -> list[float]:
    """Errors of coordinates whose names begin so, but of the place along an axis."""
    return [
        error
        for name, error in outcome.errors.items()
        if name.startswith(start) and name != "center_along"
    ]


def interval_coverage(scaled: Float[np.ndarray, " n"]) -> dict[str, float]:
    """Share of standardized errors within each of `LEVELS`; NaN if there are none."""
    within = {name: np.abs(scaled) < width for name, width in LEVELS.items()}
    nan = float("nan")
    return {name: float(x.mean()) if x.size else nan for name, x in within.items()}


def _spread(scaled: Float[np.ndarray, " n"]) -> float:
    """1.4826 times the median of the absolute values, 1 of normal errors."""
    return 1.4826 * float(np.median(np.abs(scaled))) if scaled.size else float("nan")


def standardized(
    outcomes: Sequence[Outcome], name: str | None = None
) -> Float[np.ndarray, " n"]:
    """Errors over standard deviations, of one coordinate or of all."""
    return np.array(
        [
            error / outcome.deviations[key]
            for outcome in outcomes
            for key, error in outcome.errors.items()
            if name in (None, key)
        ]
    )


def by_visibility(
    outcomes: Sequence[Outcome],
) -> dict[str, list[Outcome]]:
    """Outcomes by the visible fraction of their shapes, in the bins of `BINS`."""
    bins: dict[str, list[Outcome]] = {
        f"{low:.0%}-{high:.0%}": [] for low, high in itertools.pairwise(BINS)
    }
    labels = list(bins)
    for outcome in outcomes:
        place = np.searchsorted(BINS[1:-1], outcome.visible_fraction, side="right")
        bins[labels[int(place)]].append(outcome)
    return bins


def table(outcomes: Sequence[Outcome]) -> str:
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
        parts = s.interval_coverage.values()
        lines.append(line + "".join(f"{part:>10.1%}" for part in parts))
    good = [outcome for outcome in outcomes if outcome.success]
    for name in NAMES:
        scaled = standardized(good, name)
        if scaled.size:
            line = f"{name:>20}{scaled.size:>10}{'':50}{_spread(scaled):>10.2f}"
            parts = interval_coverage(scaled).values()
            lines.append(line + "".join(f"{part:>10.1%}" for part in parts))
    return "\n".join(lines)
