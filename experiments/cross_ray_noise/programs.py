"""Radii of the same readings: ours, told more or less, and those of others."""

__all__ = ["PROGRAMS", "Estimate", "Program", "is_for"]

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

import impostor_jax as ij
from experiments.cross_ray_noise.scenes import Case, Reading
from impostor_jax.camera.ray_table import turned_to


class Estimate(NamedTuple):
    """What a program says.

    Attributes:
        radius: In meters.
        deviation: That it reports, in meters; NaN where it reports none.
        across: Error across the rays that it found, in meters; NaN likewise.
    """

    radius: float
    deviation: float = np.nan
    across: float = np.nan


Program: TypeAlias = Callable[[Case, Reading], Estimate | None]
"""None where it fails."""


def _fitted(reading: Reading, sigma: ij.ConstantNoise) -> Estimate | None:
    if reading.depth is None:
        fit = ij.fit_cylinder_to_points(reading.points, reading.origin, sigma)
    else:
        assert reading.camera is not None
        fit = ij.fit_cylinder(reading.depth, reading.camera, reading.mask, sigma)
    if not bool(fit.success):
        return None
    of_fit = fit.cylinder.radius, fit.std.radius, fit.across.deviation
    return Estimate(*map(float, of_fit))


def _learned(case: Case, reading: Reading) -> Estimate | None:
    return _fitted(reading, ij.ConstantNoise(case.noise))


def _told(case: Case, reading: Reading) -> Estimate | None:
    return _fitted(reading, ij.ConstantNoise(case.noise, **(case.told or {})))


def _exact(case: Case, reading: Reading) -> Estimate | None:
    return _fitted(reading, ij.ConstantNoise(case.noise, across=0.0))


def _orthogonal(_: Case, reading: Reading) -> Estimate | None:
    """Least squares of the distances from the wall, from the true one."""
    frame = turned_to(np.asarray(reading.truth.axis, np.float64))
    points = (reading.points - np.asarray(reading.truth.center)) @ frame.T

    def distances(wall: Float[np.ndarray, "5"]) -> Float[np.ndarray, " n"]:
        x, y, tilt_x, tilt_y, radius = wall
        axis = np.array([tilt_x, tilt_y, 1.0]) / np.hypot(1, np.hypot(tilt_x, tilt_y))
        away = points - np.array([x, y, 0.0])
        return np.linalg.norm(np.cross(away, axis), axis=1) - radius

    start = np.array([0.0, 0.0, 0.0, 0.0, float(reading.truth.radius)])
    found = least_squares(distances, start, method="lm")
    if not found.success:
        return None
    scatter = 2 * found.cost / (len(points) - 5)
    covariance = scatter * np.linalg.inv(found.jac.T @ found.jac)
    return Estimate(abs(float(found.x[4])), float(np.sqrt(covariance[4, 4])))


def _circle(_: Case, reading: Reading) -> Estimate | None:
    """Through all points, seen along the true axis (Kasa's)."""
    frame = turned_to(np.asarray(reading.truth.axis, np.float64))
    flat = (reading.points - reading.points.mean(axis=0)) @ frame[:2].T
    x, y = flat.T
    design = np.stack([x, y, np.ones_like(x)], axis=1)
    a, b, c = np.linalg.lstsq(design, x**2 + y**2)[0]
    return Estimate(float(np.sqrt(c + (a**2 + b**2) / 4)))


PROGRAMS: dict[str, Program] = {
    "learned": _learned,
    "told": _told,
    "exact": _exact,
    "orthogonal": _orthogonal,
    "circle": _circle,
}
"""Ours as users call it, told what errs, and told that rays are exact; others."""


def is_for(name: str, case: Case) -> bool:
    """Whether a program has a case: not every error has a word, nor every end a wall.

    Args:
        name: Of the program.
        case: An image shows a can's end, too, which others take for its wall.
    """
    if name == "told":
        return case.told is not None
    return case.source != "image" or name in ("learned", "exact")
