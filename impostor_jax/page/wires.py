"""Wireframes of fitted shapes, and how they grow by a standard deviation.

Each corner moves in proportion to the standard deviations of the shape's sizes: its
place for the largest shape of a 95 % interval is `place + 1.96 change`, for the
smallest `place - 1.96 change`. Axis and center stay.
"""

__all__ = ["DEVIATIONS", "Wires", "wires_of"]

import dataclasses
import itertools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from impostor_jax.fit.result import Fit
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere

DEVIATIONS = 1.96
"""From the middle of a normal distribution to the ends of its 95 % interval."""

CORNERS = 96
"""Of a circle."""

LINES = 8
"""Along a wall; a part of the corners."""


class Size(NamedTuple):
    """A length of a shape, and its standard deviation, in meters; 0 if not finite."""

    value: float
    std: float


@dataclasses.dataclass(frozen=True)
class Wires:
    """Lines of a wireframe.

    Attributes:
        place: Ends of each line, in the world frame, in meters.
        change: By which they move where each size is a standard deviation larger.
        most: Standard deviations by which all sizes may be less and stay positive.
    """

    place: Float[np.ndarray, "n 2 3"]
    change: Float[np.ndarray, "n 2 3"]
    most: float


def wires_of(fit: Fit) -> Wires | None:
    """Wireframe of a fit's shape; None where no size has a finite deviation above 0."""
    if isinstance(fit.shape, Box):
        return _of_box(fit)
    sizes = _sizes(fit)
    shrinking = [size.value / size.std for size in sizes.values() if size.std > 0]
    if not shrinking:
        return None
    walls = _walls(fit, sizes)
    values, stds = (
        np.concatenate([_lines(wall, part) for wall in walls]) for part in (0, 1)
    )
    return Wires(values, stds, min(shrinking))


def _of_box(fit: Fit) -> Wires | None:
    """The twelve edges of a box."""
    size, std, rotation = (
        np.asarray(x, float) for x in (fit.box.size, fit.std.size, fit.box.rotation)
    )
    std = np.where(np.isfinite(std), std, 0)
    if not np.any(std > 0):
        return None
    corners = np.array([*itertools.product((-0.5, 0.5), repeat=3)])
    edges = [
        pair
        for pair in itertools.combinations(range(len(corners)), 2)
        if np.count_nonzero(corners[pair[0]] - corners[pair[1]]) == 1
    ]
    place = (corners * size) @ rotation.T + np.asarray(fit.box.center, float)
    change = (corners * std) @ rotation.T
    most = float(np.min(size[std > 0] / std[std > 0]))
    return Wires(place[edges], change[edges], most)


class Wall(NamedTuple):
    """A round wall: rings about an axis, with lines from one to the next.

    Attributes:
        center: Of the axis.
        axis: Unit vector.
        levels: Of the rings along it, from the center.
        radii: Of the rings.
    """

    center: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    levels: tuple[Size, ...]
    radii: tuple[Size, ...]


def _sizes(fit: Fit) -> dict[str, Size]:
    """Radii and length of a shape by name."""
    told = {name: pair for name, pair in fit.told.items() if np.ndim(pair[0]) == 0}
    sizes = {name: _size(*pair) for name, pair in told.items()}
    if isinstance(fit.shape, Frustum):
        length = np.linalg.norm(np.asarray(fit.shape.p2 - fit.shape.p1))
        sizes["height"] = _size(length, fit.std.height)
    return sizes


def _size(value: Any, std: Any) -> Size:
    return Size(float(value), float(std) if np.isfinite(std) else 0.0)


def _walls(fit: Fit, sizes: dict[str, Size]) -> list[Wall]:
    shape = fit.shape
    if isinstance(shape, Sphere):
        center = np.asarray(shape.center, float)
        none = (Size(0.0, 0.0),)
        return [Wall(center, axis, none, (sizes["radius"],)) for axis in np.eye(3)]
    half = Size(sizes["height"].value / 2, sizes["height"].std / 2)
    levels = Size(-half.value, -half.std), half
    if isinstance(shape, Frustum):
        ends = np.asarray(shape.p1, float), np.asarray(shape.p2, float)
        axis = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        radii = sizes["radius1"], sizes["radius2"]
        return [Wall((ends[0] + ends[1]) / 2, axis, levels, radii)]
    held = shape if isinstance(shape, Cylinder) else fit.tube
    center, axis = np.asarray(held.center, float), np.asarray(held.axis, float)
    return [
        Wall(center, axis, levels, (size, size))
        for name, size in sizes.items()
        if "radius" in name
    ]


def _lines(wall: Wall, part: int) -> Float[np.ndarray, "n 2 3"]:
    """Lines of a wall, of its values (part 0) or of their standard deviations (1).

    These move nothing but the sizes.
    """
    turn = 2 * np.pi * np.arange(CORNERS) / CORNERS
    first, second = np.asarray(tangent_basis(jnp.asarray(wall.axis)), float)
    around = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    center = wall.center if part == 0 else np.zeros(3)
    rings = [
        center + level[part] * wall.axis + radius[part] * around
        for level, radius in zip(wall.levels, wall.radii, strict=True)
    ]
    circles = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings]
    step = CORNERS // LINES
    along = [
        np.stack([low[::step], high[::step]], axis=1)
        for low, high in itertools.pairwise(rings)
    ]
    return np.concatenate([*circles, *along])
