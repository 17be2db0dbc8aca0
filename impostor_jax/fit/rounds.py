"""Circles and spheres through points, for first guesses."""

__all__ = [
    "FEWEST_POINTS",
    "Round",
    "blank_where",
    "largest_of",
    "median_of",
    "round_through",
]

from functools import partial
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from impostor_jax.numerics import eps

Shapes = TypeVar("Shapes")

FEWEST_POINTS = 10
"""Points below which nothing is guessed."""

LARGEST_RADIUS = 100.0
"""Of a circle or sphere, in halves of what is seen of it."""


class Round(NamedTuple):
    """Circles or spheres; a circle's radius may grow along its axis from a place.

    NaN where points do not bend.
    """

    center: Float[Array, "*k d"]
    radius: Float[Array, "*k"]
    slope: Float[Array, "*k"]
    place: Float[Array, "*k"]


def blank_where(none: Bool[Array, " g"], shapes: Shapes) -> Shapes:
    """A batch of guesses, with 0 for all numbers of those that are none.

    A circle of points that do not bend is NaN, and no compiled program returns that.
    """

    def blanked(field: Shaped[Array, "g ..."]) -> Shaped[Array, "g ..."]:
        beside = none.reshape(-1, *(1,) * (field.ndim - 1))
        return jnp.where(beside, 0, field)

    return jax.tree.map(blanked, shapes)


def round_through(
    points: Float[Array, "k d n"],
    among: Bool[Array, "k n"],
    along: Float[Array, "k n"] | None = None,
    fewest: Float[Array, ""] | float = FEWEST_POINTS,
) -> Round:
    """Circles or spheres through points, fitted twice more to those that lie close.

    |x|^2 = 2 c.x + r^2 - |c|^2 + 2 r k l + k^2 l^2 is linear in what is left of the
    unknown, if k^2 is taken for one of them.

    Args:
        points: In the plane across an axis, or in space.
        among: Which of them count.
        along: Their places along that axis; None where the radius does not grow.
        fewest: Points that it takes.
    """
    batch, size, count = points.shape
    middle = points.mean(axis=-1, keepdims=True)
    away = points - middle
    tiny = jnp.finfo(points.dtype).tiny
    scale = jnp.maximum(jnp.abs(away).max(axis=(-1, -2)), tiny)
    away = away / scale[..., None, None]
    squares = jnp.square(away).sum(axis=-2, keepdims=True)
    rows, place = [2 * away, jnp.ones_like(squares)], jnp.zeros(batch, points.dtype)
    further = jnp.zeros((), points.dtype)
    if along is not None:
        place = along.mean(axis=-1)
        further = (along - place[..., None]) / scale[..., None]
        rows += [further[..., None, :], further[..., None, :] ** 2]
    full = jnp.concatenate([*rows, squares], axis=-2)
    # So little that it decides only what the points leave open.
    ridge = eps(full.dtype, 4) * count * np.eye(full.shape[-2] - 1)[None]

    def fitted(kept: Bool[Array, "*k n"]) -> tuple[Array, Array, Array]:
        products = jnp.where(kept[..., None, :], full, 0) @ jnp.swapaxes(full, -1, -2)
        equations = products[..., :-1, :-1] + ridge.astype(full.dtype)
        solve = partial(jax.scipy.linalg.solve, assume_a="pos")
        solution = jax.vmap(solve)(equations, products[..., :-1, -1])
        center = solution[..., :size]
        squared = solution[..., size] + jnp.sum(center**2, axis=-1)
        # What is far larger than what is seen of it is a plane. Ones times ones are the
        # number of points.
        is_round = (squared > 0) & (squared < LARGEST_RADIUS**2)
        is_round &= products[..., size, size] >= fewest
        radius = jnp.sqrt(jnp.where(is_round, squared, jnp.nan))
        slope = 0 * radius if along is None else solution[..., -2] / (2 * radius)
        return center, radius, slope

    def closer(_: Int[Array, ""], kept: Bool[Array, "k n"]) -> Bool[Array, "k n"]:
        center, radius, slope = fitted(kept)
        distance = jnp.sqrt(jnp.square(away - center[..., None]).sum(axis=-2))
        miss = jnp.abs(distance - radius[..., None] - slope[..., None] * further)
        # Three standard deviations; all are within their rounding.
        limit = 3 * 1.4826 * median_of(miss, among) + eps(points.dtype, 16)
        return among & (miss <= limit[..., None])

    center, radius, slope = fitted(jax.lax.fori_loop(0, 2, closer, among))
    center = scale[..., None] * center + middle[..., 0]
    return Round(center, scale * radius, slope, place)


def median_of(
    values: Float[Array, "*#k n"], among: Bool[Array, "*#k n"]
) -> Float[Array, "*k"]:
    """`upper_median` of some along the last axis; minus infinity of none."""
    count = jnp.sum(among, axis=-1)
    return largest_of(values, among, (count - 1) // 2, among.shape[-1] // 2 + 1)


def largest_of(
    values: Float[Array, "*#k n"],
    among: Bool[Array, "*#k n"],
    rank: Int[Array, "*k"],
    most: int,
) -> Float[Array, "*k"]:
    """Of some, the one that so many are larger than; minus infinity of none.

    XLA picks the largest few in a fifth of the time that it takes to sort all.

    Args:
        values: Along the last axis.
        among: Which of them count.
        rank: How many are larger, less than `most`; below 0 it is the largest.
        most: How many are picked.
    """
    some = jnp.where(among, values, -jnp.inf)
    # Of more than two axes XLA sorts.
    ordered, _ = jax.lax.top_k(some.reshape(-1, some.shape[-1]), most)
    ordered = ordered.reshape(*some.shape[:-1], most)
    place = jnp.clip(rank, 0, most - 1)[..., None]
    return jnp.take_along_axis(ordered, place, axis=-1)[..., 0]
