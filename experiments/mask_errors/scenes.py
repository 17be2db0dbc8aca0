"""Cans on a table and before a wall, and masks that are not theirs."""

__all__ = ["MASKS", "SCENES", "TRUE_MASK", "CanScene", "clean_view"]

import dataclasses
from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.scenes import CAMERA, DISTANCE, Image, Mask

PLACE = np.array([0.02, 0.01, DISTANCE])
"""Center of every can, in meters."""

WALL = DISTANCE + 0.3
"""Distance of the wall, in meters."""


@dataclasses.dataclass(frozen=True)
class CanScene:
    """A can and what is behind it.

    Attributes:
        group: Of the scenes that are alike.
        can: In the camera frame.
        ground: The table that it touches, or the wall, which it does not.
    """

    group: str
    can: ij.Cylinder
    ground: ij.Plane


def _standing(
    group: str, elevation: float, radius: float = 0.04, height: float = 0.12
) -> CanScene:
    up = _up(elevation)
    can = ij.Cylinder(PLACE, up, radius, height)
    return CanScene(group, can, ij.Plane(PLACE - up * height / 2, up))


def _lying(elevation: float, yaw: float, radius: float = 0.04) -> CanScene:
    """With an axis that is turned from the image's rows towards the view."""
    up, turn = _up(elevation), np.radians(yaw)
    ahead = np.array([0.0, up[2], -up[1]])
    axis = np.cos(turn) * np.array([1.0, 0.0, 0.0]) + np.sin(turn) * ahead
    can = ij.Cylinder(PLACE, axis, radius, 0.12)
    return CanScene("lying", can, ij.Plane(PLACE - up * radius, up))


def _before_wall(angle: float) -> CanScene:
    """With an axis at about this angle to the view."""
    sine, cosine = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    can = ij.Cylinder(PLACE, (0.2 * sine, 0.98 * sine, cosine), 0.04, 0.12)
    return CanScene("wall", can, ij.Plane((0, 0, WALL), (0, 0, -1)))


def _up(elevation: float) -> Float[np.ndarray, "3"]:
    """The table's normal where the camera looks down at it by so many degrees."""
    return np.array(
        [0.0, -np.cos(np.radians(elevation)), -np.sin(np.radians(elevation))]
    )


SCENES = {
    **{f"table.{e}deg": _standing("table", e) for e in (15, 30, 50, 70)},
    "small.30deg": _standing("small", 30, radius=0.025, height=0.08),
    "lying.30deg": _lying(30, yaw=30),
    "lying.45deg": _lying(45, yaw=70),
    **{f"wall.{angle}deg": _before_wall(angle) for angle in (90, 60, 30)},
}
"""By name."""


def clean_view(scene: CanScene) -> tuple[Image, Mask]:
    """Depth without noise, 0 where nothing is, and the can's mask."""
    both = ij.Scene([scene.can, scene.ground])
    maps = ij.render(both, CAMERA, outputs=("depth", "index"))
    depth = np.asarray(maps.depth, np.float64)
    return np.where(np.isfinite(depth), depth, 0), np.asarray(maps.index) == 0


def _morphed(pixels: int) -> Callable[[Mask, np.random.Generator], Mask]:
    """Larger by so many pixels to all sides, corners too; smaller where negative."""
    change = cv2.dilate if pixels > 0 else cv2.erode
    around = np.ones((3, 3), np.uint8)
    return lambda mask, _: (
        change(mask.astype(np.uint8), around, iterations=abs(pixels)) > 0
    )


def _with_holes(mask: Mask, rng: np.random.Generator) -> Mask:
    """Without a third of its pixels."""
    return mask & (rng.random(mask.shape) > 1 / 3)


def _half(mask: Mask, axis: int) -> Mask:
    """The half of its pixels with the smaller rows (axis 0) or columns (axis 1)."""
    place = np.indices(mask.shape)[axis]
    return mask & (place < np.median(place[mask]))


TRUE_MASK = "0 px"

MASKS = {
    **{f"{-pixels} px": _morphed(-pixels) for pixels in (6, 4, 2, 1)},
    TRUE_MASK: lambda mask, _: mask,
    **{f"+{pixels} px": _morphed(pixels) for pixels in (1, 2, 3, 4)},
    "holes": _with_holes,
    "left half": lambda mask, _: _half(mask, 1),
    "upper half": lambda mask, _: _half(mask, 0),
}
"""What is made of the can's mask, by name; from random numbers where they are used."""
