"""Depth images of cylinders, drawn and real, and the same with other last bits."""

__all__ = [
    "REAL",
    "Image",
    "desk",
    "drawn",
    "moved_by_one_ulp",
    "real",
    "rounded",
]

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import impostor_jax as ij
from experiments.real_images.cases import CASES, Case
from experiments.sensor_models.scenes import SENSORS, draw_image
from impostor_jax.io.camera_file import pinhole_of, read_camera
from impostor_jax.io.depth_image import read_depth
from impostor_jax.sensor.base import AbstractDepthNoise

REAL = (
    *CASES,
    *(
        Case(
            f"tin {number}",
            depth=f"field/tin{number}_depth.png",
            mask=f"field/tin{number}_mask.png",
            camera="field/tin_camera.json",
            radius=0.0984,
            sensor="structured_light",
        )
        for number in (35, 36)
    ),
)
"""Those of `real_images`, and two tins before a Kinect."""


@dataclasses.dataclass(frozen=True)
class Image:
    """What is fitted.

    Attributes:
        name: Of the image.
        depth: In meters.
        mask: Pixels of the cylinder.
        camera: That took it.
        sensor: What is told of it; None for nothing.
    """

    name: str
    depth: np.ndarray
    mask: np.ndarray
    camera: ij.PinholeCamera
    sensor: AbstractDepthNoise | None

    def fit(self, effort: ij.Effort | str = "balanced") -> ij.Fit:
        """With the mask, and without a start."""
        return ij.fit_cylinder(
            self.depth, self.camera, self.mask, self.sensor, effort=effort
        )


def drawn(sensor: str, count: int, seed: int) -> Iterator[Image]:
    """Cans on a table that a whole camera reads, told which."""
    whole = SENSORS[sensor].whole
    for number in range(count):
        image = draw_image(whole, seed, number)
        name = f"{sensor} {number}"
        camera = pinhole_of(image.camera, name)
        yield Image(name, image.depth, image.mask[0], camera, whole)


def real(folder: Path) -> Iterator[Image]:
    """Photographs of depth, with the sensor told and with nothing told."""
    for case in REAL:
        depth, mask, camera = case.read(folder)
        whole, _ = case.sensors(camera)
        yield Image(f"{case.name}, told", depth, mask, camera, whole)
        yield Image(f"{case.name}, nothing told", depth, mask, camera, None)


def desk(folder: Path) -> Image:
    """A photograph without a mask: a can among other things."""
    camera, scale = read_camera(folder / "field/desk_camera.json")
    depth = read_depth(folder / "field/desk_depth.png", scale)
    return Image("desk", depth, depth > 0, pinhole_of(camera, "desk"), None)


def moved_by_one_ulp(image: Image, rng: np.random.Generator) -> Image:
    """Each reading is the next larger or the next smaller number of its type."""
    # Of single precision, in which fits compute.
    depth = image.depth.astype(np.float32)
    ends = np.where(rng.random(depth.shape) < 0.5, np.inf, -np.inf).astype(np.float32)
    moved = np.where(depth > 0, np.nextafter(depth, ends), depth)
    return dataclasses.replace(image, depth=moved)


def rounded(image: Image, step: float) -> Image:
    """Readings on a grid, in meters."""
    depth = (np.round(image.depth / step) * step).astype(image.depth.dtype)
    return dataclasses.replace(image, depth=depth)
