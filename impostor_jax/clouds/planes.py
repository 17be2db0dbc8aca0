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

SEEDS, PATCHES = 400, (300, 60, 4000)
"""Patches of each size that planes are grown from, and points of each: the last of what
scatters by the distance of its points, as a belt below a profiler."""

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

MOST_CELLS = 4e7
"""Of the grid that tells whether points hang together."""

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
    """Planes of a cloud, by one size of patches after the other, the flattest first."""
    points = cloud.points
    label = np.zeros(len(points), int)
    if len(points) < FEWEST:
        return Planes(np.zeros((0, 3)), np.zeros((0, 3)), label)
    found: list[tuple[np.ndarray, np.ndarray]] = []
    seeds, rows = spread_seeds(points, SEEDS, seed=1), np.ascontiguousarray(points.T)
    for size in PATCHES:
        count, seeds = min(size, len(points)), seeds[label[seeds] == 0]
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
            grown = _grown(cloud, rows, label == 0, int(seeds[k]), *start)
            if grown is not None:
                middle, normal, deviation, own = grown
                found.append((middle, normal))
                edged = _with_edge(cloud, own, label == 0, *found[-1], deviation)
                label[edged] = len(found)
    middles, normals = np.array(found).reshape(-1, 2, 3).transpose(1, 0, 2)
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
    rows: Float[np.ndarray, "3 n"],
    free: Bool[np.ndarray, " n"],
    seed: int,
    middle: Float[np.ndarray, "3"],
    normal: Float[np.ndarray, "3"],
    deviation: float,
) -> tuple[np.ndarray, np.ndarray, float, Int[np.ndarray, " m"]] | None:
    """A plane over all points that hang together on it; None where it is none.

    Args:
        cloud: The points.
        rows: The same, a coordinate a row: NumPy takes a tenth of the time for extrema
            and means of long rows.
        free: Which are of no other plane.
        seed: Point that it is grown from.
        middle: A point of it.
        normal: Its normal.
        deviation: Of its points, in meters.
    """
    own, values, vectors = np.zeros(0, int), np.zeros(3), np.eye(3)
    about = rows[:, :0]
    for _ in range(3):
        off = np.abs(normal @ rows - middle @ normal)
        on = np.flatnonzero(free & (off < NEAR * deviation))
        on = on[np.abs(cloud.normals[on] @ normal) > ALONG]
        own = on[_together(rows[:, on], on == seed, normal, GAP * cloud.spacing)]
        if len(own) < FEWEST:
            return None
        about = rows[:, own]
        middle = about.mean(axis=1)
        about -= middle[:, None]
        values, vectors = np.linalg.eigh(about @ about.T / len(own))
        normal = vectors[:, 0]
        deviation = max(float(np.sqrt(max(values[0], 0))), 1e-6 * cloud.spacing)
    if np.sqrt(max(values[1], 0)) < NARROWEST * deviation:
        return None
    if _bends(vectors.T @ about) > MOST_BENT * deviation:
        return None
    return middle, normal, deviation, own


def _together(
    rows: Float[np.ndarray, "3 m"],
    seed: Bool[np.ndarray, " m"],
    normal: Float[np.ndarray, "3"],
    cell: float,
) -> Bool[np.ndarray, " m"]:
    """Which of some points of a plane hang together with a seed.

    By cells of a grid in the plane. Where they lie too far apart for it, all.
    """
    if not seed.any():
        return seed
    _, _, axes = np.linalg.svd(normal[None])
    flat = axes[1:] @ rows
    low, high = flat.min(axis=1), flat.max(axis=1)
    tall, wide = (np.floor((high - low) / cell) + 1).tolist()
    if tall * wide > MOST_CELLS:
        return np.ones_like(seed)
    row, col = ((flat - low[:, None]) / cell).astype(np.intp)
    place = row * int(wide) + col
    grid = np.zeros((int(tall), int(wide)), np.uint8)
    grid.ravel()[place] = 1
    _, parts = cv2.connectedComponents(grid, connectivity=8)
    number = parts.ravel()[place]
    return number == number[np.argmax(seed)]


def _bends(about: Float[np.ndarray, "3 n"]) -> float:
    """How far a surface goes from its plane by its curvature, within its extent.

    Args:
        about: Its points along its principal axes, the normal first.
    """
    off, u, v = about
    u, v = u / max(u.std(), 1e-300), v / max(v.std(), 1e-300)
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    bent, *_ = np.linalg.lstsq(terms, off)
    return float(np.abs(bent[3:]).max()) * 3
