"""Pictures as files: linear light as it is, and in the sRGB of screens."""

__all__ = ["read_picture", "srgb", "srgb_levels"]

from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from impostor_jax.io.image_file import Size
from impostor_jax.opencv import cv2


def srgb(linear: Any) -> Float[np.ndarray, "..."]:
    """What sRGB has for linear light, both from 0 to 1; light beyond is clipped.

    References:
        IEC 61966-2-1:1999, section 5.2.
    """
    light = np.clip(np.asarray(linear), 0, 1)
    return np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055
    )


def srgb_levels(linear: Any) -> UInt8[np.ndarray, "h w 3"]:
    """Blue, green and red in sRGB, as OpenCV writes them, of linear (H, W, 3)."""
    levels = np.rint(255 * srgb(linear)).astype(np.uint8)
    return np.ascontiguousarray(levels[..., ::-1])


def read_picture(data: bytes, what: str, size: Size) -> UInt8[np.ndarray, "h w 3"]:
    """Red, green and blue of a picture of 8 bits a channel, as they are in its file.

    Args:
        data: Of the file.
        what: Names it in errors.
        size: Rows and columns that it must have.

    Raises:
        ValueError: It is no picture, or of another size.
    """
    coded = np.frombuffer(data, np.uint8)
    picture = cv2.imdecode(coded, cv2.IMREAD_COLOR) if coded.size else None
    if picture is None:
        raise ValueError(f"{what} is not a readable picture")
    if picture.shape[:2] != size:
        raise ValueError(
            f"{what} must have the camera's shape {size}, got {picture.shape[:2]}"
        )
    return np.ascontiguousarray(picture[..., ::-1])
