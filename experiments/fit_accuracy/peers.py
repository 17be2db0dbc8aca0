"""Fits of a cylinder to points by other programs (extra `bench`)."""

__all__ = ["PEERS", "points_of"]

import random
from collections.abc import Callable

import cylfit  # pyright: ignore[reportMissingImports]
import numpy as np
import pyransac3d  # pyright: ignore[reportMissingImports]
import skspatial.objects  # pyright: ignore[reportMissingImports]
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

import impostor_jax as ij
from impostor_jax.geometry.so3 import tangent_basis

Line = tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], float]
"""A point on the axis, the axis and the radius."""

TRIALS = 1000
"""Samples that a random search may draw."""


def points_of(
    depth: Float[np.ndarray, "h w"],
    used: Bool[np.ndarray, "h w"],
    camera: ij.PinholeCamera,
) -> Float[np.ndarray, "n 3"]:
    """Points of an image without a lens, in the camera frame."""
    row, col = np.nonzero(used)
    matrix, z = camera.matrix(), depth[used].astype(float)
    x, y = (col - matrix[0, 2]) / matrix[0, 0], (row - matrix[1, 2]) / matrix[1, 1]
    return np.stack([x * z, y * z, z], axis=1)


def _scipy(points, sigma: float, truth: ij.Cylinder) -> Line:
    """Orthogonal distance with the soft L1 loss, started at the truth."""
    center, axis = (np.asarray(v, float) for v in (truth.center, truth.axis))
    basis = np.asarray(tangent_basis(truth.axis), float)

    def line(vector) -> Line:
        a = axis + vector[:2] @ basis
        point = center + vector[2:4] @ basis
        return point, a / np.linalg.norm(a), float(vector[4])

    def distances(vector):
        point, a, radius = line(vector)
        return np.linalg.norm(np.cross(points - point, a), axis=1) - radius

    begin = np.array([0, 0, 0, 0, float(truth.radius)])
    found = least_squares(
        distances, begin, loss="soft_l1", f_scale=2 * sigma, x_scale="jac"
    )
    return line(found.x)


def _cylfit(points, sigma: float, truth: ij.Cylinder) -> Line:
    del truth
    found = cylfit.fit_cylinder(points, threshold=3 * sigma, random_state=0)
    return found.axis_point, found.axis_direction, found.radius


def _scikit_spatial(points, sigma: float, truth: ij.Cylinder) -> Line:
    del sigma, truth
    found = skspatial.objects.Cylinder.best_fit(points)
    return np.asarray(found.point), np.asarray(found.vector.unit()), found.radius


def _pyransac3d(points, sigma: float, truth: ij.Cylinder) -> Line:
    del truth
    random.seed(0)
    found = pyransac3d.Cylinder().fit(points, 3 * sigma, maxIteration=TRIALS)
    return np.asarray(found.center), np.asarray(found.axis), float(found.radius)


PEERS: dict[str, Callable[..., Line]] = {
    "scipy": _scipy,
    "cylfit": _cylfit,
    "scikit-spatial": _scikit_spatial,
    "pyransac3d": _pyransac3d,
}
"""By name: a fit to points (n, 3), given the sensor's deviation and the truth."""
