"""The long-range smooth error of images of planes, by restricted likelihood.

A plane that is fitted to readings takes up three degrees of freedom of whatever error
is smooth, so what is left of a warp of a hundred pixels on a table of three hundred
says little by its mean squares. The likelihood of what no plane can explain does: that
of the means of cells, whose covariance is the warp's, that of the grain, and of noise.

References:
    Patterson and Thompson, Recovery of inter-block information when block sizes are
    unequal, Biometrika 58 (1971).
"""

__all__ = ["SHORTEST_WARP", "Smooth", "Warp", "warp_of"]

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from impostor_jax.calibrate.flats import Flat
from impostor_jax.fit.surface import at_most

PER_LENGTH = 2.0
"""Cells a correlation length."""

SMALLEST_CELL, LARGEST_CELL = 4, 80
"""Pixels across one."""

TILE = 12
"""Cells across a tile: the covariance of all of its cells is inverted, and tiles are
taken for independent, each with planes of its own."""

MOST_TILES = 80
"""That are looked at, evenly spaced over all images."""

FEWEST_FREE = 5
"""Cells of a tile beyond what planes explain."""

FILLED = 0.75
"""Of a cell, at least; its mean is taken for that of all of it."""

SHORTEST = 0.8
"""Correlation length over the size of a cell, at least."""

SHORTEST_WARP = 12.0
"""In pixels: of less it is grain."""

AT_END = 1.02
"""Length over the least, below which what is found is of another kind, and shorter."""

LONGEST = 0.5
"""Correlation length over the size of the largest tile, at most: of a longer one a
plane shows no more than curvature."""

TRIED = (0.5, 1.0, 2.0)
"""Lengths that the search begins with, over the one that is expected."""

MOST_STEPS, LARGEST_STEP, SMALLEST_STEP = 15, 0.7, 2e-3
"""Of the logarithms of what is estimated."""

SIGNIFICANT = 12.0
"""Twice the gain of the log likelihood by a warp, at least: by chance one of 400."""


class Smooth(NamedTuple):
    """A smooth error.

    Attributes:
        deviation: Over depth to the power.
        length: Of the correlation, in pixels.
    """

    deviation: float
    length: float


class Warp(NamedTuple):
    """The smooth error of many pixels.

    Attributes:
        deviation: Over depth to the power.
        length: Of the correlation, in pixels.
        relative_errors: Standard deviations of the logarithms of the two.
    """

    deviation: float
    length: float
    relative_errors: tuple[float, float]


class _Cells(NamedTuple):
    """Means of cells, of one plane each.

    Attributes:
        row: Of cells.
        col: Of cells.
        mean: Of the errors.
        terms: Of what a plane explains, of each plane apart.
        noise: Variance of the mean if readings erred independently.
    """

    row: Int[np.ndarray, " n"]
    col: Int[np.ndarray, " n"]
    mean: Float[np.ndarray, " n"]
    terms: Float[np.ndarray, "n t"]
    noise: Float[np.ndarray, " n"]


def warp_of(
    flats: Sequence[Flat],
    variances: Sequence[Float[np.ndarray, "h w"]],
    grain: Smooth | None,
    expected: Smooth,
) -> Warp | None:
    """The warp that images of planes have in common; None if it is not significant.

    Cells are chosen by its length, which must be known to a factor of two.

    Args:
        flats: The images.
        variances: Of white noise, over depth to twice the power.
        grain: The shorter error, if there is one.
        expected: About what it is.
    """
    size = int(np.clip(expected.length / PER_LENGTH, SMALLEST_CELL, LARGEST_CELL))
    tiles = [
        tile
        for pair in zip(flats, variances, strict=True)
        for tile in _tiles_of(_cells_of(*pair, size))
    ]
    if not tiles:
        return None
    tiles = [tiles[k] for k in at_most(len(tiles), MOST_TILES)]
    extent = max(np.ptp(part) + 1 for cells in tiles for part in cells[:2])
    likelihood = _Likelihood(
        tiles, [_noise_covariance(cells, grain, size) for cells in tiles], size
    )
    low = max(SHORTEST * size, SHORTEST_WARP)
    bounds = low, max(LONGEST * extent * size, 2 * low)
    starts = [
        np.log([expected.deviation**2, np.clip(factor * expected.length, *bounds), 1])
        for factor in TRIED
    ]
    found, most, information = likelihood.maximized(
        max(starts, key=likelihood.at), np.log(bounds)
    )
    variance, length, _ = np.exp(found)
    if not 2 * (most - likelihood.without) > SIGNIFICANT or length < AT_END * low:
        return None
    errors = np.sqrt(np.diag(np.linalg.inv(information)))
    return Warp(
        math.sqrt(variance), float(length), (float(errors[0]) / 2, float(errors[1]))
    )


