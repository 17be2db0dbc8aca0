"""A contact sheet: some images of a dataset in color, with the outlines of labels."""

__all__ = ["preview"]

import itertools
import math
from pathlib import Path

import numpy as np
from jaxtyping import Bool, UInt8
from skimage.segmentation import find_boundaries

from impostor_jax.arguments import whole_number
from impostor_jax.io.atomic import check_output_file
from impostor_jax.io.dataset import read_dataset
from impostor_jax.io.dataset_shard import LabeledImage
from impostor_jax.io.depth_image import check_image_name, write_image
from impostor_jax.opencv import cv2

WIDTH = 320
"""Of an image on the sheet, in pixels."""

COLORS = ((80, 80, 255), (80, 255, 80), (255, 160, 80), (80, 255, 255), (255, 80, 255))
"""Of outlines, blue, green and red."""


def preview(folder: str | Path, output: str | Path, count: int = 12) -> None:
    """Write a contact sheet of the first images of a dataset.

    Depth is colored from near, red, to far, blue, over the range of each image;
    missing readings are black. Each cylinder's visible part has an outline. Beside it
    is the image in color, if there is one.

    Args:
        folder: Of the dataset.
        output: PNG file to write.
        count: Most images on it.

    Raises:
        ValueError: There is no dataset, or it has no images yet, or the file cannot be
            written as a picture.
    """
    whole_number("count", count, 1)
    check_image_name(Path(output))
    check_output_file(Path(output))
    some = itertools.islice(read_dataset(folder, allow_partial=True), count)
    tiles = [_picture(image) for image in some]
    if not tiles:
        raise ValueError(f"dataset {str(folder)!r} has no images yet")
    columns = math.ceil(math.sqrt(len(tiles)))
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % columns)
    rows = [np.hstack(tiles[k : k + columns]) for k in range(0, len(tiles), columns)]
    write_image(Path(output), np.vstack(rows))


def _picture(image: LabeledImage) -> UInt8[np.ndarray, "h w 3"]:
    depth, seen = image.depth, image.depth > 0
    near, far = np.percentile(depth[seen], (1, 99)) if seen.any() else (0.0, 1.0)
    share = np.clip((far - depth) / max(far - near, 1e-6), 0, 1)
    colors = cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_TURBO)
    colors[~seen] = 0
    pictures = [_outlined(colors, image.mask)]
    if image.color is not None:
        pictures.append(_outlined(image.color[..., ::-1], image.mask))
    return np.hstack(pictures)


def _outlined(
    colors: UInt8[np.ndarray, "h w 3"], masks: Bool[np.ndarray, "n h w"]
) -> UInt8[np.ndarray, "sheet_h sheet_w 3"]:
    """A picture, as large as on the sheet, with the masks' outlines."""
    scale = WIDTH / colors.shape[1]
    height = max(1, round(scale * colors.shape[0]))
    picture = cv2.resize(colors, (WIDTH, height), interpolation=cv2.INTER_AREA)
    for k, mask in enumerate(masks):
        small = cv2.resize(
            mask.astype(np.uint8), (WIDTH, height), interpolation=cv2.INTER_NEAREST
        )
        border = find_boundaries(small, mode="inner")
        picture[border] = COLORS[k % len(COLORS)]
    return picture
