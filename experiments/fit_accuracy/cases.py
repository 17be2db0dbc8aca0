"""Noisy images of a can in a known pose."""

__all__ = ["CAMERA", "CASES", "DISTANCE", "Case", "View", "draw"]

import dataclasses

import cv2
import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij

CAMERA = ij.PinholeCamera(525.0, 525.0, 319.5, 239.5, width=640, height=480)

DISTANCE = 0.8
"""Of the can, in meters."""

WALL = 1.2
"""Distance of the wall behind it, in meters."""


@dataclasses.dataclass(frozen=True)
class Case:
    """What the images of a case have in common.

    Attributes:
        degrees: Least and largest angle between the axis and the view.
        sigma: Deviation of a reading, in meters.
        outliers: Part of the readings that are drawn from 0.3 to 1.5 m.
        correlation: Distance in pixels at which the errors' correlation is 1/e; 0 for
            white noise.
    """

    degrees: tuple[float, float]
    sigma: float = 1e-3
    outliers: float = 0.0
    correlation: float = 0.0


CASES = {
    f"{degrees:.0f}deg.{name}": Case((degrees, degrees), sigma, outliers)
    for degrees in (90.0, 60.0, 30.0, 10.0)
    for name, sigma, outliers in (
        ("1mm", 1e-3, 0.0),
        ("3mm", 3e-3, 0.0),
        ("outliers", 1e-3, 0.1),
    )
}


@dataclasses.dataclass(frozen=True)
class View:
    """One image of the can.

    Attributes:
        can: The truth, in the camera frame.
        depth: What was read, in meters.
        mask: Pixels whose ray hits the can.
        wall: Those among them whose ray hits its wall.
    """

    can: ij.Cylinder
    depth: Float[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "h w"]
    wall: Bool[np.ndarray, "h w"]


def draw(case: Case, seed: int) -> View:
    """Draw an image.

    The can's place in the image and the turn of its axis there are drawn, too: how its
    edge falls on the pixels is chance like the noise, and no part of a bias.
    """
    rng = np.random.default_rng(seed)
    angle, turn = np.radians(rng.uniform(*case.degrees)), rng.uniform(0.3, 1.2)
    across = np.sin(angle) * np.array([np.cos(turn), np.sin(turn)])
    center = np.array([0.02, 0.01, DISTANCE]) + rng.uniform(-0.01, 0.01, 3)
    can = ij.Cylinder(center, (*across, np.cos(angle)), 0.04, 0.12)
    maps = ij.render(can, CAMERA, outputs=("depth", "point", "mask"))
    true, mask = np.minimum(np.asarray(maps.depth), WALL), np.asarray(maps.mask)
    offset = np.where(mask[..., None], np.asarray(maps.point), 0) - center
    on_wall = np.abs(offset @ np.asarray(can.axis)) < 0.06 * (1 - 1e-4)
    depth = true + case.sigma * _errors(case.correlation, rng)
    wrong = rng.random(true.shape) < case.outliers
    depth = np.where(wrong, rng.uniform(0.3, 1.5, true.shape), depth)
    return View(can, depth.astype(np.float32), mask, mask & on_wall)


def _errors(correlation: float, rng: np.random.Generator) -> Float[np.ndarray, "h w"]:
    """Normal errors of unit deviation."""
    errors = rng.normal(size=(CAMERA.height, CAMERA.width))
    if correlation == 0:
        return errors
    # Noise blurred by a Gaussian has a correlation of twice its variance.
    spread = correlation / 2
    errors = cv2.GaussianBlur(errors, (0, 0), spread)
    kernel = cv2.getGaussianKernel(8 * int(np.ceil(spread)) + 1, spread)
    return errors / np.sum(kernel**2)
