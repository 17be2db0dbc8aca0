"""Label images as files: the number of the object that each pixel shows."""

__all__ = ["read_labels", "read_one_mask"]

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Integer

from impostor_jax.fit.request import check_one_object
from impostor_jax.io.depth_image import _read_image


def read_labels(path: Path, what: str = "label image") -> Integer[np.ndarray, "h w"]:
    """Read a one-channel image of integers, 0 where there is no object.

    Args:
        path: File name.
        what: Names the image in errors.

    Raises:
        ValueError: The file is missing, broken or of another kind.
    """
    values = _read_image(path, what)
    if values.ndim != 2 or not np.issubdtype(values.dtype, np.integer):
        raise ValueError(
            f"{what} {str(path)!r} must have one channel of integers, got "
            f"{values.dtype} of shape {values.shape}"
        )
    return values


def read_one_mask(path: Path) -> Bool[np.ndarray, "h w"]:
    """Read the mask of one object, True where it is not 0.

    Raises:
        ValueError: As `read_labels`; or it holds several objects.
    """
    values = read_labels(path, "mask")
    check_one_object(values, f"mask {str(path)!r}", "--labels fits each")
    return values != 0
