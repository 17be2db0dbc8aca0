"""Six cans and a box before a wall: the scene, its starts, and how far one is off."""

__all__ = ["CAMERA", "FAR", "PARTS", "RADIUS", "errors", "scene_of", "start", "truth"]

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import impostor_jax as ij

CAMERA = ij.PinholeCamera(120.0, 120.0, 63.5, 47.5, width=128, height=96)

RADIUS = 0.08
"""Of the cans, in meters."""

FAR = 0.2
"""Largest error of a start, in radii; of directions half of it, in radians."""

DIRECTIONS = ("axis", "box turn")

PARTS = ("center", "axis", "radius", "height", "box center", "box turn", "box size")
"""What is looked for: the first four of each can; the box turns about the vertical."""

Values = dict[str, Float[Array, "..."]]


def truth() -> Values:
    """The scene that is looked for, with an array for each of `PARTS`."""
    axes = np.array(
        [
            *([0.1, 1, 0.1], [0, 1, 0.2], [-0.2, 1, 0]),
            *([0.3, 1, 0.3], [0, 1, -0.2], [0.2, 1, 0.1]),
        ]
    )
    centers = [
        *([-0.3, -0.1, 1.0], [0.0, -0.12, 1.05], [0.3, -0.1, 1.0]),
        *([-0.32, 0.18, 0.9], [-0.05, 0.17, 0.85], [0.2, 0.16, 0.95]),
    ]
    return {
        "center": jnp.asarray(centers),
        "axis": jnp.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True)),
        "radius": jnp.full(6, RADIUS),
        "height": jnp.full(6, 0.2),
        "box center": jnp.asarray([0.42, 0.2, 1.1]),
        "box turn": jnp.asarray(0.5),
        "box size": jnp.asarray([0.15, 0.2, 0.15]),
    }


def start(rng: np.random.Generator) -> Values:
    """The scene with random errors, uniform up to the largest."""
    begun = {}
    for name, value in truth().items():
        most = FAR / 2 if name in DIRECTIONS else FAR * RADIUS
        begun[name] = value + jnp.asarray(rng.uniform(-most, most, value.shape))
    return begun


def scene_of(values: Values) -> ij.Scene:
    """The scene of some values, before a wall that is known."""
    center, axis, radius, height = (values[name] for name in PARTS[:4])
    cans = ij.Cylinder(center, axis, radius, height)
    cos, sin = jnp.cos(values["box turn"]), jnp.sin(values["box turn"])
    zero, one = jnp.zeros_like(cos), jnp.ones_like(cos)
    turn = jnp.stack([cos, zero, -sin, zero, one, zero, sin, zero, cos]).reshape(3, 3)
    box = ij.Box(values["box center"], turn, values["box size"])
    return ij.Scene([cans, box, ij.Plane((0.0, 0.0, 1.6), (0.0, -0.3, -1.0))])


def errors(values: Values) -> dict[str, Any]:
    """Largest error of each part, in radii; of directions in radians."""
    right, found = truth(), dict(values)
    length = jnp.linalg.norm(found["axis"], axis=1, keepdims=True)
    found["axis"] = found["axis"] / length
    off = {name: jnp.max(jnp.abs(found[name] - right[name])) for name in PARTS}
    return {
        name: float(value) / (1 if name in DIRECTIONS else RADIUS)
        for name, value in off.items()
    }
