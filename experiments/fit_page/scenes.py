"""Images of a can and of a table with cans, and what was fitted to them."""

__all__ = ["can_page", "table_page"]

import jax
import numpy as np
from jaxtyping import Float

import impostor_jax as ij

SIGMA = 0.001

CAN = ij.Cylinder((0.02, 0.01, 0.8), (0.3, 0.8, 0.52), radius=0.04, height=0.12)
WALL = ij.Plane((0.0, 0.0, 1.2), (0.0, 0.0, -1.0))

UP = np.array((0.0, -0.88, -0.475)) / np.linalg.norm((0.0, -0.88, -0.475))
RIGHT = np.array((1.0, 0.0, 0.0))
NEARER = np.cross(RIGHT, UP)
TABLE = np.array((0.0, 0.1, 0.8))

STANDING = (
    (-0.17, 0.0, 0.033, 0.115),
    (-0.05, 0.05, 0.04, 0.1),
    (0.07, -0.04, 0.05, 0.14),
    (0.17, 0.06, 0.026, 0.09),
)
"""To the right, towards the camera, radius and height, in meters."""


def can_page(width: int, seed: int) -> ij.FitPage:
    """The page of one can in front of a wall, fitted without a mask."""
    view = camera(width)
    readings = drawn(ij.Scene([CAN, WALL]), view, seed)
    return ij.view(ij.fit_cylinder(readings, view, sigma=SIGMA), readings, view)


def table_page(width: int, seed: int) -> ij.FitPage:
    """The page of what is found on a table: four cans that stand and one that lies."""
    view = camera(width)
    cans = [
        ij.Cylinder(
            TABLE + right * RIGHT + nearer * NEARER + UP * (height / 2),
            UP,
            radius,
            height,
        )
        for right, nearer, radius, height in STANDING
    ]
    place = TABLE + 0.02 * RIGHT + 0.14 * NEARER + 0.025 * UP
    lying = ij.Cylinder(place, 0.8 * RIGHT + 0.6 * NEARER, 0.025, 0.13)
    readings = drawn(ij.Scene([ij.Plane(TABLE, UP), *cans, lying]), view, seed)
    return ij.view(ij.find_cylinders(readings, view, sigma=SIGMA), readings, view)


def camera(width: int) -> ij.PinholeCamera:
    """The camera of the first example, with pixels of another size."""
    height = width * 3 // 4
    focal = 525.0 * width / 640
    return ij.PinholeCamera(
        focal, focal, (width - 1) / 2, (height - 1) / 2, width, height
    )


def drawn(
    scene: ij.Scene, view: ij.PinholeCamera, seed: int
) -> Float[np.ndarray, "h w"]:
    """Readings with noise, 0 where there is nothing."""
    maps = ij.render(scene, view, outputs=("depth", "normal"))
    assert maps.depth is not None
    assert maps.normal is not None
    noise = ij.ConstantNoise(SIGMA)
    readings = noise.sample(jax.random.key(seed), maps.depth, maps.normal, view)
    return np.asarray(readings)
