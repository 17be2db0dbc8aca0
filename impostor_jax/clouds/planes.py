"""Planes of a cloud, as of floors, walls and the faces of boxes: no cylinder is there.

Planes through patches are grown over all points that lie on them and hang together. A
strip of a large pipe is as flat as that, but bends away on both sides: it is none.
"""

__all__ = ["Planes", "planes_of"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from impostor_jax.clouds.cloud import Cloud, scatter_of, spread_seeds
from impostor_jax.opencv import cv2

SEEDS, PATCHES = 400, (300, 60)
"""Patches of each size that planes are grown from, and points of each."""

FLATTEST = 0.05
"""Scatter of a patch about its plane, over its extent in the narrower direction, up to
which one is grown from it."""

NEAR = 3.0
"""Distance from a plane, in its standard deviations, up to which a point is on it."""

ALONG = np.cos(np.radians(25))
"""Cosine between the normals of a plane and of a point on it, at least."""

FEWEST = 200
"""Points of a plane."""

GAP = 4.0
"""Edge of the cells that a plane hangs together by, in spacings of the points."""

NARROWEST = 10.0
"""Standard deviation of a plane's points in its narrower direction, over those from
it, at least."""

MOST_BENT = 2.0
"""Distance from its middle to which a plane bends within its extent, in deviations."""

BESIDE = 3.0
"""Points beside a plane's that may be of its edge, in spacings."""

MOST_TAKEN = 0.3
"""Part of a patch that may be of planes that were found before."""

MOST_PLANES = 60
"""That are looked for."""


class Planes(NamedTuple):
    """Planes that are taken away.

    Attributes:
        points: One of each, about the cloud's middle.
        normals: Unit vectors.
        label: Of each point of the cloud: 0 for none, k for the k-th plane.
    """

    points: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    label: Int[np.ndarray, " n"]


def planes_of(cloud: Cloud) -> Planes:
    """Planes of a cloud, those of large patches first, of these the flattest."""
    points = cloud.points
    label = np.zeros(len(points), int)
    if len(points) < FEWEST:
        return Planes(np.zeros((0, 3)), np.zeros((0, 3)), label)
    found: list[tuple[np.ndarray, np.ndarray]] = []
    seeds = spread_seeds(points, SEEDS, seed=1)
    for size in PATCHES:
        count = min(size, len(points))
        _, near = cloud.tree.query(points[seeds], k=count, workers=-1)
        values, vectors = scatter_of(points[near])
        values = np.maximum(values, 0)
        thin = np.sqrt(values[:, 0] / np.maximum(values[:, 1], 1e-300))
        for k in np.argsort(thin, kind="stable"):
            if thin[k] > FLATTEST or len(found) == MOST_PLANES:
                break
            if np.mean(label[near[k]] > 0) > MOST_TAKEN:
                continue
            deviation = max(float(np.sqrt(values[k, 0])), 1e-6 * cloud.spacing)
            start = points[near[k]].mean(axis=0), vectors[k, :, 0], deviation
            grown = _grown(cloud, label == 0, int(seeds[k]), *start)
            if grown is not None:
                middle, normal, deviation, own = grown
                found.append((middle, normal))
                edged = _with_edge(cloud, own, label == 0, *found[-1], deviation)
                label[edged] = len(found)
    if not found:
        return Planes(np.zeros((0, 3)), np.zeros((0, 3)), label)
    middles, normals = map(np.array, zip(*found, strict=True))
    return Planes(middles, normals, label)


def _with_edge(
    cloud: Cloud,
    own: Int[np.ndarray, " m"],
    free: Bool[np.ndarray, " n"],
    middle: Float[np.ndarray, "3"],
    normal: Float[np.ndarray, "3"],
    deviation: float,
) -> Int[np.ndarray, " k"]:
    """A plane's points and those beside them that lie on it, whatever their normals.

    At an edge normals are of two planes, and round what is not.
    """
    off = np.abs((cloud.points - middle) @ normal)
    free = free.copy()
    free[own] = False
    beside = np.flatnonzero(free & (off < 2 * NEAR * deviation))
    if not len(beside):
        return own
    reach = BESIDE * cloud.spacing
    distance, _ = KDTree(cloud.points[own]).query(
        cloud.points[beside], distance_upper_bound=reach, workers=-1
    )
    return np.concatenate([own, beside[np.isfinite(distance)]])


def _grown(
    cloud: Cloud,
    free: Bool[np.ndarray, " n"],
    seed: int,
    middle: Float[np.ndarray, "3"],
    normal: Float[np.ndarray, "3"],
    deviation: float,
) -> tuple[np.ndarray, np.ndarray, float, Int[np.ndarray, " m"]] | None:
    """A plane over all points that hang together on it; None where it is none.

    Args:
        cloud: The points.
        free: Which are of no other plane.
        seed: Point that it is grown from.
        middle: A point of it.
        normal: Its normal.
        deviation: Of its points, in meters.
    """
    points = cloud.points
    own, values, vectors = np.zeros(0, int), np.zeros((1, 3)), np.zeros((1, 3, 3))
    for _ in range(3):
        off = np.abs((points - middle) @ normal)
        along = np.abs(cloud.normals @ normal) > ALONG
        on = np.flatnonzero(free & along & (off < NEAR * deviation))
        own = _together(points, on, seed, normal, GAP * cloud.spacing)
        if len(own) < FEWEST:
            return None
        values, vectors = scatter_of(points[own][None])
        values = np.maximum(values, 0)
        middle, normal = points[own].mean(axis=0), vectors[0, :, 0]
        deviation = max(float(np.sqrt(values[0, 0])), 1e-6 * cloud.spacing)
    if np.sqrt(values[0, 1]) < NARROWEST * deviation:
        return None
    if _bends(points[own] - middle, vectors[0]) > MOST_BENT * deviation:
        return None
    return middle, normal, deviation, own


def _together(
    points: Float[np.ndarray, "n 3"],
    on: Int[np.ndarray, " m"],
    seed: int,
    normal: Float[np.ndarray, "3"],
    cell: float,
) -> Int[np.ndarray, " k"]:
    """Those of some points of a plane that hang together with a seed.

    By cells of a grid in the plane. Where they lie too far apart for it, all.
    """
    if seed not in on:
        return np.zeros(0, int)
    _, _, axes = np.linalg.svd(normal[None])
    flat = points[on] @ axes[1:].T
    place = np.floor((flat - flat.min(axis=0)) / cell).astype(int)
    size = place.max(axis=0) + 1
    if np.prod(size, dtype=float) > 4e7:
        return on
    grid = np.zeros(size, np.uint8)
    grid[tuple(place.T)] = 1
    _, parts = cv2.connectedComponents(grid, connectivity=8)
    number = parts[tuple(place.T)]
    return on[number == number[np.flatnonzero(on == seed)[0]]]


def _bends(about: Float[np.ndarray, "n 3"], axes: Float[np.ndarray, "3 3"]) -> float:
    """How far a surface goes from its plane by its curvature, within its extent."""
    off, u, v = (about @ axes).T
    u, v = u / max(u.std(), 1e-300), v / max(v.std(), 1e-300)
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    bent, *_ = np.linalg.lstsq(terms, off)
    return float(np.abs(bent[3:]).max()) * 3
