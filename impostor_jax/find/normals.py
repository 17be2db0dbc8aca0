"""Normals of a depth image: planes fitted to windows of readings.

A window is as wide as the noise asks for, and narrower where the depth jumps in it. The
moments of the windows add up those of blocks of 2 x 2 pixels.
"""

__all__ = ["STEEPEST", "Normals", "normals_of", "stray"]

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.find.view import View
from impostor_jax.opencv import cv2

SLOPE_ERROR = 0.06
"""Standard deviation of a normal that windows are made wide enough for, in radians."""

NARROWEST, WIDEST = 3, 11
"""Blocks across a window."""

LEAST_KNOWN = 0.3
"""Part of a window that must have readings."""

ROUGH = 0.5
"""Standard deviation of a normal whose window a jump runs through, in radians."""

STEEPEST = 12.0
"""Widths of a pixel by which depth grows from one to the next on what is looked at: at
an incidence of 85 degrees."""

LEAST_STEEP = 5
"""Readings of 3 x 3 that are of such a wall: flying pixels lie halfway, too, but few
beside each other. With three a box's edge became a pipe."""


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
    """Readings with fewer than 3 of 8 neighbors near them: flying pixels.

    Of a wall that grazes the view none are near along the image of its normal; it goes
    on there as steeply, and as far beside.
    """
    z = view.depth
    padded = cv2.copyMakeBorder(z, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    noisy, width = np.float32(4 * np.sqrt(2)) * view.sigma, view.width(z)
    reach = noisy + 3 * width
    count = np.zeros(z.shape, np.uint8)
    rows, cols = z.shape
    for down in range(3):
        for right in range(3):
            other = padded[down : down + rows, right : right + cols]
            count += np.abs(other - z) < reach
    # A reading is near itself.
    found = view.valid & (count < 4)
    row, col = np.nonzero(found)
    here, beside = z[found], (noisy[found], width[found])
    steep = np.zeros(z.shape, np.uint8)
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        before = here - padded[row + 1 - down, col + 1 - right]
        after = padded[row + 1 + down, col + 1 + right] - here
        steep[row, col] |= _goes_on(before, after, *beside)
    # A sum of 3 x 3.
    run = cv2.boxFilter(steep, -1, (3, 3), normalize=False) >= LEAST_STEEP
    return found & ~(run & (steep > 0))


def _goes_on(
    before: Float[np.ndarray, " n"],
    after: Float[np.ndarray, " n"],
    noisy: Float[np.ndarray, " n"],
    width: Float[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Whether depth grows from a reading to the next as it did to the reading.

    Args:
        before: Difference to that before it, in meters.
        after: Of the next.
        noisy: By how much noise lets two readings differ.
        width: Of a pixel there.
    """
    most = np.maximum(np.abs(before), np.abs(after))
    alike = np.abs(after - before) < 0.5 * most + noisy
    return alike & (most < noisy + STEEPEST * width)


def normals_of(view: View, valid: Bool[np.ndarray, "h w"]) -> Normals:
    """Normals of the readings that are valid."""
    z = view.depth
    blocks = _Blocks.of(view, valid)
    normal = np.zeros((*blocks.count.shape, 3), np.float32)
    error = np.full(blocks.count.shape, np.inf, np.float32)
    known = blocks.count > 0
    sizes = [NARROWEST]
    if known.any():
        ratio = (blocks.sigma / (2 * view.width(np.maximum(blocks.depth, 1e-9))))[known]
        wide = np.sqrt(
            np.sqrt(12) / 2 * np.quantile(ratio[::4], [0.25, 0.75]) / SLOPE_ERROR
        )
        sizes = sorted({_odd(x) for x in (wide[0] / 1.6, *wide)})
    for k, size in enumerate(sizes):
        found, deviation, span = blocks.windowed(view, size)
        smooth = span < 8 * blocks.sigma + 6 * size * view.width(blocks.depth)
        better = np.isfinite(deviation) & known & (smooth if k else True)
        if k:
            # No wider than the noise asks for.
            better &= error > SLOPE_ERROR
        normal[better] = found[better]
        error[better] = np.where(smooth, deviation, ROUGH)[better]
    size = z.shape[::-1]
    normal, error = (
        cv2.resize(part, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)[
            : size[1], : size[0]
        ]
        for part in (normal, error)
    )
    error = np.where(valid, error, np.inf)
    return Normals(normal, error, 2 * sizes[-1])


def _odd(width: float) -> int:
    return int(np.clip(2 * round((width - 1) / 2) + 1, NARROWEST, WIDEST))


@dataclasses.dataclass(frozen=True)
class _Blocks:
    """Sums over blocks of 2 x 2 pixels: moments add up, in the blocks' own columns."""

    count: Float[np.ndarray, "h w"]
    u: Float[np.ndarray, "h w"]
    v: Float[np.ndarray, "h w"]
    q: Float[np.ndarray, "h w"]
    uq: Float[np.ndarray, "h w"]
    vq: Float[np.ndarray, "h w"]
    uv: Float[np.ndarray, "h w"]
    low: Float[np.ndarray, "h w"]
    high: Float[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]
    sigma: Float[np.ndarray, "h w"]

    @staticmethod
    def of(view: View, valid: Bool[np.ndarray, "h w"]) -> "_Blocks":
        w = _even(valid.astype(np.float32))
        q = _even(np.where(valid, view.linear, 0).astype(np.float32))
        z = _even(np.where(valid, view.depth, 0))
        s = _even(np.where(valid, view.sigma, 0))
        quarter = np.s_[::2, ::2], np.s_[::2, 1::2], np.s_[1::2, ::2], np.s_[1::2, 1::2]
        a, b, c, d = (w[part] for part in quarter)
        qa, qb, qc, qd = (q[part] for part in quarter)
        depths = [z[part] for part in quarter]
        count = a + b + c + d
        some = np.maximum(count, 1)
        high = np.maximum.reduce(depths)
        low = np.minimum.reduce(
            [np.where(part > 0, part, np.float32(1e9)) for part in depths]
        )
        return _Blocks(
            count=count,
            # A pixel is a quarter of a block beside its middle.
            u=(b + d - a - c) / 4,
            v=(c + d - a - b) / 4,
            q=qa + qb + qc + qd,
            uq=(qb + qd - qa - qc) / 4,
            vq=(qc + qd - qa - qb) / 4,
            uv=(a + d - b - c) / 16,
            low=low,
            high=high,
            depth=sum(depths) / some,
            sigma=sum(s[part] for part in quarter) / some,
        )

    def windowed(
        self, view: View, size: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Normals by least squares over windows of blocks.

        Returns:
            Normals, their standard deviations, and how far depth reaches in a window.
        """
        offset = (np.arange(size) - (size - 1) / 2).astype(np.float32)
        one = np.ones(size, np.float32)

        def total(image, along_u=one, along_v=one):
            return cv2.sepFilter2D(
                image, cv2.CV_32F, along_u, along_v, borderType=cv2.BORDER_CONSTANT
            )

        n = total(self.count)
        su = total(self.count, offset) + total(self.u)
        sv = total(self.count, one, offset) + total(self.v)
        sixteenth = n / 16
        suu = total(self.count, offset**2) + 2 * total(self.u, offset) + sixteenth
        svv = (
            total(self.count, one, offset**2)
            + 2 * total(self.v, one, offset)
            + sixteenth
        )
        suv = (
            total(self.count, offset, offset)
            + total(self.v, offset)
            + total(self.u, one, offset)
            + total(self.uv)
        )
        sq = total(self.q)
        squ = total(self.q, offset) + total(self.uq)
        sqv = total(self.q, one, offset) + total(self.vq)
        enough = (self.count > 0) & (n >= LEAST_KNOWN * 4 * size * size)
        n = np.where(enough, n, 1)
        # Central moments: exact enough in single precision, since offsets are small.
        cuu, cvv, cuv = suu - su * su / n, svv - sv * sv / n, suv - su * sv / n
        cqu, cqv = squ - sq * su / n, sqv - sq * sv / n
        det = cuu * cvv - cuv * cuv
        enough &= det > 1e-3 * n * n
        det = np.where(enough, det, 1)
        qu, qv = (cqu * cvv - cqv * cuv) / det, (cqv * cuu - cqu * cuv) / det
        mean = sq / n - qu * su / n - qv * sv / n
        x, y = _middles(view.x), _middles(view.y)
        # Steps of the rays along columns and rows; of a lens they change, slowly.
        xu, yu = np.gradient(x, axis=1), np.gradient(y, axis=1)
        xv, yv = np.gradient(x, axis=0), np.gradient(y, axis=0)
        turn = xu * yv - xv * yu
        turn = np.where(turn != 0, turn, 1)
        qx, qy = (qu * yv - qv * yu) / turn, (qv * xu - qu * xv) / turn
        if view.is_central:
            # The plane is qx x + qy y + q0 = 1 / z, its normal (qx, qy, q0).
            vector = np.stack([-qx, -qy, qx * x + qy * y - mean], axis=-1)
            toward = np.stack([x, y, np.ones_like(x)], axis=-1)
            toward /= np.sqrt(x * x + y * y + 1)[..., None]
            facing = -(vector * toward).sum(axis=-1)
        else:
            vector = np.stack([qx, qy, -np.ones_like(qx)], axis=-1)
            facing = np.ones_like(qx)
        length = np.sqrt((vector**2).sum(axis=-1))
        length = np.where(length > 0, length, 1)
        facing /= length
        normal = vector / (length * np.where(facing < 0, -1, 1))[..., None]
        # A slope of the depth over its footprint is the tangent of the normal's angle.
        spread = np.sqrt(np.maximum(cuu + cvv, 1e-6) / det / 2)
        step = 2 * view.width(np.maximum(self.depth, 1e-9))
        deviation = np.where(enough, self.sigma / step * spread * facing**2, np.inf)
        kernel = np.ones((size, size), np.uint8)
        span = cv2.dilate(self.high, kernel) - cv2.erode(self.low, kernel)
        return normal, deviation, span


def _even(image: np.ndarray) -> np.ndarray:
    """With an even number of rows and columns."""
    height, width = image.shape
    return np.pad(image, ((0, height % 2), (0, width % 2)))


def _middles(field: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h2 w2"]:
    """Of blocks of 2 x 2, those that reach past the border included."""
    height, width = field.shape
    even = np.pad(field, ((0, height % 2), (0, width % 2)), mode="edge")
    return cv2.resize(
        even, (even.shape[1] // 2, even.shape[0] // 2), interpolation=cv2.INTER_AREA
    )
