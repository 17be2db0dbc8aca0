"""Which rays of a picture are cast, and which pixels do with fewer or need more.

A ray has a trail: what it met on its way and what hid the lights from it. Where the
trails of neighbors agree, colors are smooth between them; where they do not, an edge
lies in between, of a shape, a shadow, or of either in a mirror. So pixels between rays
of one trail can take the mean of these, and those beside another trail need several
rays. What only some pixels need is done for these alone, so many at a time.
"""

__all__ = ["Sampling", "framed", "picture_of", "places_within", "seen_at_edges"]

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.geometry.lanes import chosen_numbers
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.rendering.search import SEARCHED

TOGETHER = 1 << 15
"""Rays that are followed together: what a gradient keeps of them fits into memory."""


AT_EDGES = 512
"""Pixels beside another that are seen anew together: a small image has no more."""


class Sampling(NamedTuple):
    """Where rays are cast.

    Attributes:
        samples: Rays along each side of a pixel.
        adaptive: Whether only pixels beside another trail take more than one.
        spacing: Rows and columns from one ray to the next, to begin with.
    """

    samples: int
    adaptive: bool
    spacing: int


class _Seen(NamedTuple):
    """Colors that rays see, or other numbers, and their trails."""

    color: Any
    trail: Int[Array, "*batch"]


Pixels = Int[Array, "..."]

See = Callable[[Pixels, Pixels, Float[Array, "k 2"]], tuple[Any, Pixels]]
"""From rows and columns (n,) and places within a pixel, in columns and rows from its
center, to colors and trails (k, n)."""


def picture_of(
    see: See,
    row: Pixels,
    col: Pixels,
    sampling: Sampling,
    see_sides: See | None = None,
) -> Vec3:
    """Colors of the pixels of a tile.

    Args:
        see: What rays see.
        row: Rows of the pixels, (h, w).
        col: Columns of the pixels.
        sampling: Where rays are cast.
        see_sides: What is seen of squares around the places, whose sides are a pixel's
            over the samples: asked of pixels that need several rays, if it is given.
    """
    if sampling.spacing == 1:
        seen = _all_seen(see, row, col)
    else:
        seen, is_known = _between(see, row, col, sampling.spacing)
        seen = _seen_anew(see, row, col, seen, ~is_known, 1, TOGETHER)
    if sampling.samples == 1 and see_sides is None:
        return seen.color
    needs = _is_beside_another(seen.trail)
    needs = needs if sampling.adaptive else jnp.ones_like(needs)
    anew = see if see_sides is None else see_sides
    most = TOGETHER // sampling.samples**2
    return _seen_anew(anew, row, col, seen, needs, sampling.samples, most).color


def seen_at_edges(
    see: See, row: Pixels, col: Pixels, values: Any, trail: Int[Array, "h w"]
) -> Any:
    """Numbers of pixels, seen anew where a neighbor's trail is another.

    Args:
        see: What is seen of whole pixels.
        row: Rows of the pixels, (h, w).
        col: Columns of the pixels.
        values: Numbers of each, a tree of arrays (h, w).
        trail: Of each.
    """
    needs = _is_beside_another(trail)
    seen = _Seen(values, trail)
    return _seen_anew(see, row, col, seen, needs, 1, AT_EDGES).color


def framed(pixels: Int[Array, "h w"], stride: int, axis: int) -> Pixels:
    """Rows or columns of a tile and one more pixel on each side."""
    wide = jnp.pad(pixels, 1, mode="edge")
    number = jax.lax.broadcasted_iota(jnp.int32, wide.shape, axis)
    last = wide.shape[axis] - 1
    off = (number == last).astype(jnp.int32) - (number == 0).astype(jnp.int32)
    return wide + stride * off


def places_within(samples: int) -> Float[np.ndarray, "k 2"]:
    """Places of a square grid in a pixel, in columns and rows from its center."""
    place = (np.arange(samples) + 0.5) / samples - 0.5
    return np.stack(np.meshgrid(place, place), axis=-1).reshape(-1, 2)


def _all_seen(see: See, row: Pixels, col: Pixels) -> _Seen:
    """What rays through the centers of pixels see."""
    together = min(row.size, TOGETHER)

    def chunks(x: Pixels) -> Pixels:
        flat = x.reshape(-1)
        padded = jnp.pad(flat, (0, -flat.size % together), mode="edge")
        return padded.reshape(-1, together)

    def seen(pixels: tuple[Pixels, Pixels]) -> _Seen:
        return jax.tree.map(lambda x: x[0], _Seen(*see(*pixels, jnp.zeros((1, 2)))))

    found = jax.lax.map(_kept(seen), (chunks(row), chunks(col)))
    return jax.tree.map(lambda x: x.reshape(-1)[: row.size].reshape(row.shape), found)


