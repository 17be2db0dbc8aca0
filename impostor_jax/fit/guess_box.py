"""First guesses of a box from a depth image, with no user input.

The commonest normal is that of a face. The commonest of those across it is that of
another; or else the face's edges tell, as the smallest rectangle around the points
along it. How far the points go along the three directions tells the size; a direction
of which one face alone is seen is taken for as long as the shorter of the others.
"""

__all__ = ["guess_boxes"]

import numpy as np
from jaxtyping import Float

from impostor_jax.fit.rounds import FEWEST_POINTS, Guess
from impostor_jax.fit.surface import Samples
from impostor_jax.geometry.so3 import directions_across

ALIKE = np.cos(np.radians(15))
"""Cosine of the angle within which normals are of one face."""

ACROSS = np.sin(np.radians(20))
"""The same that a normal of another face makes with the first."""

TRIED = 128
"""Normals that are tried."""

TURNED = 45
"""Turns of a rectangle that are tried, within a right angle."""

OUTSIDE = 0.005
"""Share of the points at each end of a direction that are left out."""

THIN = 0.1
"""Length over the shorter of the two others, below which a direction shows one face."""


def guess_boxes(samples: Samples) -> list[Guess]:
    """Boxes; none where there are too few normals, or these are of no face."""
    if samples.num_normals < FEWEST_POINTS:
        return []
    normals = samples.normals
    first, _ = _commonest(normals, np.ones(len(normals)))
    aside = (np.abs(normals @ first) < ACROSS).astype(float)
    second, share = _commonest(normals, aside)
    by_edges = _along_edges(samples.points, first)
    # Of other faces a few normals are enough, which mixed readings are not.
    if share > 0.05:
        second = second - first * (first @ second)
        ways = [second / np.linalg.norm(second), by_edges]
    else:
        ways = [by_edges, by_edges]
    boxes = [_around(samples, first, way) for way in ways]
    return [box for box in boxes if np.all(box["half"] > 0)]


def _commonest(
    normals: Float[np.ndarray, "n 3"], weight: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "3"], float]:
    """Direction to which most normals are close, and the share of them."""
    some = np.linspace(0, len(normals) - 1, TRIED).astype(int)
    close = normals[some] @ normals.T > ALIKE
    votes = close @ weight * weight[some]
    best = np.argmax(votes)
    mean = (close[best] * weight) @ normals
    return mean / np.linalg.norm(mean), float(votes[best] / len(normals))


def _along_edges(
    points: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """Direction of an edge of the smallest rectangle around points on a face."""
    basis = directions_across(normal)
    flat = points @ basis.T
    angles = np.arange(TURNED) * (np.pi / 2 / TURNED)
    along = np.stack([np.cos(angles), np.sin(angles)])
    across = np.stack([-np.sin(angles), np.cos(angles)])
    area = np.ptp(flat @ along, axis=0) * np.ptp(flat @ across, axis=0)
    return along[:, np.argmin(area)] @ basis


def _around(
    samples: Samples, first: Float[np.ndarray, "3"], second: Float[np.ndarray, "3"]
) -> Guess:
    """The box with two of its axes given that holds all points."""
    points = samples.points
    frame = np.stack([first, second, np.cross(first, second)])
    reach = np.sort(points @ frame.T, axis=0)
    least = round(OUTSIDE * len(points))
    low, high = reach[least], reach[-1 - least]
    extent = high - low
    others = np.minimum(np.roll(extent, 1), np.roll(extent, 2))
    # What is seen of such a one is the face towards the camera.
    is_thin = extent < THIN * others
    ahead = high + low > 0
    high = np.where(is_thin & ahead, low + others, high)
    low = np.where(is_thin & ~ahead, high - others, low)
    center = (high + low) / 2 @ frame
    # Normals face the camera: of a room inward, and it is in there. Of a plate they do
    # by less than its faces are long.
    outward = np.sum((samples.normal_points - center) * samples.normals, axis=1)
    if np.mean(outward) < -THIN * np.max(high - low):
        margin = THIN * (high - low)
        low, high = np.minimum(low, -margin), np.maximum(high, margin)
        center = (high + low) / 2 @ frame
    return {"center": center, "frame": frame, "half": (high - low) / 2}
