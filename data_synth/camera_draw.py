"""The cameras of a dataset, as distributions: pinhole cameras, or laser scanners."""

__all__ = ["CameraDraw", "ScannerDraw", "draw_cameras"]

import dataclasses

import numpy as np

from data_synth.distribution import Distribution, Fixed, check_positive
from impostor_jax.arguments import image_size, whole_number
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.spherical import SphericalCamera
from impostor_jax.io.camera_file import FiledCamera

MAX_CAMERAS = 10**4
"""Most cameras of a dataset, all of which are made before the first image."""

STEEPEST = 85.0
"""Elevation to which a scanner looks, up and down, in degrees."""


@dataclasses.dataclass(frozen=True)
class CameraDraw:
    """Intrinsics of the dataset's cameras, one of which takes an image.

    Attributes:
        count: Number of cameras.
        width: Number of columns.
        height: Number of rows.
        focal: In pixels, the same along rows and columns.
        shift: Of the principal point from the image's middle, along each, in pixels.
        distortion: Of k1 and k2 of the lens, in OpenCV's order; None for no lens.
    """

    count: int = 8
    width: int = 640
    height: int = 480
    focal: Distribution = Fixed(525.0)
    shift: Distribution = Fixed(0.0)
    distortion: tuple[Distribution, Distribution] | None = None

    def __post_init__(self) -> None:
        whole_number("count", self.count, 1, MAX_CAMERAS)
        image_size(self.width, self.height)


@dataclasses.dataclass(frozen=True)
class ScannerDraw:
    """Laser scanners that stand upright on the ground and make a full turn.

    Attributes:
        count: Number of scanners.
        width: Number of columns, in a turn.
        height: Number of rows.
        up: Elevation of the topmost row, in degrees.
        down: Elevation of the lowest row, in degrees, negative below the horizon.
        stand: Height above the ground, in meters; another in each image.
    """

    count: int = 1
    width: int = 2048
    height: int = 256
    up: Distribution = Fixed(40.0)
    down: Distribution = Fixed(-30.0)
    stand: Distribution = Fixed(1.75)

    def __post_init__(self) -> None:
        whole_number("count", self.count, 1, MAX_CAMERAS)
        image_size(self.width, self.height)
        low, high = self.down.ends, self.up.ends
        if not -STEEPEST <= low[0] <= low[1] < high[0] <= high[1] <= STEEPEST:
            raise ValueError(
                f"down must be below up, both from {-STEEPEST} to {STEEPEST} degrees, "
                f"got {self.down} and {self.up}"
            )
        check_positive("stand", self.stand)


def draw_cameras(
    draw: CameraDraw | ScannerDraw, rng: np.random.Generator
) -> tuple[FiledCamera, ...]:
    """Draw the cameras of a dataset."""
    if isinstance(draw, ScannerDraw):
        return tuple(_scanner(draw, rng) for _ in range(draw.count))
    return tuple(_pinhole(draw, rng) for _ in range(draw.count))


def _scanner(draw: ScannerDraw, rng: np.random.Generator) -> SphericalCamera:
    ends = np.radians([draw.up.draw(rng), draw.down.draw(rng)])
    return SphericalCamera.regular(draw.width, draw.height, *ends)


def _pinhole(draw: CameraDraw, rng: np.random.Generator) -> PinholeCamera:
    focal = draw.focal.draw(rng)
    shift = [draw.shift.draw(rng) for _ in range(2)]
    distortion = None
    if draw.distortion is not None:
        distortion = [*(part.draw(rng) for part in draw.distortion), 0.0, 0.0, 0.0]
    return PinholeCamera(
        focal,
        focal,
        (draw.width - 1) / 2 + shift[0],
        (draw.height - 1) / 2 + shift[1],
        width=draw.width,
        height=draw.height,
        distortion=distortion,
    )
