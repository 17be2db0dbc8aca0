"""The camera file: intrinsics in pixels, and the scale of integer depth images."""

__all__ = [
    "CameraFile",
    "camera_from_record",
    "camera_record",
    "read_camera",
    "write_camera",
]

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.io.atomic import write_json
from impostor_jax.io.camera_formats import (
    REQUIRED,
    check_camera_record,
    read_camera_record,
)


class CameraFile(NamedTuple):
    """What a camera file holds.

    Attributes:
        camera: The camera.
        depth_scale_m: Meters a unit of integer depth; None where the file has none.
    """

    camera: PinholeCamera
    depth_scale_m: float | None


def read_camera(path: Path) -> CameraFile:
    """Read a camera from JSON, ROS's YAML or COLMAP's `cameras.txt`, by the ending.

    The keys of JSON are fx, fy, cx, cy, width, height, and optionally depth_scale_m,
    distortion (OpenCV's order) and fisheye (true for OpenCV's fisheye model). The other
    formats hold no scale, and are converted as by `camera_from`.

    Raises:
        ValueError: The file is missing or broken, a key is missing or unknown, or a
            value is out of range.
    """
    what = f"camera file {str(path)!r}"
    return camera_from_record(read_camera_record(path), what)


def camera_from_record(record: dict[str, Any], what: str) -> CameraFile:
    """Make a camera from the keys of a camera file; `what` names it in errors.

    Raises:
        ValueError: A key is missing or unknown, or a value is out of range.
    """
    check_camera_record(record, what)
    values = dict(record)
    scale = values.pop("depth_scale_m", None)
    try:
        return CameraFile(PinholeCamera(**values), scale)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what}: {error}") from error


def write_camera(
    path: Path, camera: PinholeCamera, depth_scale_m: float | None
) -> None:
    """Write a camera as `read_camera` reads it; the pose is not written."""
    write_json(path, camera_record(camera, depth_scale_m))


def camera_record(
    camera: PinholeCamera, depth_scale_m: float | None = None
) -> dict[str, Any]:
    """Keys of a camera file; the pose is none of them."""
    record = {name: getattr(camera, name) for name in REQUIRED}
    if depth_scale_m is not None:
        record["depth_scale_m"] = depth_scale_m
    if camera.distortion is not None:
        record["distortion"] = np.asarray(camera.distortion, dtype=float).tolist()
        record["fisheye"] = camera.fisheye
    return record
