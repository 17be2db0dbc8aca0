"""Depth images, masks and normal maps as files.

A 16-bit PNG holds integers that a scale turns into meters; TIFF and NPY hold meters as
floating-point numbers. A reading that is missing is written as 0.
"""

__all__ = [
    "MAX_UINT16",
    "fitting_scale",
    "normal_colors",
    "png_bytes",
    "read_depth",
    "read_mask",
    "write_depth_png",
    "write_depth_tiff",
    "write_image",
    "write_mask",
    "write_normals",
]

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from impostor_jax.io.atomic import write_atomically

DEFAULT_DEPTH_SCALE_M = 0.0001
"""Meters a unit of the PNG files that are written: 0.1 mm, up to 6.5 m."""

MAX_UINT16 = 65535


def read_depth(path: Path, depth_scale_m: float | None) -> Float[np.ndarray, "h w"]:
    """Read a depth image in meters.

    Args:
        path: A 16-bit PNG, a floating-point TIFF or an NPY file.
        depth_scale_m: Meters a unit of integer readings; not used for floats.

    Returns:
        Planar depth in meters; 0, NaN and infinity mean no reading, as in the file.

    Raises:
        ValueError: The file is missing, broken or of another kind, or integer readings
            come without a positive scale.
    """
    suffix = path.suffix.lower()
    if suffix not in (".png", ".tif", ".tiff", ".npy"):
        raise ValueError(
            f"depth image must be a .png, .tiff or .npy file, got {str(path)!r}"
        )
    values = _read_npy(path) if suffix == ".npy" else _read_image(path, "depth image")
    if values.ndim != 2:
        raise ValueError(
            f"depth image {str(path)!r} must have one channel, got shape {values.shape}"
        )
    if np.issubdtype(values.dtype, np.floating):
        return values
    if not np.issubdtype(values.dtype, np.integer):
        raise ValueError(
            f"depth image {str(path)!r} must hold integers or floats, "
            f"got {values.dtype}"
        )
    if values.dtype == np.uint8:
        raise ValueError(
            f"depth image {str(path)!r} must have 16 bits a pixel, got 8: it looks "
            "like a picture"
        )
    if depth_scale_m is None:
        raise ValueError(
            f"depth_scale_m must be given in the camera file: {str(path)!r} holds "
            f"{values.dtype} readings"
        )
    return values * float(depth_scale_m)


def read_mask(path: Path) -> Bool[np.ndarray, "h w"]:
    """Read a mask: a one-channel image, True where it is not 0.

    Raises:
        ValueError: The file is missing, broken or of another kind.
    """
    values = _read_image(path, "mask")
    if values.ndim != 2:
        raise ValueError(
            f"mask {str(path)!r} must have one channel, got shape {values.shape}"
        )
    return values != 0


def fitting_scale(depth: Any, given: float | None) -> float:
    """Meters a unit with which 16 bits hold all of a depth image.

    Args:
        depth: (H, W), in meters; not finite where there is no reading.
        given: Scale to use; None chooses 0.1 mm, or ten times as much as often as the
            largest depth needs.

    Raises:
        ValueError: The given scale is too fine.
    """
    largest = float(_finite(depth).max())
    if given is not None:
        if largest > given * MAX_UINT16:
            raise ValueError(
                f"depth_scale_m must be at least {largest / MAX_UINT16:.3g} for depths "
                f"up to {largest:.4g} m in 16 bits, got {given}"
            )
        return given
    scale = DEFAULT_DEPTH_SCALE_M
    while largest > scale * MAX_UINT16:
        scale *= 10
    return scale


def write_depth_png(path: Path, depth: Any, depth_scale_m: float) -> None:
    """Write depth as a 16-bit PNG; beyond its range counts as missing.

    Args:
        path: File name.
        depth: (H, W), in meters; not finite where there is no reading.
        depth_scale_m: Meters a unit.
    """
    units = np.rint(_finite(depth) / depth_scale_m)
    units = np.where(units <= MAX_UINT16, units, 0).astype(np.uint16)
    write_image(path, units)


def write_depth_tiff(path: Path, depth: Any) -> None:
    """Write depth as a 32-bit float TIFF in meters.

    Args:
        path: File name.
        depth: (H, W), in meters; not finite where there is no reading.
    """
    write_image(path, _finite(depth).astype(np.float32))


def write_mask(path: Path, mask: Any) -> None:
    """Write a mask as an 8-bit PNG of 0 and 255."""
    write_image(path, np.where(np.asarray(mask), 255, 0).astype(np.uint8))


def write_index(path: Path, index: Any) -> None:
    """Write which shape is seen as a 16-bit PNG: 0 for none, k + 1 for shape k.

    Args:
        path: File name.
        index: (H, W), -1 where there is none, below 65535.
    """
    values = np.asarray(index) + 1
    if values.max() > MAX_UINT16:
        raise ValueError(f"index must be below {MAX_UINT16}, got {values.max() - 1}")
    write_image(path, values.astype(np.uint16))


def write_normals(path: Path, normal: Any) -> None:
    """Write a normal map as an 8-bit PNG, in the colors of `normal_colors`.

    Args:
        path: File name.
        normal: (H, W, 3), unit; zero where there is no surface.
    """
    write_image(path, normal_colors(normal))


def normal_colors(normal: Any) -> UInt8[np.ndarray, "h w 3"]:
    """Colors of a normal map: red, green, blue = 127.5 (x, y, z) + 127.5.

    Args:
        normal: (H, W, 3), unit; the zero vector, for no surface, becomes black.

    Returns:
        Blue, green and red, as OpenCV writes them.
    """
    vectors = np.asarray(normal)
    colors = np.rint(127.5 * vectors + 127.5).astype(np.uint8)
    colors[~np.any(vectors, axis=-1)] = 0
    return np.ascontiguousarray(colors[..., ::-1])


def png_bytes(values: np.ndarray) -> bytes:
    """The PNG file of an image of 8 or 16 bits a channel."""
    done, buffer = cv2.imencode(".png", values)
    assert done
    return buffer.tobytes()


def _finite(depth: Any) -> Float[np.ndarray, "h w"]:
    values = np.asarray(depth)
    return np.where(np.isfinite(values), values, 0)


def _read_npy(path: Path) -> np.ndarray:
    _require_file(path, "depth image")
    try:
        return np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise ValueError(
            f"depth image {str(path)!r} is not a readable NPY file"
        ) from error


def _read_image(path: Path, what: str) -> np.ndarray:
    _require_file(path, what)
    # OpenCV prints a warning of its own for a broken file; the error below says it.
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        values = None
    finally:
        cv2.utils.logging.setLogLevel(level)
    if values is None:
        raise ValueError(f"{what} {str(path)!r} is not a readable image")
    return values


def _require_file(path: Path, what: str) -> None:
    if not path.is_file():
        raise ValueError(f"{what} {str(path)!r} does not exist")


def write_image(path: Path, values: np.ndarray) -> None:
    """Write an image as it is, in the format of the file's suffix."""

    def write(partial: Path) -> None:
        if not cv2.imwrite(str(partial), values):
            raise OSError(f"cannot write {str(path)!r}")

    write_atomically(path, write)
