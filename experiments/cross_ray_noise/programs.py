"""The radius of a wall from the same readings: ours, and what is done with points."""

__all__ = ["OURS", "PRACTICE", "Estimate", "Program"]

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

import impostor_jax as ij
from experiments.cross_ray_noise.scenes import Wall, across


class Estimate(NamedTuple):
    """What a program says of a wall.

    Attributes:
        radius: In meters.
        deviation: That it reports, in meters.
    """

    radius: float
    deviation: float


Program: TypeAlias = Callable[[Wall], Estimate | None]
"""None where it fails."""


def _learned(wall: Wall) -> Estimate | None:
    return _fitted(wall, ij.ConstantNoise(wall.errors.along))


def _told(wall: Wall) -> Estimate | None:
    return _fitted(wall, wall.errors.told())


def _exact(wall: Wall) -> Estimate | None:
    return _fitted(wall, ij.ConstantNoise(wall.errors.along, across=0.0, angle=0.0))


def _fitted(wall: Wall, noise: ij.ConstantNoise) -> Estimate | None:
    if wall.depth is None or wall.camera is None:
        fit = ij.fit_cylinder_to_points(wall.points, (0.0, 0.0, 0.0), sigma=noise)
    else:
        fit = ij.fit_cylinder(wall.depth, wall.camera, mask=wall.mask, sigma=noise)
    if not bool(fit.success):
        return None
    return Estimate(float(fit.cylinder.radius), float(fit.std.radius))


def _orthogonal(wall: Wall) -> Estimate | None:
    """Least squares of the distances to the wall, from the truth."""
    basis = np.stack(across(wall.axis))

    def distances(moved: Float[np.ndarray, "5"]) -> Float[np.ndarray, " n"]:
        axis = wall.axis + moved[2:4] @ basis
        axis /= np.linalg.norm(axis)
        away = wall.points - wall.center - moved[:2] @ basis
        away = away - (away @ axis)[:, None] * axis
        return np.linalg.norm(away, axis=1) - wall.radius - moved[4]

    return _least(distances, np.zeros(5), wall.radius)


def _circle(wall: Wall) -> Estimate | None:
    """A circle through the readings seen along the true axis."""
    places = (wall.points - wall.center) @ np.stack(across(wall.axis)).T

    def distances(moved: Float[np.ndarray, "3"]) -> Float[np.ndarray, " n"]:
        return np.linalg.norm(places - moved[:2], axis=1) - wall.radius - moved[2]

    return _least(distances, np.zeros(3), wall.radius)


def _least(
    distances: Callable, begin: Float[np.ndarray, " k"], radius: float
) -> Estimate | None:
    """The radius is the last coordinate, told as its change; noise is what is left."""
    found = least_squares(distances, begin, method="lm", x_scale="jac")
    if not found.success:
        return None
    level = np.sum(found.fun**2) / (len(found.fun) - len(begin))
    covariance = level * np.linalg.inv(found.jac.T @ found.jac)
    return Estimate(radius + float(found.x[-1]), float(np.sqrt(covariance[-1, -1])))


OURS: dict[str, Program] = {"learned": _learned, "told": _told, "exact rays": _exact}
"""Given the error along the ray, all errors, and that across wrongly as none."""

PRACTICE: dict[str, Program] = {"orthogonal": _orthogonal, "circle": _circle}
"""Of SciPy: the error is that of the residuals."""
