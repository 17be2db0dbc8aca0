"""Patches of objects at several scales, for proposals."""

__all__ = ["Part", "patches_of", "proposed"]

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from impostor_jax.compiling import kept
from impostor_jax.find.normals import Normals
from impostor_jax.find.view import View
from impostor_jax.find.walls import (
    BATCH,
    POINTS,
    WIDE,
    Cloud,
    Patches,
    Proposed,
    propose,
)
from impostor_jax.fit.surface import spread

SEEDS = 512
"""Pixels of an object among which patches begin."""


class Part(NamedTuple):
    """An object, or what creases cut it into.

    Attributes:
        pixels: Flat indices.
        levels: Numbers of patches that it is cut into, one scale after the other.
    """

    pixels: Int[np.ndarray, " n"]
    levels: tuple[int, ...]


def proposed(
    view: View,
    normals: Normals,
    noise: float,
    parts: Sequence[Part],
    limits: tuple[float, float],
    fewest: int,
) -> list[Proposed]:
    """Walls of each part's patches, (patches, walls of each).

    Args:
        view: What is searched.
        normals: Of it.
        noise: Factor of its sigma.
        parts: What is looked at.
        limits: Of the radius, in meters.
        fewest: Pixels of the smallest patches, about.
    """
    made = [patches_of(part, view.depth.shape[1], fewest) for part in parts]
    owner = np.repeat(np.arange(len(made)), [len(some) for some in made])
    flat = [pair for some in made for pair in some]
    if not flat:
        return []
    own, wide = (np.array(part) for part in zip(*flat, strict=True))
    log_limits = np.log(np.array(limits)).astype(np.float32)
    # At 60 degrees, where the square of the tangent is 3.
    grazing = np.float32((view.grazing[6] ** 2 - 1) / 3)
    found: list[Proposed] = []
    for first in range(0, len(flat), BATCH):
        some = np.resize(np.arange(first, min(first + BATCH, len(flat))), BATCH)
        patches = _gathered(view, normals, noise, own[some], wide[some])
        walls = kept(propose)(patches, grazing, log_limits)
        found.append(jax.tree.map(np.asarray, walls))
    everything: Any = jax.tree.map(lambda *x: np.concatenate(x)[: len(flat)], *found)
    return [
        jax.tree.map(lambda x, k=k: x[owner == k], everything) for k in range(len(made))
    ]


def _gathered(
    view: View,
    normals: Normals,
    noise: float,
    own: Int[np.ndarray, "b n"],
    wide: Int[np.ndarray, "b m"],
) -> Patches:
    def picked(field: Float[np.ndarray, "h w ..."], index: Any) -> Any:
        return field.reshape(-1, *field.shape[2:])[index].astype(np.float32)

    def cloud(index: Any) -> Cloud:
        return Cloud(
            points=picked(view.points, index),
            views=picked(view.views, index),
            sigma=noise * picked(view.sigma, index),
            width=view.width(picked(view.depth, index)),
        )

    return Patches(
        own=cloud(own),
        normals=picked(normals.normal, own),
        error=picked(normals.error, own),
        wide=cloud(wide),
    )


def patches_of(
    part: Part, columns: int, fewest: int
) -> list[tuple[Int[np.ndarray, " n"], Int[np.ndarray, " m"]]]:
    """Pixels of each patch, and of all of it.

    Args:
        part: What is cut into patches, which overlap a little.
        columns: Of the image.
        fewest: Pixels of the smallest, about.
    """
    row, col = np.divmod(part.pixels, columns)
    count = len(part.pixels)
    wide = part.pixels[spread(count, WIDE)]
    made = [(part.pixels[spread(count, POINTS)], wide)]
    for level in part.levels:
        if count < level * fewest:
            break
        most = int(1.2 * count / level)
        for seed in _seeds(row, col, level):
            away = (row - row[seed]) ** 2 + (col - col[seed]) ** 2
            near = np.flatnonzero(away <= np.partition(away, most)[most])
            made.append((part.pixels[near[spread(len(near), POINTS)]], wide))
    return made


def _seeds(
    row: Int[np.ndarray, " n"], col: Int[np.ndarray, " n"], count: int
) -> Int[np.ndarray, " k"]:
    """Pixels in the middle of parts of about one size: k-means from far apart."""
    some = spread(len(row), min(len(row), SEEDS))
    place = np.stack([row[some], col[some]], axis=1).astype(float)
    centers = [place.mean(axis=0)]
    away = np.full(len(place), np.inf)
    for _ in range(count):
        away = np.minimum(away, ((place - centers[-1]) ** 2).sum(axis=1))
        centers.append(place[np.argmax(away)])
    middle = np.array(centers[1:])
    for _ in range(3):
        distance = ((place[:, None] - middle) ** 2).sum(axis=-1)
        nearest = distance.argmin(axis=1)
        for k in range(count):
            if np.any(nearest == k):
                middle[k] = place[nearest == k].mean(axis=0)
    return some[((place[:, None] - middle) ** 2).sum(axis=-1).argmin(axis=0)]
