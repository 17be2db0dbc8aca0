"""Checking a dataset: is it whole, unchanged, and do its labels say what it shows?"""

__all__ = ["validate"]

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from data_synth.manifest import Manifest
from impostor_jax.io.dataset import LabeledImage, read_dataset


def validate(folder: str | Path) -> list[str]:
    """Look for what is wrong with a dataset.

    Every file is compared with its checksum, and every image is read as its users do:
    whether it has the camera's size, and its masks do not overlap and hold something
    where the labels say so.

    Args:
        folder: Of the dataset.

    Returns:
        A sentence for each thing that is wrong; none for a good dataset.

    Raises:
        ValueError: There is no manifest, or it is broken.
    """
    home = Path(folder)
    manifest = Manifest.read(home)
    problems = []
    for shard in range(manifest.num_shards):
        path = manifest.checksums_path(home, shard)
        if not manifest.is_done(home, shard):
            problems.append(f"shard {shard} is missing; resume makes it")
        else:
            problems += _changed(home, path.read_text())
    if problems:
        return problems
    count = 0
    try:
        for image in read_dataset(home):
            count += 1
            problems += [f"{image.key}: {what}" for what in _wrong(image)]
    except (ValueError, KeyError) as error:
        problems.append(f"not readable after {count} images: {error}")
    else:
        if count != manifest.count:
            problems.append(f"{count} images are there, {manifest.count} should be")
    return problems


def _changed(home: Path, listing: str) -> Iterator[str]:
    """Files that are not as their checksums say."""
    for line in listing.splitlines():
        digest, _, name = line.partition("  ")
        path = home / name
        if not path.is_file():
            yield f"{name} is missing"
            continue
        with path.open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != digest:
                yield f"{name} has changed since it was written"


def _wrong(image: LabeledImage) -> Iterator[str]:
    size = image.camera.height, image.camera.width
    if image.depth.shape != size or image.mask.shape[1:] != size:
        yield f"depth {image.depth.shape} and masks must have the size {size}"
    elif (np.count_nonzero(image.mask, axis=0) > 1).any():
        yield "visible masks overlap"
    seen = image.mask.any(axis=(1, 2))
    if (seen != (image.visible_fraction > 0)).any():
        yield "visible fractions and masks disagree"
