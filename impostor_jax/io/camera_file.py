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
from impostor_jax.io.json_file import check_keys, read_json_object

REQUIRED = ("fx", "fy", "cx", "cy", "width", "height")
LARGEST_SCALE_M = 1e6
"""Meters a unit: a thousand kilometers."""

OPTIONAL = ("depth_scale_m", "distortion", "fisheye")


class CameraFile(NamedTuple):
    """What a camera file holds.

    Attributes:
        camera: The camera.
        depth_scale_m: Meters a unit of integer depth; None where the file has none.
    """

    camera: PinholeCamera
    depth_scale_m: float | None


def read_camera(path: Path) -> CameraFile:
    """Read a camera from JSON.

    The keys are fx, fy, cx, cy, width, height, and optionally depth_scale_m,
    distortion (OpenCV's order) and fisheye (true for OpenCV's fisheye model).

    Raises:
        ValueError: The file is missing or broken, a key is missing or unknown, or a
            value is out of range.
    """
    what = f"camera file {str(path)!r}"
    return camera_from_record(read_json_object(path, what), what)


def camera_from_record(record: dict[str, Any], what: str) -> CameraFile:
    """Make a camera from the keys of a camera file; `what` names it in errors.

    Raises:
        ValueError: A key is missing or unknown, or a value is out of range.
    """
    check_keys(record, REQUIRED, (*REQUIRED, *OPTIONAL), what)
    values = dict(record)
    scale = values.pop("depth_scale_m", None)
    try:
        if scale is not None and not _is_scale(scale):
            raise ValueError(
                "depth_scale_m must be a positive number of meters a unit, got "
                f"{scale!r}"
            )
        fisheye = values.get("fisheye", False)
        if not isinstance(fisheye, bool):
            raise ValueError(f"fisheye must be true or false, got {fisheye!r}")
        return CameraFile(PinholeCamera(**values), scale)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what}: {error}") from error


def _is_scale(scale: Any) -> bool:
    """Whether a value of JSON's is a scale, with which 16 bits stay in range."""
    # True is a whole number to Python, and a mistake in a file.
    is_number = isinstance(scale, int | float) and not isinstance(scale, bool)
    return is_number and 0 < scale <= LARGEST_SCALE_M


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
