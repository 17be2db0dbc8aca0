"""Departures of a surface from a cylinder: a cone, a ball, a box's edge, a bend.

Distances from a wall are fitted by what no cylinder gives: growth along the axis, a
barrel, an ellipse, a bend. Each comes with its standard deviation, so that what the
image leaves open is told from what it refutes.
"""

__all__ = ["Deformation", "deformation"]

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from impostor_jax.find.evidence import LIMIT, Evidence, Scene, directions_across

FEWEST = 20
"""Readings that it takes."""


class Deformation(NamedTuple):
    """Over the radius, at the ends of the wall: coefficients and standard deviations.

    In the order taper, barrel, two of an ellipse, two of a bend.
    """

    value: Float[np.ndarray, "6"]
    deviation: Float[np.ndarray, "6"]


def deformation(scene: Scene, evidence: Evidence) -> Deformation | None:
    """How far a surface is from a cylinder's; None where too little is seen of it."""
    view, (center, axis, radius, side) = scene.view, evidence.wall
    index = _within(scene, evidence)
    off = view.points.reshape(-1, 3)[index] - center
    along = off @ axis
    across = off - along[:, None] * axis
    distance = np.sqrt((across**2).sum(axis=1))
    out = across / np.maximum(distance, 1e-9)[:, None]
    cosine = -(out * view.views.reshape(-1, 3)[index]).sum(axis=1)
    middle = (evidence.ends[0] + evidence.ends[1]) / 2
    half = max((evidence.ends[1] - evidence.ends[0]) / 2, 1e-9)
    place = (along - middle) / half
    # Near the ends and the outline readings are of more than one surface.
    told = (side * cosine > 0.2) & (np.abs(place) < 0.95)
    told &= np.abs(distance - radius) < 0.3 * radius
    if np.count_nonzero(told) < FEWEST:
        return None
    place, out, cosine = place[told], out[told], cosine[told]
    first, second = directions_across(axis)
    c, s, one = out @ first, out @ second, np.ones_like(place)
    own = [one, c, s, place * c, place * s]
    others = [place, place**2, c * c - s * s, 2 * c * s, place**2 * c, place**2 * s]
    terms = np.stack([*own, *others], axis=1)
    sigma = scene.noise * view.sigma.ravel()[index[told]]
    deviation = view.deviation(view.depth.ravel()[index[told]], sigma, cosine)
    deviation = deviation * np.abs(cosine) / radius
    miss = distance[told] / radius - 1
    weight, rest = 1 / deviation, miss
    inverse, solution = np.eye(len(terms[0])), np.zeros(len(terms[0]))
    for _ in range(3):
        rows = terms * weight[:, None]
        # With a prior as wide as the radius, for what the readings leave open.
        inverse = np.linalg.inv(rows.T @ rows + np.eye(terms.shape[1]))
        solution = inverse @ (rows.T @ (miss * weight))
        rest = (miss - terms @ solution) / deviation
        weight = 1 / deviation / (1 + (rest / LIMIT) ** 2)
    scatter = max(1.4826 * float(np.median(np.abs(rest))), 1.0)
    return Deformation(solution[5:], scatter * np.sqrt(np.diag(inverse)[5:]))


def _within(scene: Scene, evidence: Evidence) -> np.ndarray:
    """Pixels that a wall explains, but for those beside others."""
    explained = np.zeros(scene.view.depth.shape, np.uint8)
    explained.ravel()[evidence.index] = 1
    # Where only every n-th pixel was looked at, none has a neighbor.
    inner = cv2.erode(explained, np.ones((3, 3), np.uint8))
    index = np.flatnonzero(inner)
    if len(index) < min(FEWEST, len(evidence.index) / 4):
        index = evidence.index
    return index[:: max(1, len(index) // 2000)]