def _cells_of(flat: Flat, variance: Float[np.ndarray, "h w"], size: int) -> _Cells:
    across = -(-flat.labels.shape[1] // size)
    rows, cols = np.indices(flat.labels.shape) // size
    parts = []
    for plane in range(1, flat.num_planes + 1):
        on = flat.labels == plane
        cell = (rows * across + cols)[on]
        number = np.bincount(cell)
        kept = np.flatnonzero(number >= FILLED * size * size)
        values = np.stack([flat.error[on], variance[on], *flat.terms[:, on]])
        error, noise, *terms = (
            np.bincount(cell, value)[kept] / number[kept] for value in values
        )
        of_all = np.zeros((len(kept), 3 * flat.num_planes))
        of_all[:, 3 * (plane - 1) : 3 * plane] = np.stack(terms, axis=1)
        parts.append((*np.divmod(kept, across), error, of_all, noise / number[kept]))
    if not parts:
        none = np.zeros(0)
        return _Cells(none.astype(int), none.astype(int), none, none[:, None], none)
    return _Cells(*map(np.concatenate, zip(*parts, strict=True)))


def _tiles_of(cells: _Cells) -> Iterator[_Cells]:
    """Cells that lie in one tile, with what planes explain of them."""
    number = cells.row // TILE * 10_000 + cells.col // TILE
    for tile in np.unique(number):
        row, col, mean, terms, noise = (part[number == tile] for part in cells)
        # What planes explain is a space; cells in a row leave one of them open.
        basis, size, _ = np.linalg.svd(terms, full_matrices=False)
        basis = basis[:, size > 1e-6 * size.max(initial=0)]
        if len(mean) >= basis.shape[1] + FEWEST_FREE:
            yield _Cells(row, col, mean, basis, noise)


def _correlations(cells: _Cells, length: float, size: int) -> Float[np.ndarray, "n n"]:
    """Of the means of cells, by an error whose own is exp(-d^2 / (2 length^2))."""
    along = np.arange(size)
    apart = along[:, None] - along[None]
    most = max(np.ptp(cells.row), np.ptp(cells.col)) + 1
    shifts = size * np.arange(most)[:, None, None] + apart
    means = np.exp(-0.5 * (shifts / length) ** 2).mean(axis=(1, 2))
    row, col = (np.abs(part[:, None] - part[None]) for part in (cells.row, cells.col))
    return means[row] * means[col]


def _noise_covariance(
    cells: _Cells, grain: Smooth | None, size: int
) -> Float[np.ndarray, "n n"]:
    noise = np.diag(cells.noise)
    if grain is None:
        return noise
    return noise + grain.deviation**2 * _correlations(cells, grain.length, size)


class _Solved(NamedTuple):
    """A covariance without what planes explain.

    Attributes:
        inverse: Of the covariance, on what is left.
        log_determinant: Of what is left.
        residual: The inverse times the means.
        square: Of the means, by the inverse.
    """

    inverse: Float[np.ndarray, "n n"]
    log_determinant: float
    residual: Float[np.ndarray, " n"]
    square: float


def _solved(cells: _Cells, covariance: Float[np.ndarray, "n n"]) -> _Solved:
    inverse = np.linalg.inv(covariance)
    weighted = inverse @ cells.terms
    inner = cells.terms.T @ weighted
    inverse = inverse - weighted @ np.linalg.solve(inner, weighted.T)
    determinant = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inner)[1]
    residual = inverse @ cells.mean
    return _Solved(inverse, float(determinant), residual, float(cells.mean @ residual))


