"""A point cloud as a search sees it: thinned by voxels, with a normal at each point.

A normal is that of the plane through the nearest neighbors, of which there are as many
as it takes for the plane to be several times wider than the points scatter about it.
"""

__all__ = ["MOST_POINTS", "Cloud", "cloud_of", "scatter_of", "spread_seeds"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

MOST_POINTS = 200_000
"""That are searched; of a larger cloud one point of each voxel."""

NEIGHBORS = (16, 48, 144)
"""Of a plane, the fewest first."""

FLAT = 0.25
"""Scatter of neighbors about their plane, over their extent in its narrower direction,
from which more neighbors are taken."""

FLATTEST = 0.1
"""The same up to which a point is of no wall of few spacings, whose neighbors scatter
by a quarter of their extent where its radius is 2.5 spacings, and by 0.1 at 6."""

EDGE_ON = 0.05
"""Cosine of the incidence up to which a plane holds the rays to it."""

SAME = 1e-7
"""Distance of two points, over the extent of all, up to which they are one."""

DRAWN = 30
"""Points that are asked for their voxels, over the seeds that are wanted."""

AT_A_TIME = 20_000
"""Points whose neighbors are held in memory."""


class Cloud(NamedTuple):
    """Points that are searched.

    Attributes:
        points: In meters, about `middle`.
        normals: Unit vectors; towards the origins where these are known, else of
            either sign.
        rough: Standard deviation of each point's neighbors about their plane, in
            meters.
        is_flat: Whether the nearest neighbors of each lie on a plane, so that none is
            of a wall of few spacings.
        origins: Where each point was seen from, about `middle`; None where nobody
            tells.
        gaps: Distance of each from its nearest neighbor, in meters.
        spacing: The typical one.
        middle: Of the caller's points, in their frame.
        representative: Of each of the caller's points, the one that stands for it.
        tree: Of the points.
    """

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    rough: Float[np.ndarray, " n"]
    is_flat: Bool[np.ndarray, " n"]
    origins: Float[np.ndarray, "n 3"] | None
    gaps: Float[np.ndarray, " n"]
    spacing: float
    middle: Float[np.ndarray, "3"]
    representative: Int[np.ndarray, " m"]
    tree: KDTree

    def __len__(self) -> int:
        return len(self.points)

    @property
    def on_lines(self) -> float:
        """Part of the points whose neighbors are all of one line of a scan.

        The plane through these holds the rays to them, as no surface that is seen does.
        0 where nobody tells of rays.
        """
        if self.origins is None:
            return 0.0
        ray = self.points - self.origins
        cosine = np.sum(self.normals * ray, axis=1)
        along = np.abs(cosine) < EDGE_ON * np.linalg.norm(ray, axis=1)
        return float(np.mean(along))


def cloud_of(
    points: Float[np.ndarray, "m 3"],
    origins: Float[np.ndarray, "m 3"] | None,
    normals: Float[np.ndarray, "m 3"] | None = None,
    most: int = MOST_POINTS,
) -> Cloud:
    """The cloud of a caller's points.

    Args:
        points: In meters.
        origins: Where each was seen from, if that is known.
        normals: At the points, of any length; those of length 0, and all if None, are
            found from their neighbors.
        most: Points that are searched.
    """
    middle = np.median(points, axis=0)
    chosen, representative = _thinned(points - middle, most)
    own = points[chosen] - middle
    tree = KDTree(own)
    # Points that are there twice have no distance.
    least = max(SAME * float(np.ptp(own, axis=0).max()), np.finfo(np.float32).tiny)
    distance, _ = tree.query(own, k=2, workers=-1)
    found, rough, is_flat = _planes_at(own, tree)
    if normals is not None:
        length = np.linalg.norm(normals[chosen], axis=1, keepdims=True)
        told = normals[chosen] / np.maximum(length, np.finfo(float).tiny)
        found = np.where(length > 0, told, found)
    seen_from = None if origins is None else origins[chosen] - middle
    if seen_from is not None:
        away = np.sum(found * (seen_from - own), axis=1) < 0
        found = np.where(away[:, None], -found, found)
    gaps = np.clip(distance[:, 1], least, None if len(own) > 1 else least)
    return Cloud(
        points=own,
        normals=found,
        rough=rough,
        is_flat=is_flat,
        origins=seen_from,
        gaps=gaps,
        spacing=float(np.median(gaps)),
        middle=middle,
        representative=representative,
        tree=tree,
    )


def _thinned(
    points: Float[np.ndarray, "m 3"], most: int
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " m"]]:
    """One point of each voxel, and which of these stands for each point."""
    if len(points) <= most:
        return _distinct(points)
    # On surfaces the nearest neighbors of fewer points are farther by the root.
    some = np.random.default_rng(0).choice(len(points), most // 2, replace=False)
    distance, _ = KDTree(points[some]).query(points[some], k=2, workers=-1)
    edge = max(float(np.median(distance[:, 1])), float(np.finfo(np.float32).tiny))
    while True:
        first, of_voxel = _first_of_voxels(points, edge)
        if len(first) <= most:
            return first, of_voxel
        edge *= 1.1 * float(np.sqrt(len(first) / most))


def _distinct(
    points: Float[np.ndarray, "m 3"],
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " m"]]:
    """The first of each that are equal, in their order, and which stands for each."""
    _, first, of_place = np.unique(
        points, axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(first)
    rank = np.argsort(order)
    return first[order], rank[of_place.ravel()]


def _first_of_voxels(
    points: Float[np.ndarray, "m 3"], edge: float
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " m"]]:
    place = np.floor((points - points.min(axis=0)) / edge).astype(np.int64)
    size = place.max(axis=0) + 1
    key = (place[:, 0] * size[1] + place[:, 1]) * size[2] + place[:, 2]
    _, first, of_voxel = np.unique(key, return_index=True, return_inverse=True)
    return first, of_voxel.ravel()


