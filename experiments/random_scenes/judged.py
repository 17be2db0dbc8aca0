"""Whether a fit of a random scene is right, and whether it says what it is."""

__all__ = ["FAR", "GROSS", "Judged", "judge"]

import dataclasses
import time

import jax
import numpy as np

import impostor_jax as ij
from experiments.errors import error
from experiments.scenes import CAMERA, SENSOR, View
from impostor_jax.fit.fittable import CYLINDER

COMPARED = [
    place
    for place, name in enumerate(CYLINDER.coordinates)
    if name not in ("center_along", "height")
]
"""Coordinates that do not depend on the ends, which may be out of sight."""

FAR = 5.0
"""Deviations beyond which a fit is wrong."""

GROSS = 10.0
"""Those beyond which it is another cylinder."""


@dataclasses.dataclass(frozen=True)
class Judged:
    """A fit beside the truth.

    Attributes:
        seed: Of the scene.
        status: How the fit ended.
        off: Largest error of what is compared, in the fit's own deviations.
        axis_deg: Error of the axis.
        is_told: Whether the truth is the solution or one of the alternatives.
        milliseconds: Time that the fit took.
    """

    seed: int
    status: str
    off: float
    axis_deg: float
    is_told: bool
    milliseconds: float

    @property
    def is_wrong(self) -> bool:
        """Whether it is called a success, and is none."""
        return self.status == ij.FitStatus.CONVERGED and not self.off <= FAR


def judge(view: View, seed: int) -> Judged:
    """Fit a scene with its exact mask, as a user would, and compare."""
    start = time.perf_counter()
    fit = jax.block_until_ready(_fit(view))
    seconds = time.perf_counter() - start
    assert isinstance(view.shape, ij.Cylinder)
    cosine = abs(np.dot(np.asarray(fit.cylinder.axis), np.asarray(view.shape.axis)))
    return Judged(
        seed=seed,
        status=str(fit.status),
        off=_deviations_off(fit, view.shape),
        axis_deg=float(np.degrees(np.arccos(min(cosine, 1.0)))),
        is_told=_is_told(fit, view),
        milliseconds=1e3 * seconds,
    )


def _fit(view: View, initial: ij.Cylinder | None = None) -> ij.Fit:
    return ij.fit_cylinder(
        view.depth, CAMERA, mask=view.mask, sigma=SENSOR, initial=initial
    )


def _is_told(fit: ij.Fit, view: View) -> bool:
    """Whether a solution, alone, is within its own deviations of the truth."""
    assert isinstance(view.shape, ij.Cylinder)
    weights = np.asarray(fit.alternatives.weight)
    if not weights.any():
        return _deviations_off(fit, view.shape) <= FAR
    others = [
        jax.tree.map(lambda part, k=k: part[k], fit.alternatives.shape)
        for k in np.flatnonzero(weights)
    ]
    # From a start a fit knows one solution, and no other widens its deviations.
    alone = (_fit(view, start) for start in (fit.cylinder, *others))
    return any(_deviations_off(one, view.shape) <= FAR for one in alone)


def _deviations_off(fit: ij.Fit, truth: ij.Cylinder) -> float:
    """Largest error of what is compared, in the fit's own standard deviations."""
    deviations = np.sqrt(np.diagonal(np.asarray(fit.covariance, float)))
    scaled = np.abs(error(fit.cylinder, truth)) / deviations
    return float(np.max(scaled[COMPARED]))
