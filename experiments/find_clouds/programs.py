"""Programs that search a cloud: ours, and what others do with points."""

__all__ = ["ONLY", "OURS", "PROGRAMS"]

from collections.abc import Callable, Sequence
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

import impostor_jax as ij
from experiments.find_accuracy.peers.clouds import CGAL, PCL
from experiments.find_accuracy.peers.compiling import cylinders_of, detections_of
from experiments.find_clouds.scenes import SCANNER_HEIGHT, DrawnCloud
from impostor_jax.matching import Detection, detection_of

Program: TypeAlias = Callable[[DrawnCloud], Sequence[Detection]]

OURS = "impostor_jax"

MOST_POINTS = 60_000
"""That the others are given: one of each voxel of a larger cloud, or they take
minutes."""

RADII = (0.01, 0.5)
"""That the others are allowed, in meters; what is drawn lies within."""

SLICE = 0.2
"""Height of the slice of a forest in which stems are clustered, in meters."""


def _told(cloud: DrawnCloud) -> list[Detection]:
    return _detections(ij.find_cylinders_in_points(cloud.points, cloud.origins))


def _untold(cloud: DrawnCloud) -> list[Detection]:
    return _detections(ij.find_cylinders_in_points(cloud.points))


def _detections(found: ij.FoundInPoints) -> list[Detection]:
    pairs = zip(found.fits, found.confidence, strict=True)
    return [detection_of(fit, float(sure)) for fit, sure in pairs]


def _cgal(cloud: DrawnCloud) -> list[Detection]:
    """CGAL's Efficient RANSAC for cylinders and planes."""
    points, spacing = _thinned(cloud.points)
    noise = max(cloud.noise, 0.02 * spacing)
    settings = 1.5 * noise, 10, 35.0, 3 * spacing, 60, *RADII, 0.01
    return detections_of(cylinders_of(CGAL, points, settings), 60)


def _pcl(cloud: DrawnCloud) -> list[Detection]:
    """PCL: planes by RANSAC, clusters, and in each cylinders by RANSAC, one by one."""
    points, spacing = _thinned(cloud.points)
    settings = 6 * cloud.noise, 30, 0.1, 0.1, 60, *RADII, 1000, 2 * spacing
    rows = cylinders_of(PCL, points, (*settings, 3 * cloud.noise))
    return detections_of(rows, 60)


def _slices(cloud: DrawnCloud) -> list[Detection]:
    """What foresters do: a slice at breast height, clusters, and a circle for each."""
    height = SCANNER_HEIGHT - 1.3
    low = cloud.points[np.abs(cloud.points[:, 1] - height) < SLICE / 2]
    flat, found = low[:, [0, 2]], []
    for cluster in _clusters(flat, 0.05):
        circle = _circle(flat[cluster])
        if circle is None:
            continue
        x, z, radius, share = circle
        found.append(
            Detection(
                np.array([x, height, z]),
                np.array([0.0, 1.0, 0.0]),
                radius,
                np.nan,
                share,
            )
        )
    return found


def _clusters(points: Float[np.ndarray, "n 2"], apart: float) -> list[np.ndarray]:
    """Points of a plane that hang together, by cells that touch."""
    if not len(points):
        return []
    cell = np.floor((points - points.min(axis=0)) / apart).astype(int)
    image = np.zeros(cell.max(axis=0) + 1, np.uint8)
    image[tuple(cell.T)] = 1
    _, labels = cv2.connectedComponents(image, connectivity=8)
    number = labels[tuple(cell.T)]
    order = np.argsort(number, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(number[order])) + 1)
    return [part for part in parts if len(part) >= 30]


def _circle(
    points: Float[np.ndarray, "n 2"],
) -> tuple[float, float, float, float] | None:
    """The circle near most of some points, by RANSAC, and the share that is near."""
    rng, best = np.random.default_rng(0), None
    for _ in range(200):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        matrix = 2 * np.stack([b - a, c - a])
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        right = np.array([b @ b - a @ a, c @ c - a @ a])
        center = np.linalg.solve(matrix, right)
        radius = float(np.linalg.norm(a - center))
        off = np.abs(np.linalg.norm(points - center, axis=1) - radius)
        share = float(np.mean(off < 0.01))
        if RADII[0] < radius < RADII[1] and (best is None or share > best[3]):
            best = float(center[0]), float(center[1]), radius, share
    return best


def _thinned(points: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, float]:
    """At most so many points, evenly over all places, and their spacing."""
    chosen = _first_of_voxels(points)
    own = points[chosen]
    distance, _ = KDTree(own).query(own, k=2)
    return own, float(np.median(distance[:, 1]))


def _first_of_voxels(points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " k"]:
    edge = 1e-3
    while True:
        place = np.floor((points - points.min(axis=0)) / edge).astype(np.int64)
        _, first = np.unique(place, axis=0, return_index=True)
        if len(first) <= MOST_POINTS:
            return first
        edge *= 1.2


PROGRAMS: dict[str, Program] = {
    OURS: _told,
    f"{OURS}, no viewpoint": _untold,
    "CGAL": _cgal,
    "PCL": _pcl,
    "slices": _slices,
}
"""By name."""

ONLY = {"slices": ("forest",)}
"""Kinds of clouds that a program is for, of those that are not for all."""
