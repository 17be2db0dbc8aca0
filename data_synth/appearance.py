"""How things look in color: what is drawn at random, and what was drawn for a scene."""

__all__ = ["Appearance", "Look", "draw_look"]

import colorsys
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from data_synth.distribution import Distribution, LogUniform, Uniform
from data_synth.solid import Point, Solid
from impostor_jax.arguments import whole_number

PLACINGS = 50
"""Places that are tried for a lamp before the scene is given up."""

LEANING = 60.0
"""Largest angle of the way to a lamp from the middle of where lamps are, in degrees."""

MOST_LAMPS = 8
MOST_BOUNCES = 8
MOST_SAMPLES = 4


@dataclasses.dataclass(frozen=True)
class Appearance:
    """Materials and lights of color images, of which all that is drawn is recorded.

    A sensor of depth reads mirrors and glass as it reads what is dull: only color
    images show them.

    Attributes:
        saturation: Of the colors of things, from 0 to 1; hues are as likely as others.
        brightness: Largest of red, green and blue that a white light makes a thing.
        exponent: Of the highlights.
        mirrors: Share of the things that mirror.
        reflect: Part of the color of these that is mirrored.
        glasses: Share of the things, planes not among them, that light goes through.
        transmit: Part of the color of these that is seen through them.
        ior: Index of refraction of these.
        lamps: Number of lights that cast shadows.
        far: Distance of a lamp from what the camera looks at, over that of the camera.
        light: What all lamps together bring there to a white surface that faces them.
        ambient: Light from all sides.
        bounces: Most times that a ray is mirrored or bent.
        samples: Rays along each side of a pixel.
    """

    saturation: Distribution = Uniform(0.0, 0.8)
    brightness: Distribution = Uniform(0.2, 0.9)
    exponent: Distribution = LogUniform(5.0, 200.0)
    mirrors: float = 0.0
    reflect: Distribution = Uniform(0.1, 0.5)
    glasses: float = 0.0
    transmit: Distribution = Uniform(0.6, 0.9)
    ior: Distribution = Uniform(1.3, 1.7)
    lamps: int = 2
    far: Distribution = Uniform(1.0, 3.0)
    light: Distribution = Uniform(0.5, 0.9)
    ambient: Distribution = Uniform(0.1, 0.3)
    bounces: int = 3
    samples: int = 1

    def __post_init__(self) -> None:
        whole_number("lamps", self.lamps, 0, MOST_LAMPS)
        whole_number("bounces", self.bounces, 0, MOST_BOUNCES)
        whole_number("samples", self.samples, 1, MOST_SAMPLES)
        for name in ("mirrors", "glasses"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(
                    f"{name} must be a fraction from 0 to 1, got {getattr(self, name)}"
                )
        if self.mirrors + self.glasses > 1:
            raise ValueError(
                "mirrors and glasses must be at most 1 together, got "
                f"{self.mirrors} and {self.glasses}"
            )
        for name in ("saturation", "brightness", "reflect", "transmit"):
            low, high = getattr(self, name).ends
            if not 0 <= low <= high <= 1:
                raise ValueError(
                    f"{name} must be from 0 to 1, got {getattr(self, name)}"
                )
        for name in ("exponent", "ior", "far"):
            if not getattr(self, name).ends[0] > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("light", "ambient"):
            if getattr(self, name).ends[0] < 0:
                raise ValueError(
                    f"{name} must not be negative, got {getattr(self, name)}"
                )


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
    planes: Sequence[tuple[Point, Point]],
    cylinders: Sequence[Solid],
    scenery: Sequence[Solid],
    target: Point,
    above: Point | None,
    rng: np.random.Generator,
) -> Look | None:
    """Draw materials and lights of a scene; None where there is no room for a lamp.

    Args:
        appearance: What is drawn.
        planes: A point and a unit normal of each.
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
    planes: Sequence[tuple[Point, Point]],
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
