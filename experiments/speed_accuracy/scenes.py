"""Images of three difficulties, and shapes to render."""

__all__ = ["DIFFICULTIES", "SHAPES", "Images", "Lit", "cans_and_mirror", "make_images"]

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij
from experiments.errors import bound
from experiments.scenes import SENSOR, FitCase, draw_can, draw_scene, make_can

DIFFICULTIES: dict[str, tuple[FitCase | None, Any]] = {
    "easy": (FitCase((40.0, 80.0)), 1e-3),
    "medium": (FitCase((20.0, 90.0), 3e-3, 0.05), 3e-3),
    "hard": (None, SENSOR),
}
"""A can at 1 mm of noise; at 3 mm, with 5 % of outliers, from more sides; and any
cylinder in clutter, cut off or behind something, with a sensor's noise and 10 % of
outliers: the case, None for these, and the noise that a fit is told."""

SHAPES: dict[str, Callable[[], ij.Cylinder]] = {
    "can": make_can,
    "rod": lambda: ij.Cylinder((0.1, 0.2, 3.0), (0.8, 0.4, 0.3), 0.005, 1.0),
    "pipe": lambda: ij.Cylinder((0.05, 0.0, 2.0), (0.05, 0.02, 1.0), 0.5, 6.0),
}
"""A can that covers 1.5 % of the image, a rod 1.8 pixels wide, and a pipe that is seen
from inside, all over the image."""


class Lit(NamedTuple):
    """What `ij.trace` takes beside a camera."""

    scene: ij.Scene
    lights: list[Any]
    materials: list[ij.Material]
    background: tuple[float, float, float]


def cans_and_mirror() -> Lit:
    """Two cans and a mirroring ball on a floor, under a lamp."""
    shapes = [
        ij.Plane((0.0, 0.2, 0.0), (0.0, -1.0, 0.0)),
        ij.Cylinder((-0.15, 0.1, 0.9), (0.0, 1.0, 0.0), 0.06, 0.2),
        ij.Cylinder((0.15, 0.15, 0.8), (1.0, 0.0, 0.4), 0.05, 0.2),
        ij.Sphere((0.02, 0.12, 1.0), 0.08),
    ]
    materials = [
        ij.Material((0.7, 0.65, 0.6)),
        ij.Material((0.8, 0.2, 0.15), 30.0),
        ij.Material((0.2, 0.4, 0.8), 80.0),
        ij.Material((0.9, 0.9, 0.9), 100.0, 0.6),
    ]
    lights = [ij.AmbientLight(0.15), ij.PointLight((0.6, -0.9, 0.3), 0.8)]
    return Lit(ij.Scene(shapes), lights, materials, (0.4, 0.5, 0.6))


@dataclasses.dataclass(frozen=True)
class Images:
    """Images of one difficulty.

    Attributes:
        depth: What was read, in meters.
        mask: Pixels of the cylinder.
        truth: Center, axis, radius and height of each.
        bounds: Cramér-Rao bound, in the coordinates of `Fit.covariance`.
    """

    depth: Float[np.ndarray, "n h w"]
    mask: Bool[np.ndarray, "n h w"]
    truth: Float[np.ndarray, "n 8"]
    bounds: Float[np.ndarray, "n 7"]


def make_images(difficulty: str, count: int) -> Images:
    """Draw images; the seeds are their numbers."""
    case, _ = DIFFICULTIES[difficulty]
    depth, mask, truth, bounds = [], [], [], []
    for seed in range(count):
        view = draw_scene(seed) if case is None else draw_can(case, seed)
        can = view.shape
        assert isinstance(can, ij.Cylinder)
        depth.append(view.depth)
        mask.append(view.mask)
        truth.append([*can.center, *can.axis, can.radius, can.height])
        bounds.append(bound(view))
    return Images(
        np.array(depth), np.array(mask), np.array(truth, float), np.array(bounds)
    )
