"""Diameters of a stem from the same readings: ours, and what others do with points."""

__all__ = ["OURS", "PEERS", "PRACTICE", "Estimate", "Program"]

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

import impostor_jax as ij
from experiments.find_accuracy.peers.clouds import PCL
from experiments.find_accuracy.peers.compiling import cylinders_of
from experiments.stem_diameters.stems import BREAST_HEIGHT, SCANNER_HEIGHT, Scan
from impostor_jax.fit.options import Errors

SLICE = 0.1
"""Height of a slice whose points are taken for a circle, in meters."""

FEWEST = 6
"""Points of a slice: twice what a circle needs."""

PCL_RADII = (0.025, 0.5)
"""That PCL is allowed, in meters: half the least and twice the largest."""


class Estimate(NamedTuple):
    """What a program says of a stem.

    Attributes:
        diameter: In meters.
        deviation: That it reports, in meters; NaN where it reports none.
    """

    diameter: float
    deviation: float = np.nan


Program: TypeAlias = Callable[[Scan], Estimate | None]
"""None where it fails."""


def _image(scan: Scan, errors: Errors = "independent") -> Estimate | None:
    view = scan.view
    fit = ij.fit_cylinder(
        view.depth, scan.camera, mask=view.mask, sigma=view.sigma, errors=errors
    )
    return _estimate_of(fit)


def _correlated(scan: Scan) -> Estimate | None:
    return _image(scan, "correlated")


def _points(scan: Scan) -> Estimate | None:
    origin = (0.0, 0.0, 0.0)
    fit = ij.fit_cylinder_to_points(scan.points, origin, sigma=scan.view.sigma)
    return _estimate_of(fit)


def _estimate_of(fit: ij.Fit) -> Estimate | None:
    if not bool(fit.success):
        return None
    return Estimate(2 * float(fit.cylinder.radius), 2 * float(fit.std.radius))


def _circle(scan: Scan) -> Estimate | None:
    """Through the slice at breast height, in a level plane."""
    height = SCANNER_HEIGHT - scan.points[:, 1]
    return _circle_between(scan, height, BREAST_HEIGHT - SLICE / 2)


def _slices(scan: Scan) -> Estimate | None:
    """The median of the circles of all slices: as many readings as a cylinder has."""
    height = SCANNER_HEIGHT - scan.points[:, 1]
    lows = np.arange(height.min(), height.max() - SLICE, SLICE)
    found = [_circle_between(scan, height, low) for low in lows]
    diameters = [circle.diameter for circle in found if circle is not None]
    return Estimate(float(np.median(diameters))) if diameters else None


def _circle_between(
    scan: Scan, height: Float[np.ndarray, " n"], low: float
) -> Estimate | None:
    """Least squares of the distances, from the algebraic circle of Kasa."""
    points = scan.points[(height >= low) & (height < low + SLICE)][:, ::2]
    if len(points) < FEWEST:
        return None
    middle = points.mean(axis=0)
    x, y = (points - middle).T
    design = np.stack([x, y, np.ones_like(x)], axis=1)
    a, b, c = np.linalg.lstsq(design, x**2 + y**2, rcond=None)[0]
    begin = np.array([a / 2, b / 2, np.sqrt(c + (a**2 + b**2) / 4)])

    def distances(circle: Float[np.ndarray, "3"]) -> Float[np.ndarray, " m"]:
        return np.hypot(x - circle[0], y - circle[1]) - circle[2]

    found = least_squares(distances, begin, method="lm")
    return Estimate(2 * abs(float(found.x[2]))) if found.success else None


def _cylfit(scan: Scan) -> Estimate | None:
    # Where the extra `bench` is not installed, the others are measured.
    from experiments.fit_accuracy.peers import PEERS as BY_NAME

    try:
        _, _, radius = BY_NAME["cylfit"](scan.points, scan.view.sigma, scan.view.shape)
    except Exception:
        return None
    return Estimate(2 * float(radius))


def _pcl(scan: Scan) -> Estimate | None:
    """RANSAC with normals, and what it then refines.

    About the middle of the points: PCL takes normals in single precision.
    """
    points, sigma = scan.points, float(np.max(scan.view.sigma))
    n = len(points)
    settings = (
        # Distance, neighbors of a normal, weight of normals, no planes, fewest points.
        *(3 * sigma, max(30, n // 100), 0.01, 1.0, 0.3 * n),
        # Radii, samples, no clusters, and the distance of planes, of which none is.
        *(*PCL_RADII, 1000, 0.0, 3 * sigma),
    )
    rows = cylinders_of(PCL, points - points.mean(axis=0), settings)
    return Estimate(2 * float(rows[0, 6])) if len(rows) else None


OURS: dict[str, Program] = {
    "image": _image,
    "points": _points,
    "correlated": _correlated,
}
"""`fit_cylinder`, `fit_cylinder_to_points`, and the first with correlated errors."""

PRACTICE: dict[str, Program] = {"circle": _circle, "slices": _slices}
"""What is done with laser scans of trees."""

PEERS: dict[str, Program] = {"cylfit": _cylfit, "PCL": _pcl}
"""Programs of others, slower."""
