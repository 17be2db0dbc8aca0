"""Whether readings of a row, or of a column, err alike.

A rolling shutter, a stripe that a projector casts, a readout with an amplifier for each
column, a scanner with a laser for each row: what all readings of a line share is small
beside what each errs by, and no average along the line takes it away. Taken for white
noise of the same size, 4 of 10 fits were more than four of their deviations off, with
success.

The means of neighboring lines tell it: they are off the line through those beside them
by more than what scatters within lines leaves. A wall that is not the shape's bends
little from a line to the next.
"""

__all__ = ["line_errors"]

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from impostor_jax.fit.high_differences import MEDIAN_SQUARE
from impostor_jax.fit.per_pixel import PerPixelNoise
from impostor_jax.fit.pixelwise import Pixelwise
from impostor_jax.fit.result import Fit
from impostor_jax.fit.seen import Seen
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.correlated import LineNoise, Lines
from impostor_jax.sensor.fields import LineField
from impostor_jax.sensor.gaussian import ConstantNoise

NONE = 0.01
"""Chi-squared below which readings have no noise but what rounding makes."""

FEWEST_READINGS = 8
"""Of a line that counts."""

FEWEST_LINES = 20
"""Those between two others that tell."""

LEAST_EXCESS = 1.0
"""Variance of a second difference of their means, over what scatters within lines
leaves, less 1, that tells; of few lines `SIGNIFICANT` deviations of that."""

SIGNIFICANT = 5.0
"""None of 7900 images of white noise, of 20 to 200 lines, exceeds it."""

OF_MEDIAN = 3.4
"""That deviation of a single line, where the median tells it."""

MOST_SHARED = 2.0
"""Deviation that lines share over that within them, up to which it is an error."""

ALIKE = 0.1
"""Correlation of neighbors within lines up to which they share nothing else."""

CLIPPED = 3.0
"""Robust standard deviations beyond which a residual counts as that."""

TINY = 1e-12
"""Variance that is none."""

LEFT = 0.973
"""Variance of standard normal numbers within that."""


def line_errors(
    fit: Fit, seen: Sequence[Seen], measured: str
) -> tuple[list[AbstractDepthNoise], str] | None:
    """The noise of each view with what its lines share, and what a reader is told.

    None where no lines err alike, or the noise says already that they do.

    Args:
        fit: To the images, concrete.
        seen: The object in each of them.
        measured: What a reader is told of noise that was measured; empty where it was
            given.
    """
    if not fit.status.has_numbers or fit.chi2.item() < NONE:
        return None
    noises, told = [], ""
    for one, pixels in zip(seen, fit.pixelwise, strict=True):
        noise, fields = one.noise, one.noise.bias.fields
        is_said = any(isinstance(field, LineField) for field in fields)
        is_said |= isinstance(noise, PerPixelNoise)
        found = None if is_said else _shared(pixels)
        if found is not None:
            told = found.text
            if fields and measured and found.is_all:
                # They were taken for smooth errors.
                measured = f"Measured in the image: noise of {1e3 * found.own:.2g} mm."
                noise = ConstantNoise(found.own)
            elif isinstance(noise, ConstantNoise):
                # A caller who tells how readings scatter has counted it.
                left = float(noise.deviation) ** 2 - found.deviation**2
                noise = ConstantNoise(math.sqrt(max(left, found.own**2)))
            noise = LineNoise(noise, found.deviation, found.lines)
        noises.append(noise)
    return (noises, f"{measured} {told}".strip()) if told else None


class _Shared(NamedTuple):
    """What lines of an image share.

    Attributes:
        lines: Which.
        deviation: Of it, in meters.
        own: That of readings about the mean of their line, in meters.
        is_all: Whether nothing tells that readings share anything else.
    """

    lines: Lines
    deviation: float
    own: float
    is_all: bool

    @property
    def text(self) -> str:
        """What a reader is told."""
        line = self.lines.removesuffix("s")
        return f"Readings of a {line} err alike, by {1e3 * self.deviation:.2g} mm."


