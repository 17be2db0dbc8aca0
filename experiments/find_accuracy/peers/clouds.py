"""Programs that search a cloud of points: what they are given, and their settings.

All lengths are multiples of the sensor's noise and of the distance of neighboring
points, both at the 10 % quantile of depth: objects are nearer than what is behind them.
So cans and trees are searched with one set of settings: those that did best on 6 images
of each preset with other seeds than those that are reported. Each was varied while the
others stayed; what was tried is in brackets in README.md.
"""

__all__ = ["cgal", "pcl", "pyransac3d"]

import importlib.util
import random
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.find_accuracy.peers.compiling import (
    EIGEN,
    Source,
    cylinders_of,
    detections_of,
)
from experiments.find_accuracy.program import MissingProgramError
from impostor_jax.matching import Detection, points_of

PCL = Source(
    "pcl",
    tuple(
        f"-lpcl_{part}"
        for part in (
            *("segmentation", "sample_consensus", "features", "filters"),
            *("search", "kdtree", "octree", "common"),
        )
    ),
    (*(f"/usr/include/pcl-1.{minor}" for minor in range(11, 20)), EIGEN),
    "Debian's libpcl-dev",
)

CGAL = Source(
    "cgal",
    ("-DCGAL_EIGEN3_ENABLED", "-lgmp", "-lmpfr"),
    (EIGEN,),
    "Debian's libcgal-dev and libeigen3-dev",
)

RADII = (0.005, 0.6)
"""Least and largest radius that is looked for, in meters: what the presets draw lies
well within."""


class Cloud(NamedTuple):
    """Points of an image of which the median readings of blocks were taken.

    Attributes:
        points: In the camera's frame, in meters.
        noise: Standard deviation of a reading of small depth, in meters.
        far_noise: Of one of large depth.
        spacing: Distance of neighboring points of small depth, in meters.
    """

    points: Float[np.ndarray, "n 3"]
    noise: float
    far_noise: float
    spacing: float


def cloud_of(
    depth: Float[np.ndarray, "h w"],
    camera: ij.PinholeCamera,
    sensor: ij.AbstractDepthNoise,
    block: int,
    near: float,
) -> Cloud:
    """The readings of an image as a cloud.

    Args:
        depth: Readings in meters, 0 for none.
        camera: Of the image.
        sensor: Its noise.
        block: Rows and columns of a block of pixels that becomes a point.
        near: Part of the readings that are nearer than the depth that counts as small.
    """
    height, width = (block * (side // block) for side in depth.shape)
    blocks = depth[:height, :width].reshape(height // block, block, -1, block)
    readings = np.where(blocks > 0, blocks, np.nan).transpose(0, 2, 1, 3)
    readings = readings.reshape(*readings.shape[:2], -1)
    seen = np.count_nonzero(readings > 0, axis=2) > block**2 / 2
    middle = slice(block // 2, None, block)
    unit = points_of(np.ones_like(depth), camera)[middle, middle]
    unit = unit[: seen.shape[0], : seen.shape[1]][seen]
    median = np.nanmedian(readings[seen], axis=1)
    if not len(median):
        return Cloud(np.zeros((0, 3)), 0.0, 0.0, 0.0)
    small, large = np.quantile(median, (near, 1 - near))
    noises = sensor.sigma(
        jnp.asarray(np.array([small, large], np.float32)), jnp.ones(2)
    )
    noise, far_noise = np.asarray(noises, float)
    spacing = float(block * small / camera.fx)
    return Cloud(unit * median[:, None], noise, far_noise, spacing)


def pcl(
    depth: Float[np.ndarray, "h w"],
    camera: ij.PinholeCamera,
    sensor: ij.AbstractDepthNoise,
    *,
    near: float = 0.1,
    block: int = 4,
    threshold: float = 6.0,
    neighbors: int = 30,
    weight: float = 0.1,
    plane_threshold: float = 0.5,
    plane_part: float = 0.1,
    fewest: int = 40,
    samples: int = 1000,
    gap: float = 2.0,
    radii: tuple[float, float] = RADII,
) -> list[Detection]:
    """PCL: planes by RANSAC, clusters, and in each cylinders by RANSAC, one by one.

    Without clusters it stops at the first object that is none: they take its mean AP
    from 0.33 to 0.44 (standard).
    """
    cloud = cloud_of(depth, camera, sensor, block, near)
    settings = (
        *(threshold * cloud.noise, neighbors, weight, plane_part, fewest, *radii),
        *(samples, gap * cloud.spacing, plane_threshold * cloud.far_noise),
    )
    return detections_of(cylinders_of(PCL, cloud.points, settings), fewest)


def cgal(
    depth: Float[np.ndarray, "h w"],
    camera: ij.PinholeCamera,
    sensor: ij.AbstractDepthNoise,
    *,
    near: float = 0.1,
    block: int = 4,
    threshold: float = 1.5,
    neighbors: int = 10,
    angle_deg: float = 35.0,
    gap: float = 3.0,
    fewest: int = 60,
    missed: float = 0.01,
    radii: tuple[float, float] = RADII,
) -> list[Detection]:
    """CGAL's Efficient RANSAC for cylinders and planes."""
    cloud = cloud_of(depth, camera, sensor, block, near)
    settings = (
        *(threshold * cloud.noise, neighbors, angle_deg, gap * cloud.spacing),
        *(fewest, *radii, missed),
    )
    return detections_of(cylinders_of(CGAL, cloud.points, settings), fewest)


def pyransac3d(
    depth: Float[np.ndarray, "h w"],
    camera: ij.PinholeCamera,
    sensor: ij.AbstractDepthNoise,
    *,
    near: float = 0.1,
    block: int = 8,
    threshold: float = 2.0,
    plane_threshold: float = 2.0,
    plane_part: float = 0.1,
    fewest: int = 30,
    samples: int = 1000,
    most: int = 8,
) -> list[Detection]:
    """The same with pyransac3d, whose cylinders go through three points.

    It stops when `most` were tried: each takes a second.
    """
    if importlib.util.find_spec("pyransac3d") is None:
        raise MissingProgramError("pyransac3d is not installed: pip install '.[bench]'")
    import pyransac3d  # pyright: ignore[reportMissingImports]

    random.seed(0)
    cloud = cloud_of(depth, camera, sensor, block, near)
    points, limit = cloud.points, plane_part * len(cloud.points)
    while len(points) > max(limit, 3):
        search = pyransac3d.Plane()
        _, inliers = search.fit(
            points, plane_threshold * cloud.far_noise, maxIteration=samples
        )
        if len(inliers) < limit:
            break
        points = np.delete(points, inliers, axis=0)
    rows = []
    for _ in range(most):
        if len(points) < fewest:
            break
        search = pyransac3d.Cylinder()
        # Three points may lie on a line.
        with np.errstate(divide="ignore", invalid="ignore"):
            center, axis, radius, inliers = search.fit(
                points, threshold * cloud.noise, maxIteration=samples
            )
        if len(inliers) < fewest:
            break
        if RADII[0] < radius < RADII[1]:
            rows.append([*center, *axis, radius, len(inliers)])
        points = np.delete(points, inliers, axis=0)
    return detections_of(np.array(rows, float).reshape(-1, 8), fewest)
