"""Rays that meet one extreme each."""

__all__ = ["EXTREMES", "at_incidence", "at_tilt", "over_the_image"]

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from experiments.oracle.extremes import Rays

Vectors = Float[np.ndarray, "n 3"]


def _unit(vectors: Vectors) -> Vectors:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _frames(rng: np.random.Generator, count: int) -> tuple[Vectors, Vectors, Vectors]:
    """Random right-handed frames: the axis, and two vectors across it."""
    axis = _unit(rng.normal(size=(count, 3)))
    first = _unit(np.cross(axis, rng.normal(size=(count, 3))))
    return axis, first, np.cross(axis, first)


def _towards(target, view, distance, axis, height, scale=1.0) -> Rays:
    """Cylinders of radius 1 around 0, as a camera sees them that is the origin."""
    count = len(target)
    center = (view * np.reshape(distance, (-1, 1)) - target) * scale
    values = (
        np.zeros((count, 3)),
        view,
        center,
        axis,
        np.full(count, scale),
        np.broadcast_to(height * scale, (count,)),
    )
    return Rays(*(value.astype(np.float32) for value in values))


def at_incidence(
    rng: np.random.Generator,
    count: int,
    distance: float,
    grazing: float,
    height: float = 4.0,
    scale: float = 1.0,
) -> Rays:
    """Towards the wall, from a distance in radii, `grazing` radians off its plane."""
    axis, out, aside = _frames(rng, count)
    lean = rng.uniform(-0.5, 0.5, (count, 1))
    along = np.cos(lean) * aside + np.sin(lean) * axis
    view = _unit(np.cos(grazing) * along - np.sin(grazing) * out)
    place = rng.uniform(-0.45, 0.45, (count, 1)) * height
    clearance = distance - 1 if distance < 2 else distance
    return _towards(out + place * axis, view, clearance, axis, height, scale)


def at_tilt(
    rng: np.random.Generator, count: int, height: float, tilt: float, distance: float
) -> Rays:
    """Towards cap or wall, the axis `tilt` radians off the view."""
    axis, first, second = _frames(rng, count)
    view = np.cos(tilt) * axis + np.sin(tilt) * first
    angle = rng.uniform(np.pi / 2, 3 * np.pi / 2, (count, 1))
    out = np.cos(angle) * first + np.sin(angle) * second
    wall = out + rng.uniform(-0.5, 0.5, (count, 1)) * height * axis
    disc = out * np.sqrt(rng.uniform(0, 1, (count, 1)))
    cap = disc - height / 2 * axis
    target = np.where(rng.uniform(size=(count, 1)) < 0.5, wall, cap)
    return _towards(target, view, distance, axis, height)


def over_the_image(rng: np.random.Generator, count: int, distance: float) -> Rays:
    """Evenly over the width of a cylinder 4 radii high, as pixels see it."""
    axis, first, second = _frames(rng, count)
    lean = rng.uniform(-1, 1, (count, 1))
    view = np.cos(lean) * first + np.sin(lean) * axis
    offset = rng.uniform(-1, 1, (count, 1))
    target = offset * second + rng.uniform(-2, 2, (count, 1)) * axis
    return _towards(target, view, distance, axis, 4.0)


def _afar_end_on(rng: np.random.Generator, count: int) -> Rays:
    axis, first, _ = _frames(rng, count)
    disc = first * np.sqrt(rng.uniform(0, 0.9, (count, 1)))
    return _towards(disc - axis, axis, 1e4, axis, 2.0)


def _from_inside(rng: np.random.Generator, count: int) -> Rays:
    axis, _, _ = _frames(rng, count)
    view = _unit(rng.normal(size=(count, 3)))
    return _towards(np.zeros((count, 3)), view, 0.0, axis, 40.0)


def _beside(rng: np.random.Generator, count: int) -> Rays:
    axis, first, second = _frames(rng, count)
    offset = rng.uniform(1.1, 3, (count, 1)) * second
    return _towards(offset, first, 10.0, axis, 4.0)


def _pole(rng: np.random.Generator, count: int) -> Rays:
    """From 2 radii beside the foot of a pole a thousand radii high."""
    axis, first, second = _frames(rng, count)
    foot = -498 * axis + 0.5 * second * rng.uniform(-1, 1, (count, 1))
    view = _unit(first + 0.3 * axis)
    return _towards(foot - first * 0.8, view, 2.0, axis, 1000.0)


EXTREMES: dict[str, tuple[str, Callable[[np.random.Generator, int], Rays]]] = {
    "seen over the image": (
        "ordinary: 10 radii away",
        lambda rng, count: over_the_image(rng, count, 10.0),
    ),
    "far": ("1e4 radii away", lambda rng, count: over_the_image(rng, count, 1e4)),
    "very far": ("1e6 radii away", lambda rng, count: over_the_image(rng, count, 1e6)),
    "almost touching": (
        "1e-5 radii before the wall",
        lambda rng, count: at_incidence(rng, count, 1 + 1e-5, 1.0),
    ),
    "grazing": (
        "1e-3 rad off the wall's plane, 10 radii away",
        lambda rng, count: at_incidence(rng, count, 10.0, 1e-3),
    ),
    "cap end on": ("1e4 radii away, along the axis", _afar_end_on),
    "almost end on": (
        "the axis 1e-6 rad off the ray, 100 radii away",
        lambda rng, count: at_tilt(rng, count, 4.0, 1e-6, 100.0),
    ),
    "disc": (
        "height 1e-4 radii, 100 radii away",
        lambda rng, count: at_tilt(rng, count, 1e-4, 1.0, 100.0),
    ),
    "pole": ("height 1000 radii, seen from beside its foot", _pole),
    "inside": ("camera on the axis", _from_inside),
    "miss": ("the ray passes beside", _beside),
    "micrometers": (
        "radius 1e-6 m, 10 radii away",
        lambda rng, count: at_incidence(rng, count, 10.0, 1.0, scale=1e-6),
    ),
    "megameters": (
        "radius 1e6 m, 10 radii away",
        lambda rng, count: at_incidence(rng, count, 10.0, 1.0, scale=1e6),
    ),
}
"""A sentence for each, and a number of rays."""
