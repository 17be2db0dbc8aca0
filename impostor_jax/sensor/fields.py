"""Errors that neighbors share: of patches of an image, or along its lines."""

__all__ = ["AbstractField", "LineField", "SmoothField"]

import abc
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray
from typing_extensions import override

from impostor_jax.numerics import Numbers, Scalar, product
from impostor_jax.sensor.draws import normal_draws
from impostor_jax.sensor.surface import has_surface

NODE_SPACING = 2 / 3
"""Distance of the nodes of a smooth field, in correlation lengths: its variance ripples
by 3e-5 then."""

BEYOND = 3.0
"""Correlation lengths beyond the pixels up to which nodes count."""

GRAIN = 10.0
"""Correlation length, in pixels, up to which a field scatters the readings of an object
as their own errors do: an object of 5000 pixels is as large as eight patches of as many
pixels as that correlates, 2 pi length^2."""

MOST_LINES = 1024
"""Rows, or columns, that are told apart; two that are so far from each other are taken
for one."""

MOST_NODES = 32
"""Nodes across the readings of a fit; of a field with more it counts one as smooth as
those, whose effect on what many correlation lengths have in common is the same."""

CELLS_PER_LENGTH = 8
"""Squares along a correlation length whose readings are summed up before they are
compared with nodes, in a tenth of the time: variances are 0.3 % too small by that."""


class AbstractField(eqx.Module):
    """An error of an image that its readings share, normal from image to image.

    Attributes:
        deviation: Standard deviation at a depth of 1 m, in meters.
        power: Of the depth, with which that grows.
    """

    deviation: eqx.AbstractVar[Scalar]
    power: eqx.AbstractVar[Scalar]

    @property
    @abc.abstractmethod
    def is_grain(self) -> bool:
        """Whether readings of an object scatter by it, so that `sigma` counts it."""

    @abc.abstractmethod
    def draw(self, key: PRNGKeyArray, depth: Float[Array, "h w"]) -> Numbers:
        """An image of the error, in meters."""

    @abc.abstractmethod
    def _covariance(
        self,
        score: Float[Array, "k n"],
        row: Int[Array, " n"],
        col: Int[Array, " n"],
    ) -> Float[Array, "k k"]:
        """That of sums over pixels of a score times a field whose deviation is 1."""

    def score_covariance(
        self,
        score: Float[Array, "k n"],
        depth: Float[Array, " n"],
        row: Int[Array, " n"],
        col: Int[Array, " n"],
    ) -> Float[Array, "k k"]:
        """Covariance of sums over pixels of a score times the error.

        Of grain, without each reading's own variance, which its `sigma` counts.

        Args:
            score: Per meter; 0 for what does not count.
            depth: Of the surface, in meters.
            row: Rows of the pixels.
            col: Columns of the pixels.
        """
        score = jnp.where(score != 0, score * self.shift(depth)[None], 0)
        whole = self._covariance(score, row, col)
        return whole - product(score, score.T) if self.is_grain else whole

    def shift(self, depth: Numbers) -> Numbers:
        """Standard deviation at a depth, in meters; 0 where there is no surface."""
        is_some = has_surface(depth)
        z = jnp.where(is_some, depth, 1)
        power = jnp.asarray(self.power, depth.dtype)
        deviation = jnp.asarray(self.deviation, depth.dtype)
        return jnp.where(is_some, deviation * jnp.exp(power * jnp.log(z)), 0)

    def counted_in(self, sigma: Numbers, depth: Numbers) -> Numbers:
        """Standard deviation of readings, with this error where it is grain."""
        if not self.is_grain:
            return sigma
        is_some = jnp.isfinite(sigma)
        own = jnp.where(is_some, sigma, 1)
        return jnp.where(is_some, jnp.hypot(own, self.shift(depth)), jnp.inf)


