"""Images of one channel, read within the bounds that their headers set.

What a header promises is checked, with the size that is wanted, before memory of that
size is taken; and no library prints anything.
"""

__all__ = [
    "Size",
    "check_image",
    "check_npy",
    "decoded_image",
    "read_image",
    "read_integers",
    "read_npy",
]

import io
from pathlib import Path

import numpy as np

from impostor_jax.io.image_header import PNG, TIFF, ImageHeader, plain_png, read_header
from impostor_jax.io.input_file import opened
from impostor_jax.io.npy_file import check_npy_bytes, npy_header
from impostor_jax.opencv import cv2
from impostor_jax.plain_arguments import image_size

MOST_EXTRA_BYTES = 2**26
"""Of a file beyond twice its pixels: profiles, previews and what else there is."""

Size = tuple[int, int]
"""Rows and columns."""


def read_npy(path: Path, what: str, size: Size | None) -> np.ndarray:
    """Read an NPY file of numbers; the arguments are those of `read_image`.

    Raises:
        ValueError: The file is missing, broken, or of another kind or size.
    """
    with opened(path, what) as file:
        _check_npy(file, what, size)
        file.seek(0)
        return np.load(file, allow_pickle=False)


def check_npy(path: Path, what: str, size: Size | None) -> None:
    """Raise what `read_npy` would, of a file's header alone."""
    with opened(path, what) as file:
        _check_npy(file, what, size)


def _check_npy(file: io.BufferedReader, what: str, size: Size | None) -> None:
    shape, dtype = npy_header(file, what)
    _check_one_channel(shape, what)
    _check_size((shape[0], shape[1]), what, size)
    if dtype.kind not in "fiu":
        raise ValueError(f"{what} must hold integers or floats, got {dtype}")
    check_npy_bytes(file, shape, dtype, what)


def read_integers(path: Path, what: str, size: Size | None) -> np.ndarray:
    """Read an image of integers; the arguments are those of `read_image`.

    Raises:
        ValueError: The file is missing, broken, or of another kind or size.
    """
    values = read_image(path, what, size)
    if not np.issubdtype(values.dtype, np.integer):
        raise ValueError(
            f"{what} must hold integers, got {values.dtype}: it looks like a depth "
            "image"
        )
    return values


def _check_one_channel(shape: tuple[int, ...], what: str) -> None:
    """Raise unless the shape is of rows and columns alone."""
    if len(shape) != 2:
        raise ValueError(f"{what} must have one channel, got shape {shape}")


def _check_size(found: Size, what: str, size: Size | None) -> None:
    """Raise unless an image has the camera's size, or any where there is none."""
    kind, _, name = what.partition(" '")
    if size is not None and found != size:
        raise ValueError(
            f"{kind} must have the camera's shape {size}, got {found} in '{name}"
        )
    try:
        image_size(found[1], found[0])
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from error


def read_image(path: Path, what: str, size: Size | None) -> np.ndarray:
    """Read a PNG or a TIFF.

    Args:
        path: Of the file.
        what: Names it in errors, with its path in quotes.
        size: Rows and columns that it must have; any if None.

    Raises:
        ValueError: The file is missing, broken, or of another kind or size.
    """
    with opened(path, what) as file:
        return decoded_image(file, path.stat().st_size, what, size)


def decoded_image(
    file: io.BufferedIOBase, num_bytes: int, what: str, size: Size | None
) -> np.ndarray:
    """Pixels of a PNG or a TIFF of one channel, as `read_image` reads them.

    Args:
        file: Open at its beginning.
        num_bytes: Of all of it.
        what: Names it in errors.
        size: Rows and columns that it must have; any if None.
    """
    header = _checked_header(file, num_bytes, what, size)
    file.seek(0)
    data = file.read()
    try:
        if header.format == PNG:
            data = plain_png(data, header)
    except ValueError as error:
        raise ValueError(f"{what} is not a readable image: {error}") from error
    # OpenCV prints a warning of its own for a broken file; the error below says it.
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        values = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        values = None
    finally:
        cv2.utils.logging.setLogLevel(level)
    if values is None:
        raise ValueError(f"{what} is not a readable image")
    _check_one_channel(values.shape, what)
    return values


def check_image(path: Path, what: str, size: Size | None) -> None:
    """Raise what `read_image` would, of a file's header alone."""
    with opened(path, what) as file:
        _checked_header(file, path.stat().st_size, what, size)


def _checked_header(
    file: io.BufferedIOBase, num_bytes: int, what: str, size: Size | None
) -> ImageHeader:
    """Header of a PNG or a TIFF of one channel; arguments as of `decoded_image`."""
    try:
        header = read_header(file)
        if header.format not in (PNG, TIFF):
            kind = f"a {header.format} file" if header.format else "something else"
            raise ValueError(f"it must be a PNG or a TIFF, got {kind}")
    except ValueError as error:
        raise ValueError(f"{what} is not a readable image: {error}") from error
    found = header.height, header.width
    if header.channels != 1:
        _check_one_channel((*found, header.channels), what)
    _check_size(found, what, size)
    if num_bytes > 2 * header.num_bytes + MOST_EXTRA_BYTES:
        raise ValueError(
            f"{what} is not a readable image: it has {num_bytes} bytes, and its header "
            f"promises {header.num_bytes}"
        )
    return header
