"""Circles and spheres through points, for first guesses.

Guesses are made in NumPy and in double precision: of some hundred points that takes a
third longer than a compiled program would, and nothing the first time.
"""

__all__ = [
    "FEWEST_POINTS",
    "Guess",
    "Round",
    "largest_of",
    "median_of",
    "round_through",
]

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

Guess = dict[str, Any]
"""Numbers of a body by the names of its fields, in the camera frame."""

FEWEST_POINTS = 10
"""Points below which nothing is guessed."""

LARGEST_RADIUS = 100.0
"""Of a circle or sphere, in halves of what is seen of it."""

RIDGE = 5e-7
"""Added to equations for each point, so little that it decides only what the points
leave open: a few roundings of readings in single precision."""

ROUNDING = 2e-6
"""Misses, in halves of what is seen, that are of rounding alone."""


class Round(NamedTuple):
    """Circles or spheres; a circle's radius may grow along its axis from a place.

    NaN where points do not bend.
    """

    center: Float[np.ndarray, "*k d"]
    radius: Float[np.ndarray, "*k"]
    slope: Float[np.ndarray, "*k"]
    place: Float[np.ndarray, "*k"]


def round_through(
    points: Float[np.ndarray, "k d n"],
    among: Bool[np.ndarray, "k n"],
    along: Float[np.ndarray, "k n"] | None = None,
    fewest: float = FEWEST_POINTS,
) -> Round:
    """Circles or spheres through points, fitted twice more to those that lie close.

    |x|^2 = 2 c.x + r^2 - |c|^2 + 2 r k l + k^2 l^2 is linear in what is left of the
    unknown, if k^2 is taken for one of them.

    Args:
        points: In the plane across an axis, or in space.
        among: Which of them count.
        along: Their places along that axis; None where the radius does not grow.
        fewest: Points that it takes.
    """
    batch, size, count = points.shape
    middle = points.mean(axis=-1, keepdims=True)
    away = points - middle
    scale = np.maximum(np.abs(away).max(axis=(-1, -2)), np.finfo(float).tiny)
    away = away / scale[:, None, None]
    squares = np.square(away).sum(axis=-2, keepdims=True)
    rows, place = [2 * away, np.ones_like(squares)], np.zeros(batch)
    further = np.zeros((batch, 1))
    if along is not None:
        place = along.mean(axis=-1)
        further = (along - place[:, None]) / scale[:, None]
        rows += [further[:, None], further[:, None] ** 2]
    full = np.concatenate([*rows, squares], axis=-2)
    ridge = RIDGE * count * np.eye(full.shape[-2] - 1)

    def fitted(
        kept: Bool[np.ndarray, "k n"],
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        products = (full * kept[:, None]) @ np.swapaxes(full, -1, -2)
        equations, right = products[:, :-1, :-1] + ridge, products[:, :-1, -1:]
        solution = np.linalg.solve(equations, right)[..., 0]
        center = solution[:, :size]
        squared = solution[:, size] + np.sum(center**2, axis=-1)
        # What is far larger than what is seen of it is a plane. Ones times ones are the
        # number of points.
        is_round = (squared > 0) & (squared < LARGEST_RADIUS**2)
        is_round &= products[:, size, size] >= fewest
        radius = np.sqrt(np.where(is_round, squared, np.nan))
        slope = 0 * radius if along is None else solution[:, -2] / (2 * radius)
        return center, radius, slope

    kept = among
    for _ in range(2):
        center, radius, slope = fitted(kept)
        distance = np.sqrt(np.square(away - center[..., None]).sum(axis=-2))
        miss = np.abs(distance - radius[:, None] - slope[:, None] * further)
        # Three standard deviations; all are within their rounding.
        limit = 3 * 1.4826 * median_of(miss, among) + ROUNDING
        kept = among & (miss <= limit[:, None])
    center, radius, slope = fitted(kept)
    center = scale[:, None] * center + middle[..., 0]
    return Round(center, scale * radius, slope, place)


def median_of(
    values: Float[np.ndarray, "*#k n"], among: Bool[np.ndarray, "*#k n"]
) -> Float[np.ndarray, "*k"]:
    """`upper_median` of some along the last axis; minus infinity of none."""
    return largest_of(values, among, (np.sum(among, axis=-1) - 1) // 2)


def largest_of(
    values: Float[np.ndarray, "*#k n"],
    among: Bool[np.ndarray, "*#k n"],
    rank: Int[np.ndarray, "*k"] | np.integer,
) -> Float[np.ndarray, "*k"]:
    """Of some, the one that so many are larger than; minus infinity of none.

    Args:
        values: Along the last axis.
        among: Which of them count.
        rank: How many are larger; below 0 it is the largest.
    """
    ordered = np.sort(np.where(among, values, -np.inf), axis=-1)
    last = ordered.shape[-1] - 1
    place = last - np.minimum(np.maximum(rank, 0), last)
    # What `np.take_along_axis` returns, in a third of its time.
    rows = ordered.reshape(-1, last + 1)
    return rows[np.arange(len(rows)), place.ravel()].reshape(ordered.shape[:-1])
