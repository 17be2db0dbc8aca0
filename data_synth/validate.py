"""Checking a dataset: is it whole, unchanged, and do its labels say what it shows?"""

__all__ = ["validate"]

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from data_synth.checksums import (
    problems_of_list,
    problems_of_models,
    problems_of_shard,
    trusted_list,
)
from data_synth.manifest import Manifest
from impostor_jax.io.dataset import read_dataset
from impostor_jax.io.dataset_shard import LabeledImage


def validate(folder: str | Path) -> list[str]:
    """Look for what is wrong with a dataset.

    Every file is compared with its checksum, every file of checksums with the one that
    the manifest has of them all, and every image is read as its users do: whether it
    has the camera's size, and its masks do not overlap and hold something where the
    labels say so.

    Args:
        folder: Of the dataset.

    Returns:
        A sentence for each thing that is wrong; none for a good dataset.

    Raises:
        ValueError: There is no manifest, or it is broken.
    """
    home = Path(folder)
    manifest = Manifest.read(home)
    trusted = trusted_list(home, manifest)
    problems = [
        *problems_of_list(home, manifest),
        *problems_of_models(home, manifest, trusted),
    ]
    missing = manifest.missing(home, range(manifest.num_shards))
    absent = set(missing)
    for shard in range(manifest.num_shards):
        if shard not in absent:
            problems += problems_of_shard(home, manifest, shard, trusted)
    problems += _missing(missing)
    if problems:
        return problems
    count = 0
    try:
        for image in read_dataset(home):
            count += 1
            problems += [f"{image.key}: {what}" for what in _wrong(image)]
    except ValueError as error:
        problems.append(f"not readable after {count} images: {error}")
    return problems


def _missing(shards: Sequence[int]) -> Iterator[str]:
    """A sentence for each run of shards that are not there."""
    runs = itertools.groupby(enumerate(shards), lambda place: place[1] - place[0])
    for _, run in runs:
        numbers = [shard for _, shard in run]
        if len(numbers) == 1:
            yield f"shard {numbers[0]} is missing; resume makes it"
        else:
            yield (
                f"shards {numbers[0]} to {numbers[-1]} are missing; resume makes them"
            )


def _wrong(image: LabeledImage) -> Iterator[str]:
    if (np.count_nonzero(image.mask, axis=0) > 1).any():
        yield "visible masks overlap"
    seen = image.mask.any(axis=(1, 2))
    if (seen != (image.visible_fraction > 0)).any():
        yield "visible fractions and masks disagree"
