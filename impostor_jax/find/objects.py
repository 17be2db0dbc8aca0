"""What is left of a depth image without its planes, cut where depth jumps."""

__all__ = ["creases", "numbered", "objects_of"]

import cv2
import numpy as np
from jaxtyping import Bool, Int

from impostor_jax.find.view import View


def objects_of(
    view: View, valid: Bool[np.ndarray, "h w"], noise: float, fewest: int
) -> Int[np.ndarray, "h w"]:
    """Number of each object from 1, the largest first; 0 where there is none."""
    z = np.where(valid, view.depth, np.inf).astype(np.float32)
    farthest = (
        z + 4 * view.width(np.where(valid, view.depth, 0)) + 6 * noise * view.sigma
    )
    behind = np.zeros(z.shape, bool)
    for near, far in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        behind[far] |= z[far] > farthest[near]
        behind[near] |= z[near] > farthest[far]
    return numbered(valid & ~behind, fewest)


def numbered(inside, fewest):
    """Number the parts that hang together, the largest first; 0 elsewhere."""
    count, labels = cv2.connectedComponents(inside.view(np.uint8), connectivity=4)
    sizes = np.bincount(labels.ravel(), minlength=count)
    sizes[0] = 0
    order = np.argsort(-sizes, kind="stable")
    order = order[sizes[order] >= fewest]
    number = np.zeros(count, int)
    number[order] = np.arange(1, len(order) + 1)
    return number[labels]


def creases(view, normals):
    """Where two convex things touch: normals lean towards each other."""
    k = (normals.window + 1) // 2
    n, p = normals.normal, view.points
    known = np.isfinite(normals.error)
    found = np.zeros(known.shape, bool)
    for near, far, middle in (
        (np.s_[:, : -2 * k], np.s_[:, 2 * k :], np.s_[:, k:-k]),
        (np.s_[: -2 * k], np.s_[2 * k :], np.s_[k:-k]),
    ):
        turn, step = n[far] - n[near], p[far] - p[near]
        length = np.sqrt((step**2).sum(-1))
        inward = (turn * step).sum(-1) < -0.35 * length
        found[middle] |= (
            inward
            & known[near]
            & known[far]
            & (length < 12 * k * view.width(view.depth[middle]))
        )
    return found
