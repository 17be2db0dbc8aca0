"""The manifest of a synthetic dataset, and which of its shards are there.

Nothing here needs JAX, so that a command can refuse a folder before JAX starts.
"""

__all__ = [
    "CHECKSUMS",
    "MANIFEST",
    "MAX_IMAGES",
    "MAX_SHARDS",
    "SPLIT",
    "read_manifest",
    "shard_name",
    "shards_there",
]

import os
from pathlib import Path
from typing import Any

from impostor_jax.io.json_file import read_json_object
from impostor_jax.plain_arguments import one_of, whole_number

MANIFEST = "manifest.json"
SPLIT = "train"
CHECKSUMS = "checksums"
"""Folder of a file for each shard, as `sha256sum --check` reads them."""

MAX_IMAGES = 10**8
"""Most images of a dataset, each of which has a line in one file of an archive's."""

MAX_SHARDS = 10**6
"""Most shards, and images of one: their names have six digits."""


def read_manifest(folder: Path) -> dict[str, Any]:
    """The record that a dataset keeps of how it was made.

    Raises:
        ValueError: There is none, or it is broken.
    """
    what = f"manifest of dataset {str(folder)!r}"
    record = read_json_object(folder / MANIFEST, what)
    try:
        whole_number("count", record.get("count"), 1, MAX_IMAGES)
        whole_number("shard_size", record.get("shard_size"), 1, MAX_SHARDS)
        one_of("layout", record.get("layout"), ("bop", "webdataset"))
    except ValueError as error:
        raise ValueError(f"{what} is broken: {error}") from error
    return record


def shard_name(layout: str, shard: int) -> str:
    """Name of a shard's archive or folder."""
    return f"shard-{shard:06d}.tar" if layout == "webdataset" else f"{shard:06d}"


def shards_there(
    home: Path, manifest: dict[str, Any], *, allow_partial: bool
) -> list[tuple[Path, int]]:
    """Folders or archives of a dataset, each with how many images it has.

    Args:
        home: Folder of the dataset.
        manifest: As of `read_manifest`.
        allow_partial: Whether shards that are not there yet are left out.

    Raises:
        ValueError: One is not there.
    """
    count, size = manifest["count"], manifest["shard_size"]
    split = home / SPLIT
    # A name that begins with a point is of a shard that is not whole.
    there = set(os.listdir(split)) if split.is_dir() else set()
    shards = []
    for shard in range(-(-count // size)):
        name = shard_name(manifest["layout"], shard)
        if name in there:
            shards.append((split / name, min(size, count - shard * size)))
        elif not allow_partial:
            raise ValueError(
                f"dataset {str(home)!r} must have {count} images, but "
                f"{str(split / name)!r} is missing; impostor-synth resume makes it"
            )
    return shards
