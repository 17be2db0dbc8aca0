"""Things that are almost cylinders, drawn without the package: by signed distances.

A ray goes on by the distance to the surface until that is nothing (sphere tracing).
"""

__all__ = ["CAMERA", "KINDS", "SIGMA", "Kind", "Thing", "draw_thing"]

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij

CAMERA = ij.PinholeCamera(300.0, 300.0, 159.5, 119.5, width=320, height=240)

RADIUS, HEIGHT = 0.04, 0.12
"""Of all of them, in the middle, in meters."""

WALL = 1.4
"""Distance of the wall behind, in meters."""

SIGMA = 0.001
"""Deviation of a reading, in meters."""

STEPS = 200
"""Of a ray, at most."""

CLOSE = 1e-5
"""Distance at which a ray has met the surface, in meters."""

Points = Float[np.ndarray, "*b 3"]
Distances = Float[np.ndarray, "*b"]


@dataclasses.dataclass(frozen=True)
class Kind:
    """What is drawn.

    Attributes:
        distance: From points, relative to center and axis, to the surface, or less.
        least: Smallest radius of the wall.
        most: Largest one.
        has_axis: Whether one line is its axis.
    """

    distance: Callable[[Points], Distances]
    least: float
    most: float
    has_axis: bool = True


@dataclasses.dataclass(frozen=True)
class Thing:
    """An image of one.

    Attributes:
        kind: What it is of.
        axis: Of it.
        depth: Readings, in meters.
        mask: Its pixels.
    """

    kind: Kind
    axis: Float[np.ndarray, "3"]
    depth: Float[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "h w"]


def _capped(beyond: Distances, along: Distances) -> Distances:
    """Distance from what lies within a wall and between two ends."""
    off = np.stack([beyond, np.abs(along) - HEIGHT / 2])
    outside = np.linalg.norm(np.maximum(off, 0), axis=0)
    return np.minimum(off.max(axis=0), 0) + outside


def _oval(part: float) -> Kind:
    """Half axes longer and shorter than the radius by a part."""

    def distance(points: Points) -> Distances:
        x, y, z = np.moveaxis(points, -1, 0)
        scaled = np.hypot(x / (1 + part), y / (1 - part))
        return _capped((scaled - RADIUS) * (1 - part), z)

    return Kind(distance, RADIUS * (1 - part), RADIUS * (1 + part))


def _grown(
    radius_at: Callable[[Distances], Distances], steepest: float, ends: tuple
) -> Kind:
    """A radius that changes along the axis, from -1 to 1, by a part."""

    def distance(points: Points) -> Distances:
        x, y, z = np.moveaxis(points, -1, 0)
        own = RADIUS * (1 + radius_at(2 * z / HEIGHT))
        slope = steepest * 2 * RADIUS / HEIGHT
        return _capped((np.hypot(x, y) - own) / np.hypot(1, slope), z)

    return Kind(distance, RADIUS * (1 + min(ends)), RADIUS * (1 + max(ends)))


def _cup(part: float) -> Kind:
    return _grown(lambda at: part * at, part, (-part, part))


def _barrel(part: float) -> Kind:
    """Ends whose radius is less by a part; of a waist, more."""
    return _grown(lambda at: -part * at**2, 4 * abs(part), (0, -part))


def _bend(radii: float) -> Kind:
    """An axis that is an arc with a radius of so many radii of the wall."""
    arc = radii * RADIUS

    def distance(points: Points) -> Distances:
        x, y, z = np.moveaxis(points, -1, 0)
        off = np.hypot(x + arc, z) - arc
        along = np.arctan2(z, x + arc) * arc
        return 0.9 * _capped(np.hypot(off, y) - RADIUS, along)

    return Kind(distance, RADIUS, RADIUS, has_axis=False)


KINDS = {
    "can": _oval(0.0),
    "oval.1%": _oval(0.01),
    "oval.2%": _oval(0.02),
    "oval.5%": _oval(0.05),
    "cup.1%": _cup(0.01),
    "cup.2%": _cup(0.02),
    "cup.5%": _cup(0.05),
    "barrel.2%": _barrel(0.02),
    "barrel.5%": _barrel(0.05),
    "waist.5%": _barrel(-0.05),
    "bend.1:100": _bend(100.0),
    "bend.1:40": _bend(40.0),
}


def draw_thing(kind: Kind, rng: np.random.Generator) -> Thing:
    """An image of a thing 0.6 to 0.9 m away, turned in any way but end on."""
    while True:
        axis, across = rng.normal(size=(2, 3))
        axis /= np.linalg.norm(axis)
        # At least 30 degrees to the view.
        if abs(axis[2]) < np.cos(np.radians(30)):
            break
    first = np.cross(axis, across)
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(axis, first), axis])
    center = np.array([*rng.uniform(-0.06, 0.06, 2), rng.uniform(0.6, 0.9)])
    row, col = np.mgrid[: CAMERA.height, : CAMERA.width]
    x, y = (col - 159.5) / 300, (row - 119.5) / 300
    rays = np.stack([x, y, np.ones(x.shape)], axis=-1).reshape(-1, 3)
    # Of rays that pass the ball around it nothing is asked.
    reach = np.hypot(RADIUS * 1.1, HEIGHT / 2) * 1.1
    away = np.linalg.norm(np.cross(rays, center), axis=1) / np.linalg.norm(rays, axis=1)
    near = np.flatnonzero(away < reach)
    directions, depth = rays[near], np.full(len(near), center[2] - reach)
    length, off = np.linalg.norm(directions, axis=1), np.full(len(near), np.inf)
    for _ in range(STEPS):
        points = (directions * depth[:, None] - center) @ frame.T
        off = kind.distance(points)
        depth = np.where(off > CLOSE, depth + off / length, depth)
    mask = np.zeros(len(rays), bool)
    mask[near] = (off <= CLOSE) & (depth < center[2] + reach)
    image = np.full(len(rays), WALL)
    image[near] = np.where(mask[near], depth, WALL)
    image += rng.normal(0, SIGMA, image.shape)
    shape = row.shape
    return Thing(
        kind, axis, image.reshape(shape).astype(np.float32), mask.reshape(shape)
    )
