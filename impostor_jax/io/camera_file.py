"""The camera file: intrinsics in pixels, and the scale of integer depth images."""

__all__ = ["CameraFile", "read_camera", "write_camera"]

import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.io.atomic import write_json

REQUIRED = ("fx", "fy", "cx", "cy", "width", "height")
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
    if not path.is_file():
        raise ValueError(f"camera file {str(path)!r} does not exist")
    try:
        record = json.loads(path.read_text())
    except (ValueError, OSError) as error:
        raise ValueError(f"camera file {str(path)!r} is not readable JSON") from error
    if not isinstance(record, dict):
        raise ValueError(f"camera file {str(path)!r} must hold one JSON object")
    missing = [key for key in REQUIRED if key not in record]
    if missing:
        raise ValueError(f"camera file {str(path)!r} lacks {', '.join(missing)}")
    unknown = sorted(set(record) - {*REQUIRED, *OPTIONAL})
    if unknown:
        raise ValueError(
            f"camera file {str(path)!r} holds unknown keys: {', '.join(unknown)}"
        )
    scale = record.pop("depth_scale_m", None)
    if scale is not None and not (
        isinstance(scale, int | float) and math.isfinite(scale) and scale > 0
    ):
        raise ValueError(
            f"depth_scale_m must be a positive number of meters a unit, got {scale!r}"
        )
    fisheye = record.get("fisheye", False)
    if not isinstance(fisheye, bool):
        raise ValueError(f"fisheye must be true or false, got {fisheye!r}")
    return CameraFile(PinholeCamera(**record), scale)


def write_camera(
    path: Path, camera: PinholeCamera, depth_scale_m: float | None
) -> None:
    """Write a camera as `read_camera` reads it; the pose is not written."""
    record: dict[str, object] = {
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "width": camera.width,
        "height": camera.height,
    }
    if depth_scale_m is not None:
        record["depth_scale_m"] = depth_scale_m
    if camera.distortion is not None:
        record["distortion"] = np.asarray(camera.distortion, dtype=float).tolist()
        record["fisheye"] = camera.fisheye
    write_json(path, record)
