"""Label images as files: the number of the object that each pixel shows."""

__all__ = ["read_labels", "read_one_mask"]

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Integer

from impostor_jax.fit.request import check_one_object
from impostor_jax.io.image_file import Size, read_integers


def read_labels(
    path: Path, size: Size | None = None, name: str = "label image"
) -> Integer[np.ndarray, "h w"]:
    """Read a one-channel image of integers, 0 where there is no object.

    Args:
        path: A PNG or a TIFF.
        size: Rows and columns that it must have; any if None.
        name: Of the image, for errors.

    Raises:
        ValueError: The file is missing, broken or of another kind or size.
    """
    return read_integers(path, f"{name} {str(path)!r}", size)


def read_one_mask(path: Path, size: Size | None = None) -> Bool[np.ndarray, "h w"]:
    """Read the mask of one object, True where it is not 0.

    Raises:
        ValueError: As `read_labels`; or it holds several objects.
    """
    values = read_labels(path, size, "mask")
    check_one_object(values, f"mask {str(path)!r}", "--labels fits each")
    return values != 0
