"""Cans drawn at random on a table, and what whole cameras read of them."""

__all__ = ["FOCAL_LENGTH", "SENSORS", "draw_image"]

import dataclasses

import jax
import numpy as np

import impostor_jax as ij
from experiments.outcomes import labeled
from impostor_jax.io.dataset_shard import LabeledImage
from impostor_jax.sensor.base import AbstractDepthNoise

FOCAL_LENGTH = 525.0
"""In pixels, of images of 640 x 480."""

WINDOW = 400, 320
"""Width and height of the part of the image that is looked at."""


@dataclasses.dataclass(frozen=True)
class Sensor:
    """A camera.

    Attributes:
        whole: With all that it errs by.
        noise: What single readings err by on their own.
    """

    whole: AbstractDepthNoise
    noise: AbstractDepthNoise


SENSORS = {
    "structured_light": Sensor(ij.StructuredLight.sensor(), ij.StructuredLight()),
    "stereo": Sensor(
        ij.StereoDisparity.sensor(FOCAL_LENGTH), ij.StereoDisparity(FOCAL_LENGTH)
    ),
    "time_of_flight": Sensor(ij.TimeOfFlight.sensor(), ij.TimeOfFlight()),
    # Of 1.6 and 1.1 mm in all, of which a caller who measures the scatter knows.
    "grain": Sensor(
        ij.CorrelatedNoise(ij.ConstantNoise(6e-4), 1.5e-3, length=2.8, power=0),
        ij.ConstantNoise(1.6e-3),
    ),
    "row_noise": Sensor(
        ij.LineNoise(ij.ConstantNoise(1e-3), 5e-4), ij.ConstantNoise(1.1e-3)
    ),
}
"""By name."""


def draw_image(sensor: AbstractDepthNoise, seed: int, number: int) -> LabeledImage:
    """What a camera reads of a can that stands, or lies, on a table.

    Args:
        sensor: That reads, with a hundredth of its readings missing.
        seed: Of all images.
        number: Of the image.
    """
    rng = np.random.default_rng([seed, number])
    can, table = _can_on_table(rng)
    camera = _camera_at(np.asarray(can.center))
    maps = ij.render(
        ij.Scene([can, table]), camera, outputs=("depth", "normal", "index")
    )
    assert maps.depth is not None
    assert maps.normal is not None
    key = jax.random.fold_in(jax.random.key(seed), number)
    depth = ij.Dropout(sensor).sample(key, maps.depth, maps.normal, camera)
    depth = np.asarray(depth)
    depth = np.where(np.isfinite(depth), depth, 0)
    return labeled(depth, np.asarray(maps.index) == 0, camera, can, number)


def _can_on_table(rng: np.random.Generator) -> tuple[ij.Cylinder, ij.Plane]:
    radius = rng.uniform(0.03, 0.06)
    height = radius * rng.uniform(2, 4)
    elevation = np.radians(rng.uniform(15, 70))
    up = np.array([0.0, -np.cos(elevation), -np.sin(elevation)])
    distance = rng.uniform(0.5, 1.0)
    center = distance * np.array([*rng.uniform(-0.2, 0.2, 2), 1.0])
    if rng.random() < 0.5:
        can = ij.Cylinder(center, up, radius, height)
        return can, ij.Plane(center - up * height / 2, up)
    ahead, turn = np.array([0.0, up[2], -up[1]]), rng.uniform(0, np.radians(75))
    axis = np.cos(turn) * np.array([1.0, 0.0, 0.0]) + np.sin(turn) * ahead
    can = ij.Cylinder(center, axis, radius, height)
    return can, ij.Plane(center - up * radius, up)


def _camera_at(center: np.ndarray) -> ij.PinholeCamera:
    """The part of an image of 640 x 480 pixels around a point."""
    width, height = WINDOW
    middle = np.array([319.5, 239.5]) + FOCAL_LENGTH * center[:2] / center[2]
    first = np.clip(np.round(middle) - [width / 2, height / 2], 0, [240, 160])
    cx, cy = np.array([319.5, 239.5]) - first
    return ij.PinholeCamera(FOCAL_LENGTH, FOCAL_LENGTH, cx, cy, width, height)
