"""Walls that patches of a cloud may be of, of all sizes.

Normals of a wall lie in a plane, across its axis, and lines along them meet on that. So
a patch of neighbors tells a wall, from which Gauss-Newton steps lead to the nearest
one, robustly. Patches of few points tell small walls, those of many the others.
"""

__all__ = ["Proposal", "proposed"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from impostor_jax.camera.ray_table import turned_to
from impostor_jax.clouds.cloud import Cloud, spread_seeds
from impostor_jax.clouds.support import is_on
from impostor_jax.clouds.wall import MOST_SCATTER, Wall, refined_walls

PATCHES = ((32, 4000), (96, 3000), (300, 1000), (1000, 200))
"""Points of a patch, and about how many patches there are: half of them evenly over all
points, half over all places. Few of them turn as a wall does."""

LEAST_TURN = 0.01
"""Variance of the normals of a patch across its axis: of an arc of 20 degrees."""

MOST_STRAY = 0.5
"""Variance of them along it, over that, at most."""

AT_A_TIME = 300_000
"""Points of patches that are refined together."""

MOST_RADIUS = 50.0
"""Radius over the extent of a patch, at most."""

OUTSIDE = 1.3
"""Factor beyond the range of radii to which a rough one may lie."""

LEAST_ON = 0.6
"""Share of a patch that lies on its wall, at least."""

SAMPLES = 8
"""Points of a patch that stand for it."""


class Proposal(NamedTuple):
    """A wall that a patch may be of.

    Attributes:
        wall: Its center lies amid the patch.
        sample: Some points of the patch.
        support: Points of the patch that lie on it, less those that do not.
    """

    wall: Wall
    sample: Int[np.ndarray, " 8"]
    support: float


def proposed(
    cloud: Cloud,
    free: Bool[np.ndarray, " n"],
    radius_range: tuple[float, float],
) -> list[Proposal]:
    """Walls of those points that are free, the best supported first."""
    places = np.flatnonzero(free)
    points, normals = cloud.points[places], cloud.normals[places]
    tree = KDTree(points)
    found: list[Proposal] = []
    for size, number in PATCHES:
        if len(points) < size:
            break
        seeds = _seeds(points, number, size)
        step = max(1, AT_A_TIME // size)
        for at in range(0, len(seeds), step):
            part = points[seeds[at : at + step]]
            near = np.asarray(tree.query(part, k=size, workers=-1)[1])
            walls = _walls_of(points[near], normals[near], radius_range)
            found += [
                Proposal(wall, places[near[k, :: size // SAMPLES][:SAMPLES]], support)
                for k, wall, support in walls
            ]
    return sorted(found, key=lambda one: -one.support)


def _seeds(
    points: Float[np.ndarray, "n 3"], number: int, size: int
) -> Int[np.ndarray, " s"]:
    """Middles of patches of a size, in random order."""
    rng = np.random.default_rng(size)
    half = min(number // 2, len(points))
    some = rng.choice(len(points), half, replace=False)
    return rng.permutation(np.union1d(some, spread_seeds(points, half, seed=size)))


def _walls_of(
    points: Float[np.ndarray, "p k 3"],
    normals: Float[np.ndarray, "p k 3"],
    radius_range: tuple[float, float],
) -> list[tuple[int, Wall, float]]:
    """Number, wall and support of those patches that are of a wall."""
    size = points.shape[1]
    values, vectors = np.linalg.eigh(normals.transpose(0, 2, 1) @ normals / size)
    turns = (values[:, 1] > LEAST_TURN) & (values[:, 0] < MOST_STRAY * values[:, 1])
    number = np.flatnonzero(turns)
    points, normals, axis = points[number], normals[number], vectors[number, :, 0]
    frame = turned_to(axis)
    middle = points.mean(axis=1)
    about = points - middle[:, None]
    onto = frame[:, :2].transpose(0, 2, 1)
    flat, across = about @ onto, normals @ onto
    length = np.linalg.norm(across, axis=2, keepdims=True)
    across = across / np.maximum(length, 1e-12)
    # Where lines along the normals meet, by least squares.
    beside = np.eye(2) - across[..., :, None] * across[..., None, :]
    matrix = beside.sum(axis=1) + 1e-9 * np.eye(2)
    right = np.einsum("pkij,pkj->pi", beside, flat)
    center = np.linalg.solve(matrix, right[..., None])[..., 0]
    radius = np.median(np.linalg.norm(flat - center[:, None], axis=2), axis=1)
    extent = np.linalg.norm(about, axis=2).max(axis=1)
    low, high = radius_range
    sane = (radius > low / OUTSIDE) & (radius < high * OUTSIDE)
    sane &= radius < MOST_RADIUS * extent
    start = middle + np.einsum("pj,pji->pi", center, frame[:, :2])
    number, points, normals = number[sane], points[sane], normals[sane]
    walls = refined_walls(points, axis[sane], start[sane], radius[sane], extent[sane])
    found = []
    for k, wall in enumerate(walls):
        if wall is None or not low <= wall.radius <= high:
            continue
        if wall.scatter > MOST_SCATTER * wall.radius:
            continue
        on = is_on(wall, points[k], normals[k], wall.scatter)
        share = float(np.mean(on))
        if share >= LEAST_ON:
            found.append((int(number[k]), wall, size * (2 * share - 1)))
    return found