class LineField(AbstractField):
    """A normal error that all readings of a row, or of a column, have in common.

    Attributes:
        deviation: Standard deviation at a depth of 1 m, in meters.
        power: Of the depth, with which that grows.
        lines: "rows" or "columns".
    """

    deviation: Scalar
    power: Scalar
    lines: str = eqx.field(static=True)

    @property
    @override
    def is_grain(self) -> bool:
        return True

    @override
    def draw(self, key: PRNGKeyArray, depth: Float[Array, "h w"]) -> Numbers:
        height, width = depth.shape
        shape = (height, 1) if self.lines == "rows" else (1, width)
        return normal_draws(key, shape, depth.dtype) * self.shift(depth)

    @override
    def _covariance(
        self,
        score: Float[Array, "k n"],
        row: Int[Array, " n"],
        col: Int[Array, " n"],
    ) -> Float[Array, "k k"]:
        line = (row if self.lines == "rows" else col) % MOST_LINES
        sums = jnp.zeros((MOST_LINES, len(score)), score.dtype).at[line].add(score.T)
        return product(sums.T, sums)


class SmoothField(AbstractField):
    """A normal error whose correlation is exp(-d^2 / (2 length^2)) at d pixels.

    It is white noise on a grid of nodes, spread by exp(-(d / length)^2) along rows and
    columns.

    Attributes:
        deviation: Standard deviation at a depth of 1 m, in meters.
        power: Of the depth, with which that grows.
        length: Of the correlation, in pixels.
    """

    deviation: Scalar
    power: Scalar
    length: float = eqx.field(static=True)

    @property
    @override
    def is_grain(self) -> bool:
        return self.length <= GRAIN

    @override
    def draw(self, key: PRNGKeyArray, depth: Float[Array, "h w"]) -> Numbers:
        spacing = NODE_SPACING * self.length

        def along(size: int) -> Float[Array, "k s"]:
            count = math.ceil((size + 2 * BEYOND * self.length) / spacing) + 1
            nodes = np.arange(count) * spacing - BEYOND * self.length
            places = jnp.arange(size, dtype=depth.dtype)
            return _spread(places, jnp.asarray(nodes, depth.dtype), self.length)

        rows, cols = map(along, depth.shape)
        white = normal_draws(key, (len(rows), len(cols)), depth.dtype)
        return product(rows.T, white, cols) * self.shift(depth)

    @override
    def _covariance(
        self,
        score: Float[Array, "k n"],
        row: Int[Array, " n"],
        col: Int[Array, " n"],
    ) -> Float[Array, "k k"]:
        counts = jnp.any(score != 0, axis=0)
        reach = math.ceil(BEYOND / NODE_SPACING)
        nodes = np.arange(-reach, MOST_NODES + reach + 1) * NODE_SPACING
        num_cells = math.ceil(MOST_NODES * NODE_SPACING * CELLS_PER_LENGTH) + 1
        cells = np.arange(num_cells) / CELLS_PER_LENGTH
        dtype = score.dtype
        weight = _spread(jnp.asarray(cells, dtype), jnp.asarray(nodes, dtype), 1.0)

        def along(index: Int[Array, " n"]) -> tuple[Int[Array, " n"], Float[Array, ""]]:
            place = index.astype(score.dtype)
            low = jnp.min(jnp.where(counts, place, jnp.inf))
            high = jnp.max(jnp.where(counts, place, -jnp.inf))
            extent = jnp.where(jnp.any(counts), high - low, 0)
            length = jnp.maximum(self.length, extent / (MOST_NODES * NODE_SPACING))
            cell = jnp.round((place - low) * (CELLS_PER_LENGTH / length))
            return jnp.where(counts, cell, 0).astype(int), length

        (down, tall), (right, wide) = along(row), along(col)
        summed = jnp.zeros((num_cells, num_cells, len(score)), score.dtype)
        summed = jnp.moveaxis(summed.at[down, right].add(score.T), -1, 0)
        sums = product(weight, summed, weight.T).reshape(len(score), -1)
        return product(sums, sums.T) * (self.length**2 / (tall * wide))


def _spread(
    places: Float[Array, " s"],
    nodes: Float[Array, " k"],
    length: float | Float[Array, ""],
) -> Float[Array, "k s"]:
    """Weight of each node at each place; their squares add up to 1, or to 0 far off."""
    weight = jnp.exp(-(((places[None] - nodes[:, None]) / length) ** 2))
    squares = jnp.sum(weight**2, axis=0)
    tiny = jnp.finfo(weight.dtype).tiny
    return weight * jax.lax.rsqrt(jnp.maximum(squares, tiny))[None]
