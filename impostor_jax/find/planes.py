"""The planes of a depth image: table, walls, floors, faces of boxes.

Where `View.linear` is looked at, a plane is linear in the rays: a cell's moments fit
it, and those of many cells add up. Planes grow over the cells that lie on them, and are
kept where they are not significantly curved.
"""

__all__ = ["PlaneRegions", "planes_of"]

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.find.view import View

CELL = 8
FEWEST_CELLS = 40
CELL_LIMIT = 2.0
PIXEL_LIMIT = 4.0
MOST_PLANES = 24


class PlaneRegions(NamedTuple):
    """Planes, and what lies on them.

    Attributes:
        labels: Number of the plane from 1; 0 where there is none.
        planes: Slopes along x and y and the value at 0 of what is linear, (n, 3).
        noise: How many times larger than said the sensor's noise is on them.
    """

    labels: Int[np.ndarray, "h w"]
    planes: Float[np.ndarray, "n 3"]
    noise: float


def planes_of(view: View, valid: Bool[np.ndarray, "h w"]) -> PlaneRegions:
    """Find the planes among the readings that are valid."""
    h, w = view.depth.shape
    q, s = view.linear, view.linear_sigma
    weight = np.where(valid & (s > 0), 1 / np.where(s > 0, s, 1) ** 2, 0)
    x, y = view.x.astype(np.float64), view.y.astype(np.float64)
    one = np.ones_like(x)
    rows = np.stack([x, y, one, np.where(valid, q, 0).astype(np.float64)])
    moments = np.empty((4, 4, -(-h // CELL), -(-w // CELL)))
    for i in range(4):
        for j in range(i, 4):
            moments[i, j] = moments[j, i] = _cells(weight * rows[i] * rows[j])
    count = _cells(valid.astype(np.float64))
    moments = np.moveaxis(moments, (0, 1), (2, 3)).reshape(-1, 4, 4)
    count = count.ravel()
    shape = -(-h // CELL), -(-w // CELL)
    known = count >= CELL * CELL / 2
    own = _fitted(moments)
    chi = np.where(known, _chi2(moments, own) / np.maximum(count - 3, 1), np.inf)
    # The sensor's noise, from cells that are flat: their lower half.
    flat = chi[known]
    noise = 1.0
    if len(flat) >= FEWEST_CELLS:
        noise = float(np.sqrt(np.quantile(flat, 0.3)))
    scale = max(noise, 1.0) ** 2
    free = known & (chi < 3 * scale)
    labels = np.zeros(len(count), int)
    planes = []
    tried = np.zeros(len(count), bool)
    normal = _normals(own)
    for _ in range(200):
        if len(planes) == MOST_PLANES:
            break
        support = cv2.boxFilter(
            free.reshape(shape).astype(np.float32),
            -1,
            (5, 5),
            normalize=False,
            borderType=cv2.BORDER_CONSTANT,
        ).ravel()
        seeds = free & ~tried & (support >= 20)
        if not seeds.any():
            break
        seed = int(np.argmin(np.where(seeds, chi, np.inf)))
        tried[seed] = True
        block = np.zeros(shape, bool)
        r, c = divmod(seed, shape[1])
        block[max(r - 2, 0) : r + 3, max(c - 2, 0) : c + 3] = True
        part = block.ravel() & free
        plane = _fitted(moments[part].sum(axis=0))
        for _ in range(12):
            fits = free & (
                _chi2(moments, plane) < (CELL_LIMIT**2) * scale * np.maximum(count, 1)
            )
            n = _normals(plane)
            fits &= (normal @ n) > 0.8
            _, parts = cv2.connectedComponents(
                fits.reshape(shape).view(np.uint8), connectivity=4
            )
            parts = parts.ravel()
            if parts[seed] == 0:
                grown = part & False
                break
            grown = parts == parts[seed]
            if np.array_equal(grown, part):
                break
            part = grown
            plane = _fitted(moments[part].sum(axis=0))
        tried |= block.ravel()
        if np.count_nonzero(part) < FEWEST_CELLS or not part[seed]:
            continue
        if _is_curved(view, rows, weight, part.reshape(shape), plane, scale):
            tried |= part
            continue
        free &= ~part
        planes.append(plane)
        labels[part] = len(planes)
    return PlaneRegions(
        *_pixels(view, valid, labels.reshape(shape), planes, max(noise, 1.0))
    )


def _cells(image):
    h, w = image.shape
    full = np.zeros((-(-h // CELL) * CELL, -(-w // CELL) * CELL))
    full[:h, :w] = image
    return full.reshape(full.shape[0] // CELL, CELL, -1, CELL).sum(axis=(1, 3))


def _fitted(moments):
    a = moments[..., :3, :3]
    # So little that it decides only what the readings leave open.
    ridge = 1e-12 * np.trace(a, axis1=-2, axis2=-1)[..., None, None] * np.eye(
        3
    ) + 1e-30 * np.eye(3)
    return np.linalg.solve(a + ridge, moments[..., :3, 3:])[..., 0]


def _chi2(moments, plane):
    full = np.concatenate([plane, -np.ones((*plane.shape[:-1], 1))], axis=-1)
    if full.ndim == 1:
        return np.einsum("i,kij,j->k", full, moments, full)
    return np.einsum("ki,kij,kj->k", full, moments, full)


def _normals(plane):
    length = np.linalg.norm(plane, axis=-1, keepdims=True)
    return plane / np.maximum(length, 1e-12)


def _is_curved(view, rows, weight, part, plane, scale):
    mask = cv2.resize(
        part.astype(np.uint8), None, fx=CELL, fy=CELL, interpolation=cv2.INTER_NEAREST
    )
    h, w = view.depth.shape
    index = np.flatnonzero((mask[:h, :w] > 0) & (weight > 0))
    index = index[:: max(1, len(index) // 4000)]
    x, y, one, q = (row.ravel()[index] for row in rows)
    root = np.sqrt(weight.ravel()[index])
    mx, my = x.mean(), y.mean()
    dx, dy = x - mx, y - my
    size = max(np.sqrt((dx**2).mean() + (dy**2).mean()), 1e-9)
    dx, dy = dx / size, dy / size
    base = np.stack([dx, dy, one, dx * dx, dx * dy, dy * dy], axis=1) * root[:, None]
    target = q * root
    solution, *_ = np.linalg.lstsq(base, target, rcond=None)
    rest = target - base @ solution
    spread = max(np.median(np.abs(rest)) * 1.4826, 1e-9)
    inverse = np.linalg.inv(base.T @ base + 1e-9 * np.eye(6))
    deviation = spread * np.sqrt(np.diag(inverse))
    quadratic = solution[3:]
    # Errors that many pixels share make it look significant.
    hessian = np.array(
        [[2 * quadratic[0], quadratic[1]], [quadratic[1], 2 * quadratic[2]]]
    )
    largest = np.abs(np.linalg.eigvalsh(hessian)).max()
    significant = np.max(np.abs(quadratic) / deviation[3:]) > 8
    # Sagitta at one standard deviation of the region, over its size.
    middle = np.median(view.depth.ravel()[index])
    relative = largest / max(abs(solution[2]), 1e-12)
    if view.is_central:
        sag = 0.5 * relative * middle
        extent = size * middle
    else:
        sag, extent = 0.5 * largest, size
    return bool(significant and sag > 0.03 * extent)


def _pixels(view, valid, cells, planes, noise):
    h, w = view.depth.shape
    labels = np.zeros((h, w), int)
    q, s = view.linear, view.linear_sigma * noise
    reach = np.ones((5, 5), np.uint8)
    best = np.full((h, w), PIXEL_LIMIT, np.float32)
    for number, plane in enumerate(planes, start=1):
        near = cv2.dilate((cells == number).astype(np.uint8), reach)
        near = (
            cv2.resize(near, None, fx=CELL, fy=CELL, interpolation=cv2.INTER_NEAREST)[
                :h, :w
            ]
            > 0
        )
        miss = np.abs(plane[0] * view.x + plane[1] * view.y + plane[2] - q)
        # A reading is also off by its share of a pixel, aside.
        slope = np.hypot(plane[0], plane[1]) * view.footprint / 3
        miss = miss / np.sqrt(np.where(valid, s, 1) ** 2 + slope**2)
        on = valid & near & (miss < best)
        _, parts = cv2.connectedComponents(on.view(np.uint8), connectivity=4)
        core = (
            cv2.resize(
                (cells == number).astype(np.uint8),
                None,
                fx=CELL,
                fy=CELL,
                interpolation=cv2.INTER_NEAREST,
            )[:h, :w]
            > 0
        )
        keep = np.zeros(parts.max() + 1, bool)
        keep[np.unique(parts[core & on])] = True
        keep[0] = False
        on &= keep[parts]
        labels[on] = number
        best[on] = miss[on]
    return labels, np.array(planes).reshape(-1, 3), noise
