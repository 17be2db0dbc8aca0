"""Videos of cans on a table: still, moving, and hidden for a while."""

__all__ = ["CAMERA", "Frame", "hidden_video", "table_video"]

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

import impostor_jax as ij

CAMERA = ij.PinholeCamera(525.0, 525.0, 319.5, 239.5, 640, 480)
RATE = 30.0
UP = np.array([0.0, -0.8, -0.6])
PLACE = np.array([0.0, 0.05, 0.95])
"""Of the table before the first camera."""

ALONG = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, -0.8]])
"""Two directions along the table."""

SPOTS = ((-0.21, 0.02), (-0.07, -0.05), (0.08, 0.03), (0.22, -0.04))
"""Of four cans on it, in meters along these."""

WAY = 0.03
"""Meters that a can goes in a video, and comes back."""

ORBIT = 0.1
"""Meters that the camera goes to the side, within a second."""


class Frame(NamedTuple):
    """An image of a video.

    Attributes:
        depth: Readings in meters.
        camera_from_world: Pose of the camera.
        cans: What is there, in the world.
    """

    depth: Float[np.ndarray, "h w"]
    camera_from_world: Float[np.ndarray, "4 4"]
    cans: list[ij.Cylinder]


def table_video(
    count: int, sigma: float, scale: float, rng: np.random.Generator
) -> Iterator[Frame]:
    """Four cans on a table, two of which move, before a camera that does.

    Args:
        count: Number of images.
        sigma: Noise of each reading, in meters.
        scale: Error of all depths of the video: its fraction.
        rng: Of sizes and noise.
    """
    sizes = [(rng.uniform(0.025, 0.045), rng.uniform(0.09, 0.15)) for _ in SPOTS]
    ways = rng.uniform(0, 2 * np.pi, len(SPOTS))
    table = ij.Plane(PLACE, UP)
    for k in range(count):
        part = WAY * (1 - np.cos(2 * np.pi * k / RATE)) / 2
        pose = np.eye(4)
        pose[0, 3] = -ORBIT * np.sin(2 * np.pi * k / RATE / 4)
        cans = []
        for number, (radius, height) in enumerate(sizes):
            way = np.array([np.cos(ways[number]), np.sin(ways[number])])
            spot = np.array(SPOTS[number]) + (number % 2) * part * way
            foot = PLACE + spot @ ALONG
            cans.append(ij.Cylinder(foot + height / 2 * UP, UP, radius, height))
        yield _frame([table, *cans], cans, pose, sigma, scale, rng)


def hidden_video(
    before: int, hidden: int, after: int, sigma: float, rng: np.random.Generator
) -> Iterator[Frame]:
    """A can that goes to the side, and another; a box hides the first for a while."""
    radius, height = rng.uniform(0.025, 0.045), rng.uniform(0.09, 0.15)
    speed, place = rng.uniform(-0.05, 0.05), rng.uniform(-0.03, 0.03, 2)
    box = ij.Box((0.0, 0.0, 0.4), np.eye(3), (0.16, 0.28, 0.03))
    wall = ij.Plane((0.0, 0.0, 1.3), (0.0, 0.0, -1.0))
    axis = np.array([0.1, -0.95, -0.3])
    for k in range(before + hidden + after):
        x = place[0] + speed * (k - before - hidden / 2) / RATE
        cans = [
            ij.Cylinder((x, place[1], 0.8), axis, radius, height),
            ij.Cylinder((0.3, place[1], 0.9), axis, 0.03, 0.1),
        ]
        hides = [box] if before <= k < before + hidden else []
        yield _frame([wall, *cans, *hides], cans, np.eye(4), sigma, 0.0, rng)


def _frame(
    shapes: list[ij.AbstractPrimitive],
    cans: list[ij.Cylinder],
    pose: Float[np.ndarray, "4 4"],
    sigma: float,
    scale: float,
    rng: np.random.Generator,
) -> Frame:
    camera = ij.PinholeCamera(
        525.0, 525.0, 319.5, 239.5, 640, 480, camera_from_world=pose
    )
    depths = [
        np.asarray(ij.render(shape, camera, outputs=("depth",)).depth)
        for shape in shapes
    ]
    depth = np.min(depths, axis=0) * (1 + scale)
    depth = depth + sigma * rng.normal(size=depth.shape)
    depth = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    return Frame(depth, pose, cans)
