"""Materials and lights of one scene, drawn at random."""

__all__ = ["Look", "draw_look"]

import colorsys
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from data_synth.appearance import Appearance
from data_synth.arrange import PLACINGS, Plane
from data_synth.solid import Point, Solid

LEANING = 60.0
"""Largest angle of the way to a lamp from the middle of where lamps are, in degrees."""


@dataclasses.dataclass(frozen=True)
class Look:
    """Materials and lights of one scene, in the camera's frame, as a label has them.

    Attributes:
        planes: Arguments of `ij.Material` for each plane.
        cylinders: For each cylinder.
        scenery: For each other thing, all of whose shapes are of one.
        lights: As in the file of a scene: a type and its arguments.
        background: Red, green and blue where nothing is.
    """

    planes: list[dict[str, Any]]
    cylinders: list[dict[str, Any]]
    scenery: list[dict[str, Any]]
    lights: list[dict[str, Any]]
    background: list[float]


def draw_look(
    appearance: Appearance,
    planes: Sequence[Plane],
    cylinders: Sequence[Solid],
    scenery: Sequence[Solid],
    target: Point,
    above: Point | None,
    rng: np.random.Generator,
) -> Look | None:
    """Draw materials and lights of a scene; None where there is no room for a lamp.

    Args:
        appearance: What is drawn.
        planes: Those of the scene.
        cylinders: In the order of their labels.
        scenery: The other things.
        target: What the camera looks at.
        above: Unit vector to the middle of where lamps are; None puts them at the
            camera.
        rng: Source of all that is drawn.
    """
    # Materials first, so that with another light things look the same.
    of_planes, of_cylinders, of_scenery = (
        [_material(appearance, rng, is_plane) for _ in things]
        for things, is_plane in ((planes, True), (cylinders, False), (scenery, False))
    )
    background = _color(appearance, rng)
    lights = [{"type": "ambient", "intensity": appearance.ambient.draw(rng)}]
    light = appearance.light.draw(rng) / max(appearance.lamps, 1)
    for _ in range(appearance.lamps):
        place = np.zeros(3)
        if above is not None:
            place = _place(
                appearance, planes, [*cylinders, *scenery], target, above, rng
            )
        if place is None:
            return None
        distance = float(np.linalg.norm(place - target))
        lights.append(
            {
                "type": "point",
                "position": place.tolist(),
                "intensity": light * distance**2,
                "falloff": "inverse_square",
            }
        )
    return Look(of_planes, of_cylinders, of_scenery, lights, background)


def _color(appearance: Appearance, rng: np.random.Generator) -> list[float]:
    hue, saturation = rng.random(), appearance.saturation.draw(rng)
    return list(colorsys.hsv_to_rgb(hue, saturation, appearance.brightness.draw(rng)))


def _material(
    appearance: Appearance, rng: np.random.Generator, is_plane: bool
) -> dict[str, Any]:
    """Arguments of a material."""
    material = {
        "color": _color(appearance, rng),
        "exponent": appearance.exponent.draw(rng),
    }
    kind = rng.random()
    if kind < appearance.mirrors:
        material["reflect"] = appearance.reflect.draw(rng)
    elif kind < appearance.mirrors + appearance.glasses and not is_plane:
        material["transmit"] = appearance.transmit.draw(rng)
        material["ior"] = appearance.ior.draw(rng)
    return material


def _place(
    appearance: Appearance,
    planes: Sequence[Plane],
    things: Sequence[Solid],
    target: Point,
    above: Point,
    rng: np.random.Generator,
) -> Point | None:
    """Where a lamp is: before all planes, and in no thing; None if nowhere."""
    for _ in range(PLACINGS):
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        distance = appearance.far.draw(rng) * np.linalg.norm(target)
        place = target + distance * way
        if (
            way @ above > np.cos(np.radians(LEANING))
            and all(normal @ (place - point) > 0 for point, normal in planes)
            and all(np.linalg.norm(place - one.middle) > one.reach for one in things)
        ):
            return place
    return None