class _Likelihood(NamedTuple):
    """Of the logarithms of the warp's variance and length and of the noise's factor.

    Attributes:
        tiles: What was measured.
        noises: Covariances of each without a warp.
        size: Of cells, in pixels.
    """

    tiles: Sequence[_Cells]
    noises: Sequence[Float[np.ndarray, "n n"]]
    size: int

    def at(self, logs: Float[np.ndarray, "3"]) -> float:
        """The logarithm of the likelihood."""
        variance, length, factor = np.exp(logs)
        total = 0.0
        for cells, noise in zip(self.tiles, self.noises, strict=True):
            own = variance * _correlations(cells, length, self.size)
            solved = _solved(cells, own + factor * noise)
            total -= (solved.log_determinant + solved.square) / 2
        return total

    @property
    def without(self) -> float:
        """That of no warp, with the best factor."""
        solved = [_solved(*pair) for pair in zip(self.tiles, self.noises, strict=True)]
        degrees = sum(len(cells.mean) - cells.terms.shape[1] for cells in self.tiles)
        factor = sum(one.square for one in solved) / degrees
        determinant = sum(one.log_determinant for one in solved)
        return -(determinant + degrees * (math.log(factor) + 1)) / 2

    def scored(
        self, logs: Float[np.ndarray, "3"]
    ) -> tuple[float, Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        """The log likelihood, its slope, and its expected curvature."""
        total, slope, information = 0.0, np.zeros(3), np.zeros((3, 3))
        variance, length, factor = np.exp(logs)
        tiny = 1e-3
        for cells, noise in zip(self.tiles, self.noises, strict=True):
            own, longer, shorter = (
                variance * _correlations(cells, length * math.exp(by), self.size)
                for by in (0, tiny, -tiny)
            )
            solved = _solved(cells, own + factor * noise)
            total -= (solved.log_determinant + solved.square) / 2
            changes = own, (longer - shorter) / (2 * tiny), factor * noise
            products = [solved.inverse @ change for change in changes]
            for i, change in enumerate(changes):
                square = solved.residual @ change @ solved.residual
                slope[i] += (square - np.trace(products[i])) / 2
                for j in range(3):
                    information[i, j] += np.sum(products[i] * products[j].T) / 2
        return total, slope, information

    def maximized(
        self, start: Float[np.ndarray, "3"], bounds: Float[np.ndarray, "2"]
    ) -> tuple[Float[np.ndarray, "3"], float, Float[np.ndarray, "3 3"]]:
        """Where it is largest, by Fisher's scoring; how large, and how curved.

        Args:
            start: Where the search begins.
            bounds: Of the logarithm of the length.
        """
        found, (now, slope, information) = start, self.scored(start)
        for _ in range(MOST_STEPS):
            step = _step(slope, information)
            if found[1] <= bounds[0] and step[1] < 0:
                # What is shorter is no warp.
                break
            if found[1] >= bounds[1] and step[1] > 0:
                # At an end, which the others need not wait for.
                free = [0, 2]
                step[free] = _step(slope[free], information[np.ix_(free, free)])
                step[1] = 0.0
            step *= min(1.0, LARGEST_STEP / np.abs(step).max())
            after, at_after = found, (-math.inf, slope, information)
            while at_after[0] < now and np.abs(step).max() > SMALLEST_STEP:
                after = found + step
                after[1] = np.clip(after[1], *bounds)
                at_after, step = self.scored(after), step / 2
            if not at_after[0] > now:
                break
            is_done = np.abs(after - found).max() < SMALLEST_STEP
            found, (now, slope, information) = after, at_after
            if is_done:
                break
        return found, now, information


def _step(
    slope: Float[np.ndarray, " k"], information: Float[np.ndarray, "k k"]
) -> Float[np.ndarray, " k"]:
    # So that what nothing tells does not move.
    return np.linalg.solve(information + 1e-3 * np.eye(len(slope)), slope)