def _planes_at(
    points: Float[np.ndarray, "n 3"], tree: KDTree
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Of the planes through neighbors: normals, scatter, and whether they are flat."""
    normals, rough = np.zeros_like(points), np.zeros(len(points))
    is_flattest = np.zeros(len(points), bool)
    left = np.arange(len(points))
    for count in NEIGHBORS:
        count = min(count, len(points))
        is_flat = np.zeros(len(left), bool)
        for at in range(0, len(left), AT_A_TIME):
            part = left[at : at + AT_A_TIME]
            _, near = tree.query(points[part], k=count, workers=-1)
            values, vectors = scatter_of(points[near.reshape(len(part), -1)])
            normals[part] = vectors[:, :, 0]
            least = np.maximum(values[:, 0], 0)
            # Three numbers of a plane are fitted.
            rough[part] = np.sqrt(least * count / max(count - 3, 1))
            is_flat[at : at + AT_A_TIME] = values[:, 0] < FLAT**2 * values[:, 1]
            if count == NEIGHBORS[0]:
                is_flattest[part] = values[:, 0] < FLATTEST**2 * values[:, 1]
        left = left[~is_flat]
    return normals, rough, is_flattest


def scatter_of(
    groups: Float[np.ndarray, "n k 3"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Variances of groups of points along their principal axes, the least first."""
    count = groups.shape[1]
    # `mean` along short rows takes four times as long; so does `einsum` of products.
    about = groups - np.einsum("nki->ni", groups)[:, None] / count
    return np.linalg.eigh(about.transpose(0, 2, 1) @ about / count)


def spread_seeds(
    points: Float[np.ndarray, "n 3"], count: int, seed: int
) -> Int[np.ndarray, " s"]:
    """About as many points, evenly over all places: at most one of a voxel."""
    if len(points) <= count:
        return np.arange(len(points))
    order = np.random.default_rng(seed).permutation(len(points))[: DRAWN * count]
    extent = max(float(np.ptp(points, axis=0).max()), np.finfo(np.float32).tiny)
    low, high = extent / 1e4, extent
    first = order[:1]
    # Fewer voxels the larger they are; at last the edge is known to 4 %.
    for _ in range(8):
        edge = np.sqrt(low * high)
        own, _ = _first_of_voxels(points[order], edge)
        if len(own) > count:
            low = edge
        else:
            high, first = edge, order[own]
    return np.sort(first)
