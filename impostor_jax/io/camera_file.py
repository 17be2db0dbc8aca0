"""The camera file: intrinsics in pixels, and the scale of integer depth images.

Or, of a laser scanner, the angles of its rows and columns.
"""

__all__ = [
    "CameraFile",
    "FiledCamera",
    "camera_from_record",
    "camera_record",
    "pinhole_of",
    "read_camera",
    "write_camera",
]

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.spherical import SphericalCamera
from impostor_jax.io.atomic import write_json
from impostor_jax.io.camera_formats import (
    REQUIRED,
    check_camera_record,
    read_camera_record,
)
from impostor_jax.io.spherical_record import ANGLES, MODEL, angles_of, angles_record

FiledCamera = PinholeCamera | SphericalCamera
"""What a camera file can hold."""


class CameraFile(NamedTuple):
    """What a camera file holds.

    Attributes:
        camera: The camera.
        depth_scale_m: Meters a unit of integer depth; None where the file has none.
    """

    camera: FiledCamera
    depth_scale_m: float | None


def read_camera(path: Path) -> CameraFile:
    """Read a camera from JSON, ROS's YAML or COLMAP's `cameras.txt`, by the ending.

    The keys of JSON are fx, fy, cx, cy, width, height, and optionally depth_scale_m,
    distortion (OpenCV's order) and fisheye (true for OpenCV's fisheye model); or model,
    "spherical", elevation_deg and azimuth_deg, each a list of degrees or a range, and
    optionally depth_scale_m. The other formats hold no scale, and are converted as by
    `camera_from`.

    Raises:
        ValueError: The file is missing or broken, a key is missing or unknown, or a
            value is out of range.
    """
    what = f"camera file {str(path)!r}"
    return camera_from_record(read_camera_record(path), what)


def pinhole_of(camera: FiledCamera, what: str) -> PinholeCamera:
    """A camera that is a pinhole camera; a `ValueError` says that `what` has none."""
    if not isinstance(camera, PinholeCamera):
        raise ValueError(f"{what} must have a pinhole camera, got a spherical one")
    return camera


def camera_from_record(record: dict[str, Any], what: str) -> CameraFile:
    """Make a camera from the keys of a camera file; `what` names it in errors.

    Raises:
        ValueError: A key is missing or unknown, or a value is out of range.
    """
    check_camera_record(record, what)
    values = dict(record)
    scale = values.pop("depth_scale_m", None)
    try:
        if values.pop("model", None) == MODEL:
            angles = (angles_of(values, name) for name in ANGLES)
            return CameraFile(SphericalCamera(*map(np.radians, angles)), scale)
        return CameraFile(PinholeCamera(**values), scale)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what}: {error}") from error


def write_camera(path: Path, camera: FiledCamera, depth_scale_m: float | None) -> None:
    """Write a camera as `read_camera` reads it; the pose is not written."""
    write_json(path, camera_record(camera, depth_scale_m))


def camera_record(
    camera: FiledCamera, depth_scale_m: float | None = None
) -> dict[str, Any]:
    """Keys of a camera file; the pose is none of them."""
    if isinstance(camera, SphericalCamera):
        radians = (camera.elevation, camera.azimuth)
        degrees = (np.degrees(np.asarray(table, np.float64)) for table in radians)
        record = {
            "model": MODEL,
            **dict(zip(ANGLES, map(angles_record, degrees), strict=True)),
        }
    else:
        record = {name: getattr(camera, name) for name in REQUIRED}
    if depth_scale_m is not None:
        record["depth_scale_m"] = depth_scale_m
    if isinstance(camera, PinholeCamera) and camera.distortion is not None:
        record["distortion"] = np.asarray(camera.distortion, dtype=float).tolist()
        record["fisheye"] = camera.fisheye
    return record