def _between(
    see: See, row: Pixels, col: Pixels, spacing: int
) -> tuple[_Seen, Bool[Array, "h w"]]:
    """What a grid of rays tells of all pixels, and of which it tells it."""
    (height, width), lines = row.shape, []
    for size in (height, width):
        # The last pixel is one of the grid, as the first is.
        place = np.append(np.arange(0, size - 1, spacing), size - 1)
        after = np.clip(np.searchsorted(place, np.arange(size), "right"), 1, None)
        after = np.minimum(after, len(place) - 1)
        before = np.maximum(after - 1, 0)
        step = np.maximum(place[after] - place[before], 1)
        lines.append((place, before, after, (np.arange(size) - place[before]) / step))
    (rows, top, bottom, down), (cols, left, right, along) = lines
    grid = _all_seen(see, row[np.ix_(rows, cols)], col[np.ix_(rows, cols)])
    corners = [
        (np.ix_(i, j), np.outer(v, u))
        for i, v in ((top, 1 - down), (bottom, down))
        for j, u in ((left, 1 - along), (right, along))
    ]
    trail = grid.trail[corners[0][0]]
    agree = [grid.trail[at] == trail for at, _ in corners]

    def mean(x: Float[Array, "rows cols"]) -> Float[Array, "h w"]:
        return sum(
            (x[at] * jnp.asarray(weight, x.dtype) for at, weight in corners),
            jnp.zeros((height, width), x.dtype),
        )

    known = jnp.stack(agree).all(axis=0)
    return _Seen(jax.tree.map(mean, grid.color), trail), known


def _is_beside_another(trail: Int[Array, "h w"]) -> Bool[Array, "h w"]:
    """Whether any of the four neighbors has another trail."""
    height, width = trail.shape
    wide = jnp.pad(trail, 1, mode="edge")
    others = ((0, 1), (2, 1), (1, 0), (1, 2))
    neighbors = [wide[i : i + height, j : j + width] for i, j in others]
    return jnp.stack([other != trail for other in neighbors]).any(axis=0)


def _seen_anew(
    see: See,
    row: Pixels,
    col: Pixels,
    seen: _Seen,
    needs: Bool[Array, "h w"],
    samples: int,
    most: int,
) -> _Seen:
    """What is seen, where some pixels are cast anew: the mean of a grid in each.

    At most so many pixels are cast together.
    """
    places, size = places_within(samples), row.size
    together = min(size, most)
    number, count = chosen_numbers(needs.reshape(-1))
    number = jnp.pad(number, (0, -size % together), constant_values=size)
    chunks = number.reshape(-1, together)
    first = jnp.arange(chunks.shape[0], dtype=jnp.int32) * together

    def cast(number: Int[Array, " n"]) -> _Seen:
        at = jnp.minimum(number, size - 1)
        pixels = row.reshape(-1)[at], col.reshape(-1)[at]
        color, trail = see(*pixels, jnp.asarray(places))
        return _Seen(jax.tree.map(lambda x: jnp.mean(x, axis=0), color), trail[0])

    def at_chunk(
        flat: _Seen, chunk: tuple[Int[Array, " n"], Int[Array, ""]]
    ) -> tuple[_Seen, None]:
        number, first = chunk

        def put(flat: _Seen) -> _Seen:
            here = jnp.arange(together, dtype=jnp.int32) + first < count
            at = jnp.where(here, number, size)
            return jax.tree.map(
                lambda x, new: x.at[at].set(new, mode="drop"), flat, cast(number)
            )

        return jax.lax.cond(first < count, _kept(put), lambda flat: flat, flat), None

    flat = jax.tree.map(lambda x: x.reshape(-1), seen)
    flat, _ = jax.lax.scan(at_chunk, flat, (chunks, first))
    return jax.tree.map(lambda x: x.reshape(row.shape), flat)


def _kept(function: Callable) -> Callable:
    """A function whose derivative computes all anew but what was searched."""
    policy = jax.checkpoint_policies.save_only_these_names(SEARCHED)
    return jax.checkpoint(function, policy=policy)
