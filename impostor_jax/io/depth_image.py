"""Depth images, masks and normal maps as files.

A 16-bit PNG holds integers that a scale turns into meters; TIFF and NPY hold meters as
floating-point numbers. A reading that is missing is written as 0.
"""

__all__ = [
    "FARTHEST",
    "check_depth_file",
    "check_image_name",
    "depth_of_png",
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

import io
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, UInt8

from impostor_jax.io.atomic import write_atomically
from impostor_jax.io.image_file import (
    Size,
    check_image,
    check_npy,
    decoded_image,
    read_image,
    read_integers,
    read_npy,
)
from impostor_jax.opencv import cv2

DEFAULT_DEPTH_SCALE_M = 0.0001
"""Meters a unit of the PNG files that are written: 0.1 mm, up to 6.5 m."""

MAX_UINT16 = 65535
"""The largest number of 16 bits: in depth files that others write, no reading."""

FARTHEST = MAX_UINT16 - 1
"""The largest reading, in units of the file."""

SUFFIXES = (".png", ".tif", ".tiff", ".npy")
"""Of files that hold depth."""


def read_depth(
    path: Path, depth_scale_m: float | None, size: Size | None = None
) -> Float[np.ndarray, "h w"]:
    """Read a depth image in meters.

    Args:
        path: A 16-bit PNG, a floating-point TIFF or an NPY file.
        depth_scale_m: Meters a unit of integer readings; not used for floats.
        size: Rows and columns that it must have; known from the header, before
            anything is read. Any if None.

    Returns:
        Planar depth in meters; 0, NaN and infinity mean no reading, as in the file. So
        does 65535 in 16 bits, which is 0 here.

    Raises:
        ValueError: The file is missing, broken or of another kind or size, or integer
            readings come without a positive scale.
    """
    is_npy, what = _kind_of(path)
    read = read_npy if is_npy else read_image
    return _in_meters(read(path, what, size), depth_scale_m, what)


def check_depth_file(path: Path, size: Size | None = None) -> None:
    """Raise what `read_depth` would, of a file's name and header alone."""
    is_npy, what = _kind_of(path)
    check = check_npy if is_npy else check_image
    check(path, what, size)


def _kind_of(path: Path) -> tuple[bool, str]:
    """Whether a depth image is an NPY file by its suffix, and its name in errors."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(
            f"depth image must be a .png, .tiff or .npy file, got {str(path)!r}"
        )
    return suffix == ".npy", f"depth image {str(path)!r}"


def depth_of_png(
    data: bytes, depth_scale_m: float, what: str, size: Size
) -> Float[np.ndarray, "h w"]:
    """The depth image of a PNG's bytes, as `read_depth` reads it from a file.

    Args:
        data: Of the file.
        depth_scale_m: Meters a unit.
        what: Names it in errors.
        size: Rows and columns that it must have.
    """
    values = decoded_image(io.BytesIO(data), len(data), what, size)
    return _in_meters(values, depth_scale_m, what)


def _in_meters(
    values: np.ndarray, depth_scale_m: float | None, what: str
) -> Float[np.ndarray, "h w"]:
    if np.issubdtype(values.dtype, np.floating):
        return values
    if not np.issubdtype(values.dtype, np.integer):
        raise ValueError(f"{what} must hold integers or floats, got {values.dtype}")
    if values.dtype == np.uint8:
        raise ValueError(
            f"{what} must have 16 bits a pixel, got 8: it looks like a picture"
        )
    if depth_scale_m is None:
        raise ValueError(
            f"depth_scale_m must be given in the camera file: {what} holds "
            f"{values.dtype} readings"
        )
    if values.dtype == np.uint16:
        values = np.where(values == MAX_UINT16, 0, values)
    return values * float(depth_scale_m)


def read_mask(path: Path, size: Size | None = None) -> Bool[np.ndarray, "h w"]:
    """Read a mask: a one-channel image of integers, True where it is not 0.

    Args:
        path: A PNG or a TIFF; a JPEG is refused, since it is not 0 around the object.
        size: Rows and columns that it must have; any if None.

    Raises:
        ValueError: The file is missing, broken or of another kind or size.
    """
    return read_integers(path, f"mask {str(path)!r}", size) != 0


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
        if largest > given * FARTHEST:
            raise ValueError(
                f"depth_scale_m must be at least {largest / FARTHEST:.3g} for depths "
                f"up to {largest:.4g} m in 16 bits, got {given}"
            )
        return given
    scale = DEFAULT_DEPTH_SCALE_M
    while largest > scale * FARTHEST:
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
    units = np.where(units <= FARTHEST, units, 0).astype(np.uint16)
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
    write_image(path, np.where(np.ma.filled(mask, False), 255, 0).astype(np.uint8))


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
    values = np.ma.filled(np.ma.asanyarray(depth), 0)
    return np.where(np.isfinite(values), values, 0)


def check_image_name(path: Path) -> None:
    """Raise unless the suffix of a file is of a format that can be written."""
    if not cv2.haveImageWriter(path.name):
        raise ValueError(
            f"output must have the suffix of a picture, such as .png, got {str(path)!r}"
        )


def write_image(path: Path, values: np.ndarray) -> None:
    """Write an image as it is, in the format of the file's suffix."""
    check_image_name(path)

    def write(partial: Path) -> None:
        if not cv2.imwrite(str(partial), values):
            raise OSError(f"cannot write {str(path)!r}")

    write_atomically(path, write)
