"""Normals of a depth image: planes fitted to windows of readings.

A window is as wide as the noise asks for, and narrower where a jump of the depth runs
through it.
"""

__all__ = ["Normals", "normals_of", "stray"]

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.find.view import View

SLOPE_ERROR = 0.06
"""Standard deviation of a normal that windows are made wide enough for, in radians."""

WIDEST = 21
"""Pixels across the widest window."""


class Normals(NamedTuple):
    """Unit normals that face the camera.

    Attributes:
        normal: Zero where there is none.
        error: Their standard deviation, in radians; infinite where there is none.
        window: Pixels across the widest windows.
    """

    normal: Float[np.ndarray, "h w 3"]
    error: Float[np.ndarray, "h w"]
    window: int


def stray(view: View) -> Bool[np.ndarray, "h w"]:
    """Readings with fewer than 3 of 8 neighbors near them: flying pixels."""
    z = view.depth
    padded = cv2.copyMakeBorder(z, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    reach = 4 * np.sqrt(2) * view.sigma + 3 * view.width(z)
    count = np.zeros(z.shape, np.uint8)
    h, w = z.shape
    for dy in (0, 1, 2):
        for dx in (0, 1, 2):
            if dx == dy == 1:
                continue
            other = padded[dy : dy + h, dx : dx + w]
            count += np.abs(other - z) < reach
    return (z > 0) & (count < 3)


def normals_of(view: View, valid: Bool[np.ndarray, "h w"]) -> Normals:
    """Normals of the readings that are valid."""
    z = view.depth
    some = valid[::4, ::4]
    if not some.any():
        return Normals(np.zeros((*z.shape, 3), np.float32), np.full(z.shape, np.inf), 3)
    ratio = view.sigma[::4, ::4][some] / view.width(z[::4, ::4][some])
    widths = np.sqrt(np.sqrt(12) * np.quantile(ratio, [0.25, 0.75]) / SLOPE_ERROR)
    sizes = sorted({_odd(width) for width in (widths[0] / 1.6, *widths)})
    normal = np.zeros((*z.shape, 3), np.float32)
    error = np.full(z.shape, np.inf, np.float32)
    far = np.where(valid, z, 0)
    near = np.where(valid, z, np.float32(1e9))
    # From narrow to wide: where no jump runs through it, the wider window counts.
    for k, size in enumerate(sizes):
        kernel = np.ones((size, size), np.uint8)
        span = cv2.dilate(far, kernel) - cv2.erode(near, kernel)
        smooth = span < 8 * view.sigma + 3 * size * view.width(z)
        found, deviation = _windowed(view, valid, size)
        is_better = np.isfinite(deviation) & valid & (smooth | (k == 0))
        if k:
            # No wider than the noise here asks for.
            is_better &= error > SLOPE_ERROR
        normal[is_better] = found[is_better]
        error[is_better] = np.where(smooth, deviation, 0.5)[is_better]
    return Normals(normal, error, sizes[-1])


def _odd(width: float) -> int:
    return int(np.clip(2 * round((width - 1) / 2) + 1, 5, WIDEST))


def _windowed(
    view: View, valid: Bool[np.ndarray, "h w"], size: int
) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w"]]:
    """Normals by least squares over square windows, and their standard deviations."""
    offset = (np.arange(size) - (size - 1) / 2).astype(np.float32)
    one = np.ones(size, np.float32)
    weight = valid.astype(np.float32)
    q = np.where(valid, view.linear, 0).astype(np.float32)

    def moment(image, along_x, along_y):
        return cv2.sepFilter2D(
            image, cv2.CV_32F, along_x, along_y, borderType=cv2.BORDER_CONSTANT
        )

    n = moment(weight, one, one)
    su, sv = moment(weight, offset, one), moment(weight, one, offset)
    suu, svv = moment(weight, offset**2, one), moment(weight, one, offset**2)
    suv = moment(weight, offset, offset)
    sq, squ, sqv = moment(q, one, one), moment(q, offset, one), moment(q, one, offset)
    enough = valid & (n >= 0.3 * size * size)
    n = np.where(enough, n, 1)
    # Central moments: exact enough in single precision, since offsets are small.
    cuu, cvv, cuv = suu - su * su / n, svv - sv * sv / n, suv - su * sv / n
    cqu, cqv = squ - sq * su / n, sqv - sq * sv / n
    det = cuu * cvv - cuv * cuv
    enough &= det > 1e-3 * n * n
    det = np.where(enough, det, 1)
    qu, qv = (cqu * cvv - cqv * cuv) / det, (cqv * cuu - cqu * cuv) / det
    mean = sq / n - qu * su / n - qv * sv / n
    # Steps of the rays along columns and rows; of a lens they change, slowly.
    xu, yu = _steps(view.x, 1), _steps(view.y, 1)
    xv, yv = _steps(view.x, 0), _steps(view.y, 0)
    turn = xu * yv - xv * yu
    turn = np.where(turn != 0, turn, 1)
    qx, qy = (qu * yv - qv * yu) / turn, (qv * xu - qu * xv) / turn
    if view.is_central:
        # The plane is qx x + qy y + q0 = 1 / z, its normal (qx, qy, q0).
        vector = np.stack([qx, qy, mean - qx * view.x - qy * view.y], axis=-1)
        vector *= -1
    else:
        vector = np.stack([qx, qy, -np.ones_like(qx)], axis=-1)
    length = np.sqrt((vector**2).sum(axis=-1, keepdims=True))
    normal = vector / np.where(length > 0, length, 1)
    facing = -(normal * view.views()).sum(axis=-1)
    normal *= np.where(facing < 0, -1, 1)[..., None]
    # A slope of the depth over its footprint is the tangent of the normal's angle.
    spread = np.sqrt(np.maximum(cuu + cvv, 1e-6) / det / 2)
    error = view.sigma / view.width(np.maximum(view.depth, 1e-3)) * spread
    return normal, np.where(enough, error * facing**2, np.inf)


def _steps(field: Float[np.ndarray, "h w"], axis: int) -> Float[np.ndarray, "h w"]:
    return np.gradient(field, axis=axis)