def _shared(told: Pixelwise) -> _Shared | None:
    """What lines of an image share; None where nothing tells that they do."""
    is_on = np.asarray(told.marks) == 2
    if np.count_nonzero(is_on) < FEWEST_READINGS * FEWEST_LINES:
        return None
    off = np.asarray(told.residual)[is_on].astype(float)
    scatter = float(np.median(np.abs(off))) / MEDIAN_SQUARE**0.5
    if not scatter > 0:
        return None
    off = np.clip(off / scatter, -CLIPPED, CLIPPED)
    row, col = np.divmod(np.asarray(told.place)[is_on], told.shape[1])
    rows, cols = _excess(row, off), _excess(col, off)
    more, less = (rows, cols) if rows.size >= cols.size else (cols, rows)
    # What is alike in all directions is no error of lines.
    tells = more.size > max(more.least, 2 * less.size)
    if not tells or more.shared > MOST_SHARED * more.own:
        return None
    given = (row, col) if more is rows else (col, row)
    return _Shared(
        lines="rows" if more is rows else "columns",
        deviation=more.shared * scatter,
        own=more.own * scatter,
        is_all=less.size < less.least and _alike(*given, off) < ALIKE,
    )


class _Excess(NamedTuple):
    """What means of lines are off those beside them, beyond what scatters within lines.

    Attributes:
        size: Variance over what that leaves, less 1.
        least: From where on it tells that lines share something.
        shared: Deviation that readings of a line share.
        own: That of readings about the mean of their line.
    """

    size: float
    least: float
    shared: float
    own: float


def _excess(line: Int[np.ndarray, " n"], off: Float[np.ndarray, " n"]) -> _Excess:
    """That of residuals, given the number of the line of each."""
    count, mean, squares = _of_lines(line, off)
    counts = count >= FEWEST_READINGS
    is_told = counts[:-2] & counts[1:-1] & counts[2:]
    if np.count_nonzero(is_told) < FEWEST_LINES:
        return _Excess(0.0, math.inf, 0.0, 1.0)
    own = max(float(np.sum(squares[counts]) / np.sum(count[counts] - 1)), TINY)
    each = 1 / np.maximum(count, 1)
    expected = own * (each[:-2] + 4 * each[1:-1] + each[2:])[is_told]
    ratio = np.diff(mean, 2)[is_told] ** 2 / expected
    middle = float(np.median(ratio)) / MEDIAN_SQUARE
    least = max(LEAST_EXCESS, SIGNIFICANT * OF_MEDIAN / math.sqrt(len(ratio)))
    # Where a rim or a seam lies between them, they differ by that.
    usual = ratio[ratio <= CLIPPED**2 * middle]
    more = float(np.mean(usual)) / LEFT - 1 if len(usual) else 0.0
    shared = max(more, 0.0) * float(np.median(expected)) / 6
    return _Excess(middle - 1, least, math.sqrt(shared), math.sqrt(own))


def _of_lines(
    line: Int[np.ndarray, " n"], off: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Count, mean, and sum of squares about that, of each line from the first on."""
    line = line - line.min()
    count = np.bincount(line).astype(float)
    mean = np.bincount(line, off) / np.maximum(count, 1)
    return count, mean, np.bincount(line, off**2) - count * mean**2


def _alike(
    line: Int[np.ndarray, " n"],
    place: Int[np.ndarray, " n"],
    off: Float[np.ndarray, " n"],
) -> float:
    """Correlation of neighbors of a line about the mean of it."""
    _, mean, squares = _of_lines(line, off)
    order = np.lexsort((place, line))
    line, place = line[order], place[order]
    left = off[order] - mean[line - line[0]]
    beside = (np.diff(line) == 0) & (np.diff(place) == 1)
    pairs = np.count_nonzero(beside) / len(off)
    return float(left[:-1] @ (left[1:] * beside)) / max(squares.sum() * pairs, TINY)
