"""What is left of a depth image without its planes, cut where depth jumps."""

__all__ = ["creases", "numbered", "objects_of"]

import numpy as np
from jaxtyping import Bool, Int

from impostor_jax.find.normals import Normals
from impostor_jax.find.view import View
from impostor_jax.opencv import cv2

JUMP_PIXELS, JUMP_SIGMAS = 4.0, 6.0
"""A step of the depth between neighbors is a jump beyond so many widths of a pixel and
deviations together: a wall that is seen at 75 degrees is one object."""

LEAST_TURN = 0.35
"""How far two normals lean towards each other in a crease: their difference, along the
line between their points."""

FARTHEST = 12.0
"""Distance of those two points, in widths of a pixel for each pixel of half a window:
beyond it there is a jump between them."""


def objects_of(
    view: View,
    valid: Bool[np.ndarray, "h w"],
    noise: float,
    fewest: int,
    jump: float = JUMP_PIXELS,
) -> Int[np.ndarray, "h w"]:
    """Number of each object from 1, the largest first; 0 where there is none.

    Args:
        view: What is searched.
        valid: Readings that lie on objects.
        noise: Factor of their sigma.
        fewest: Pixels of an object.
        jump: Widths of a pixel by which neighbors on one may differ.
    """
    z = np.where(valid, view.depth, np.inf).astype(np.float32)
    width = view.width(np.where(valid, view.depth, 0))
    farthest = z + jump * width + JUMP_SIGMAS * noise * view.sigma
    behind = np.zeros(z.shape, bool)
    for near, far in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        behind[far] |= z[far] > farthest[near]
        behind[near] |= z[near] > farthest[far]
    return numbered(valid & ~behind, fewest)


def numbered(inside: Bool[np.ndarray, "h w"], fewest: int) -> Int[np.ndarray, "h w"]:
    """Number the parts that hang together, the largest first; 0 elsewhere.

    Args:
        inside: What is numbered.
        fewest: Pixels of a part.
    """
    count, labels = cv2.connectedComponents(inside.view(np.uint8), connectivity=4)
    sizes = np.bincount(labels.ravel(), minlength=count)
    sizes[0] = 0
    order = np.argsort(-sizes, kind="stable")
    order = order[sizes[order] >= fewest]
    number = np.zeros(count, int)
    number[order] = np.arange(1, len(order) + 1)
    return number[np.asarray(labels, int)]


def creases(view: View, normals: Normals) -> Bool[np.ndarray, "h w"]:
    """Where two convex things touch: normals lean towards each other."""
    k = (normals.window + 1) // 2
    # One array of each component: those of (h, w, 3) take three times as long.
    n, p = (np.moveaxis(x, -1, 0).copy() for x in (normals.normal, view.points))
    known = np.isfinite(normals.error)
    most = FARTHEST * k * view.width(view.depth)
    found = np.zeros(known.shape, bool)
    for near, far, middle in (
        (np.s_[:, : -2 * k], np.s_[:, 2 * k :], np.s_[:, k:-k]),
        (np.s_[: -2 * k], np.s_[2 * k :], np.s_[k:-k]),
    ):
        across = np.zeros(known[near].shape, np.float32)
        square = np.zeros_like(across)
        for normal, point in zip(n, p, strict=True):
            step = point[far] - point[near]
            across += (normal[far] - normal[near]) * step
            square += step * step
        length = np.sqrt(square)
        leaning = (across < -LEAST_TURN * length) & known[near] & known[far]
        found[middle] |= leaning & (length < most[middle])
    return found
