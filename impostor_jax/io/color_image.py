"""Pictures as files: linear light as it is, and in the sRGB of screens."""

__all__ = ["srgb", "write_linear", "write_picture"]

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from impostor_jax.io.atomic import write_atomically
from impostor_jax.io.depth_image import write_image


def srgb(linear: Any) -> Float[np.ndarray, "..."]:
    """What sRGB has for linear light, both from 0 to 1; light beyond is clipped.

    References:
        IEC 61966-2-1:1999, section 5.2.
    """
    light = np.clip(np.asarray(linear), 0, 1)
    return np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055
    )


def write_picture(path: Path, linear: Any) -> None:
    """Write a picture of 8 bits a channel, in sRGB.

    Args:
        path: File name.
        linear: (H, W, 3), linear red, green and blue.
    """
    # OpenCV writes blue first.
    levels = np.rint(255 * srgb(linear)).astype(np.uint8)
    write_image(path, np.ascontiguousarray(levels[..., ::-1]))


def write_linear(path: Path, linear: Any) -> None:
    """Write linear light as an NPY file of 32-bit floats.

    Args:
        path: File name, with the suffix .npy.
        linear: (H, W, 3), linear red, green and blue.
    """
    values = np.asarray(linear, np.float32)
    write_atomically(path, lambda partial: np.save(partial, values))
