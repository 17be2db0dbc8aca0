"""Pictures with edges, and their gradients beside those of many rays a pixel."""

__all__ = ["SCENES", "Seen", "differences", "gradient", "picture", "supersampled"]

import itertools
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import impostor_jax as ij


class Seen(NamedTuple):
    """A scene with an edge.

    Attributes:
        given: Shapes and lights by names, that the loss is differentiated in.
        target: The same, elsewhere: its picture is what the loss compares with.
        pose: Of the camera, `camera_from_world`.
    """

    given: dict[str, Any]
    target: dict[str, Any]
    pose: ij.RigidTransform


COLORS = ((0.9, 0.5, 0.3), (0.6, 0.7, 0.8))
LIGHT = (1.2, -2.5, -0.6)


def _looking_down(height: float) -> ij.RigidTransform:
    """A camera above the floor's shadow, that sees nothing else."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return ij.RigidTransform(turn, -turn @ np.array([-0.8, height, 2.55]))


def _seen(shape: Callable[[float], Any], is_shadow: bool) -> Seen:
    def given(step: float) -> dict[str, Any]:
        x, y, z = LIGHT
        light = ij.PointLight((x + step, y - step, z + step), 0.8)
        return {"shape": shape(step), "light": light}

    straight = ij.RigidTransform(np.eye(3), np.zeros(3))
    return Seen(given(0.0), given(0.05), _looking_down(0.1) if is_shadow else straight)


def _ball(step: float) -> ij.Sphere:
    # The shadow's camera lies beside it, and looks past it.
    return ij.Sphere((0.05 + step, 0.03 - step, 2.0 + step), 0.4 + step / 2)


def _can(step: float) -> ij.Cylinder:
    axis = (0.25 + step, 0.9, -0.35 - step)
    center = (0.05 + step, 0.03 - step, 2.0 + step)
    return ij.Cylinder(center, axis, 0.3 + step / 2, 0.6 + step)


SCENES = {
    "ball, outline": partial(_seen, _ball, False),
    "ball, shadow": partial(_seen, _ball, True),
    "can, outline": partial(_seen, _can, False),
    "can, shadow": partial(_seen, _can, True),
}
"""What makes each, by the names of the table."""


def picture(
    seen: Seen,
    given: dict[str, Any],
    width: int,
    parts: int = 1,
    shift: tuple[float, float] = (0.0, 0.0),
    **options: Any,
) -> Any:
    """The picture of a scene, so many pixels wide and high.

    Args:
        seen: The scene.
        given: Its shapes and lights.
        width: Of the picture, in pixels.
        parts: Pixels that are traced for each, along its sides.
        shift: Of all rays, in columns and rows of what is traced.
        options: Of `ij.trace`.
    """
    count = width * parts
    middle, focal = (count - 1) / 2, 1.4 * count
    camera = ij.PinholeCamera(
        focal, focal, middle, middle, count, count, camera_from_world=seen.pose
    )
    camera = camera.shifted(*map(jnp.asarray, shift))
    # Its normal is up: y is down.
    floor = ij.Plane((0.0, 0.6, 0.0), (0.0, -1.0, 0.0))
    scene = ij.Scene([given["shape"], floor])
    materials = [ij.Material(color) for color in COLORS]
    lights = [ij.AmbientLight(0.1), given["light"]]
    return ij.trace(scene, camera, lights, materials, **options)


def supersampled(
    seen: Seen, given: dict[str, Any], width: int, parts: int
) -> np.ndarray:
    """The mean of so many rays along each side of a pixel, some at a time."""
    few = min(parts, 16)
    shifts = (np.arange(parts // few) - (parts // few - 1) / 2) * few / parts
    total = np.zeros((width, width, 3))
    for shift in itertools.product(shifts.tolist(), repeat=2):
        fine = np.asarray(picture(seen, given, width, few, shift), float)
        total += fine.reshape(width, few, width, few, 3).mean(axis=(1, 3))
    return total / len(shifts) ** 2


def gradient(seen: Seen, width: int, target: np.ndarray, **options: Any) -> Any:
    """Of the sum of squared differences from a target."""

    def loss(given: dict[str, Any]) -> Any:
        return jnp.sum((picture(seen, given, width, **options) - target) ** 2)

    return jax.grad(loss)(jax.tree.map(jnp.asarray, seen.given))


def differences(
    seen: Seen, width: int, target: np.ndarray, parts: int, step: float
) -> Any:
    """Of the same loss with so many rays along each side of a pixel."""
    leaves, tree = jax.tree.flatten(
        jax.tree.map(lambda x: np.asarray(x, float), seen.given)
    )

    def loss(number: int, place: Any, move: float) -> float:
        moved = [x.copy() for x in leaves]
        moved[number][place] += move
        given = jax.tree.map(jnp.asarray, jax.tree.unflatten(tree, moved))
        return float(np.sum((supersampled(seen, given, width, parts) - target) ** 2))

    slopes = []
    for number, leaf in enumerate(leaves):
        slope = np.zeros(leaf.shape)
        for place in np.ndindex(leaf.shape):
            ahead, behind = (loss(number, place, sign * step) for sign in (1, -1))
            slope[place] = (ahead - behind) / (2 * step)
        slopes.append(slope)
    return jax.tree.unflatten(tree, slopes)
