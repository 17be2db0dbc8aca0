"""CAPE, which grows cells of pixels into planes and cylinders.

It has no license and no package: its files are compiled from where `CAPE_ROOT` says,
the folder of `CAPE.cpp` in github.com/pedropro/CAPE.

References:
    Proenca and Gao, Fast cylinder and plane extraction from depth cameras for visual
    odometry, IROS 2018.
"""

__all__ = ["cape"]

import os

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

PARTS = ("CAPE", "CylinderSeg", "PlaneSeg", "Histogram")
"""Its files."""


def cape(
    depth: Float[np.ndarray, "h w"],
    camera: ij.PinholeCamera,
    sensor: ij.AbstractDepthNoise,
    *,
    cell: int = 8,
    angle_deg: float = 25.0,
    distance_mm: float = 50.0,
    fewest: float = 1000.0,
) -> list[Detection]:
    """CAPE, with cells of 8 pixels and merged up to 25 degrees.

    With those of its example, 20 and 15, it finds none of the cans: the cells are
    larger than they.
    """
    root = os.environ.get("CAPE_ROOT")
    if root is None:
        raise MissingProgramError(
            "CAPE_ROOT must be the folder of CAPE.cpp in github.com/pedropro/CAPE"
        )
    flags = (
        *(f"{root}/{part}.cpp" for part in PARTS),
        *("-lopencv_imgproc", "-lopencv_core"),
    )
    headers = (root, EIGEN, "/usr/include/opencv4")
    source = Source("cape", flags, headers, "CAPE, and Debian's libopencv-dev")
    seen = depth[depth > 0]
    middle = np.float32(np.median(seen)) if len(seen) else np.float32(1)
    noise = float(sensor.sigma(jnp.asarray(middle), jnp.asarray(np.float32(1))))
    settings = (*depth.shape, cell, angle_deg, distance_mm, 3 * noise)
    points = points_of(depth, camera).astype(np.float32)
    return detections_of(cylinders_of(source, points, settings), fewest)
