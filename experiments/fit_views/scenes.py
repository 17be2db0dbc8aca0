"""A can, and the cameras around it that see it."""

__all__ = ["Around", "draw_around"]

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.errors import joint_bound
from experiments.scenes import (
    DISTANCE,
    HEIGHT,
    RADIUS,
    WALL,
    View,
    make_view,
    with_noise,
)
from impostor_jax.geometry.frames import moved_by

RAISED = (15.0, 40.0)
"""Angles in degrees by which a camera is above the can, or below it."""


@dataclasses.dataclass(frozen=True)
class Around:
    """Views of a can, and the cameras that took them."""

    can: ij.Cylinder
    views: list[View]
    cameras: list[ij.PinholeCamera]

    def fit(self, plainly: bool = False, pose_sigma: Any = (0.0, 0.0)) -> ij.Fit:
        """Fit what was read, or what would be without noise.

        Args:
            plainly: Whether without.
            pose_sigma: As of `fit_cylinder`; of exact poses by default.
        """
        depths = [view.depth for view in self.views]
        if plainly:
            depths = [_read(self.can, camera)[0] for camera in self.cameras]
        return ij.fit_cylinder(
            depths,
            self.cameras,
            mask=[view.mask for view in self.views],
            sigma=self.views[0].sigma,
            initial=self.can if plainly else None,
            pose_sigma=pose_sigma,
        )

    def off(self, place: float, turn: float, rng: np.random.Generator) -> "Around":
        """The same by cameras of which a caller knows the poses only about.

        Args:
            place: Standard deviation along each axis of a camera, in meters.
            turn: The same of a rotation about each, in radians.
            rng: Of the draws.
        """
        told = []
        for camera in self.cameras:
            motion = rng.normal(0, np.repeat([turn, place], 3))
            pose = camera.camera_from_world
            assert pose is not None
            pose = moved_by(jnp.asarray(motion)) @ pose
            told.append(eqx.tree_at(lambda c: c.camera_from_world, camera, pose))
        return dataclasses.replace(self, cameras=told)

    def bound(self, reachable: bool = False) -> Float[np.ndarray, " k"]:
        """Of the depths of all views.

        They leave an end open that no view sees; the places where it stops in the
        images tell of it, each uniform within a pixel. What all that tells is what a
        fit to exact images says.

        Args:
            reachable: As of `joint_bound`.
        """
        of_depths = joint_bound(self.views, self.cameras, reachable=reachable)
        of_all = np.sqrt(np.diagonal(np.asarray(self.fit(plainly=True).covariance)))
        return np.where(np.isfinite(of_depths), of_depths, of_all)


def draw_around(count: int, sigma: float, rng: np.random.Generator) -> Around:
    """A can, tilted by up to 20 degrees, and cameras around it."""
    tilt = rng.normal(0, np.radians(10), 2)
    can = ij.Cylinder(rng.uniform(-0.02, 0.02, 3), (*tilt, 1), RADIUS, HEIGHT)
    first, below = rng.uniform(0, 360), rng.integers(2)
    views, cameras = [], []
    for k in range(count):
        turn = np.radians(first + k * 360 / count)
        raised = np.radians(rng.uniform(*RAISED)) * (-1) ** (k + below)
        camera = _looking(turn, raised)
        depth, mask = _read(can, camera)
        views.append(View(can, with_noise(depth, sigma, rng), mask, sigma))
        cameras.append(camera)
    return Around(can, views, cameras)


def _looking(turn: float, raised: float) -> ij.PinholeCamera:
    """A camera that looks at the origin, upright."""
    towards = -np.array(
        [np.cos(turn) * np.cos(raised), np.sin(turn) * np.cos(raised), np.sin(raised)]
    )
    right = np.cross(towards, (0, 0, 1.0))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = right, np.cross(towards, right), towards
    pose[2, 3] = DISTANCE
    plain = make_view(640, 480)
    intrinsics = (plain.fx, plain.fy, plain.cx, plain.cy, plain.width, plain.height)
    return ij.PinholeCamera(*intrinsics, camera_from_world=pose)


def _read(
    can: ij.Cylinder, camera: ij.PinholeCamera
) -> tuple[Float[np.ndarray, "h w"], np.ndarray]:
    """Depth and mask without noise, in front of a wall that each camera has."""
    maps = ij.render(can, camera, outputs=("depth", "mask"))
    depth = np.minimum(np.asarray(maps.depth), WALL)
    return depth, np.asarray(maps.mask)
