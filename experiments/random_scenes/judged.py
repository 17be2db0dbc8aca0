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
"""Deviations from which a fit is wrong."""

GROSS = 10.0
"""Those from which it is grossly so."""


@dataclasses.dataclass(frozen=True)
class Judged:
    """A fit beside the truth.

    Attributes:
        seed: Of the scene.
        status: How the fit ended.
        off: Largest error of what is compared, in the fit's own deviations.
        axis_deg: Error of the axis.
        milliseconds: Time that the fit took.
    """

    seed: int
    status: str
    off: float
    axis_deg: float
    milliseconds: float


def judge(view: View, seed: int) -> Judged:
    """Fit a scene with its exact mask, as a user would, and compare."""
    start = time.perf_counter()
    fit = jax.block_until_ready(
        ij.fit_cylinder(view.depth, CAMERA, mask=view.mask, sigma=SENSOR)
    )
    seconds = time.perf_counter() - start
    assert isinstance(view.shape, ij.Cylinder)
    cosine = abs(np.dot(np.asarray(fit.cylinder.axis), np.asarray(view.shape.axis)))
    return Judged(
        seed=seed,
        status=str(fit.status),
        off=_deviations_off(fit, view.shape),
        axis_deg=float(np.degrees(np.arccos(min(cosine, 1.0)))),
        milliseconds=1e3 * seconds,
    )


def _deviations_off(fit: ij.Fit, truth: ij.Cylinder) -> float:
    """Largest error of what is compared, in the fit's own standard deviations."""
    deviations = np.sqrt(np.diagonal(np.asarray(fit.covariance, float)))
    scaled = np.abs(error(fit.cylinder, truth)) / deviations
    return float(np.max(scaled[COMPARED]))
