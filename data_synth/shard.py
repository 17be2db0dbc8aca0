"""Making a shard: the unit of work, which is seen only when it is whole."""

__all__ = ["ShardReport", "make_shard"]

import collections
import dataclasses
import functools
import hashlib
import io
import json
import os
import shutil
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from data_synth.checksums import digest_of, listing
from data_synth.images import Clock, Image, Plan, images
from data_synth.label import (
    camera_label,
    cylinders_label,
    pose_labels,
    visibility_labels,
)
from data_synth.manifest import Manifest
from impostor_jax.io.atomic import write_text
from impostor_jax.io.color_image import srgb_levels
from impostor_jax.io.dataset_manifest import MANIFEST
from impostor_jax.io.depth_image import normal_colors, png_bytes
from impostor_jax.io.run_lengths import rle_of_mask

LABELS = {
    "camera": "scene_camera",
    "gt": "scene_gt",
    "gt_info": "scene_gt_info",
    "cylinders": "scene_cylinders",
    "appearance": "scene_appearance",
}
"""Name of a label in an archive, and of the file of a scene's."""


@dataclasses.dataclass(frozen=True)
class ShardReport:
    """What making a shard took.

    Attributes:
        shard: Its number.
        num_images: Number of its images.
        rejected: How many scenes each rule rejected.
        seconds: Time for each stage.
    """

    shard: int
    num_images: int
    rejected: dict[str, int]
    seconds: dict[str, float]


def make_shard(folder: str, shard: int) -> ShardReport:
    """Make one shard of the dataset of a folder, as its manifest says.

    It is written under a temporary name, renamed when it is whole, and then gets its
    checksums. Any process may make it.

    Args:
        folder: Of the dataset; it has a manifest.
        shard: Number of the shard.

    Raises:
        ValueError: The manifest is broken, or its rules reject all scenes.
        OSError: The disk is full; nothing of the shard is left.
    """
    home = Path(folder)
    plan = _plan(folder, (home / MANIFEST).read_text())
    manifest, clock = plan.manifest, Clock()
    numbers = manifest.images_of(shard)
    path = manifest.shard_path(home, shard)
    path.parent.mkdir(parents=True, exist_ok=True)
    rejected: collections.Counter[str] = collections.Counter()

    def made() -> Iterator[Image]:
        for image in images(plan, numbers, clock):
            rejected.update(image.rejected)
            yield image

    write = _write_scene if manifest.layout == "bop" else _write_archive
    prefix = f".{path.name}."
    with tempfile.TemporaryDirectory(prefix=prefix, dir=path.parent) as partial:
        whole = Path(partial) / path.name
        sums = write(whole, manifest, made(), clock)
        if path.is_dir():
            # Left by a process that ended before it wrote the checksums.
            shutil.rmtree(path)
        os.replace(whole, path)
    root = path.parent.relative_to(home)
    text = listing({str(root / name): digest for name, digest in sums.items()})
    write_text(home / manifest.checksums_name(shard), text)
    return ShardReport(shard, len(numbers), dict(rejected), clock.seconds)


@functools.lru_cache(maxsize=4)
def _plan(folder: str, text: str) -> Plan:
    """The plan of a dataset; `text` is its manifest's, by which it is known."""
    return Plan.of(Manifest.read(Path(folder)))


def _pictures(image: Image, manifest: Manifest) -> dict[str, bytes]:
    """Files of the pictures, by their names in an archive or their folders."""
    pictures = {"depth": image.reading}
    if manifest.clean:
        pictures["depth_clean"] = image.clean
    if image.normal is not None:
        pictures["normal"] = normal_colors(image.normal)
    if image.color is not None:
        pictures["rgb"] = srgb_levels(image.color)
    return {name: png_bytes(values) for name, values in pictures.items()}


def _masks(image: Image) -> dict[str, Bool[np.ndarray, "n h w"]]:
    """Masks of the cylinders, by the names of their files or folders."""
    return {"mask": image.silhouettes, "mask_visib": image.visible}


def _labels(image: Image, manifest: Manifest) -> dict[str, Any]:
    """Records of one image, by their names in an archive."""
    with_scenery = bool(manifest.preset.scenery)
    cylinders = cylinders_label(image.scene, image.camera, with_scenery)
    labels = {
        "camera": camera_label(
            image.camera, manifest.preset.depth_scale_mm, image.camera_from_world
        ),
        "gt": pose_labels(image.scene),
        "gt_info": visibility_labels(
            image.silhouettes,
            image.visible,
            image.whole_counts,
            image.boxes,
            image.reading,
        ),
        "cylinders": {**cylinders, "image": image.number, "rejected": image.rejected},
    }
    if image.seconds is not None:
        labels["cylinders"]["time_s"] = image.seconds
        for k, cylinder in enumerate(cylinders["cylinders"]):
            cylinder["identity"] = k + 1
    if image.scene.look is not None:
        labels["appearance"] = dataclasses.asdict(image.scene.look)
    return labels


def _write_scene(
    path: Path, manifest: Manifest, made: Iterator[Image], clock: Clock
) -> dict[str, str]:
    """Write a scene's folder; returns the checksum of each file."""
    records: collections.defaultdict[str, dict[str, Any]]
    records = collections.defaultdict(dict)
    sums: dict[str, str] = {}

    def write(name: str, data: bytes) -> None:
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)
        sums[f"{path.name}/{name}"] = hashlib.sha256(data).hexdigest()

    for number, image in enumerate(made):
        with clock.stage("coding"):
            files = {
                f"{folder}/{number:06d}.png": data
                for folder, data in _pictures(image, manifest).items()
            }
            for folder, masks in _masks(image).items():
                for k, mask in enumerate(masks):
                    white = mask.view(np.uint8) * np.uint8(255)
                    files[f"{folder}/{number:06d}_{k:06d}.png"] = png_bytes(white)
        with clock.stage("writing"):
            for name, data in files.items():
                write(name, data)
            for name, label in _labels(image, manifest).items():
                records[name][str(number)] = label
    with clock.stage("writing"):
        for name, record in records.items():
            write(f"{LABELS[name]}.json", _json_bytes(record))
    return sums


def _write_archive(
    path: Path, manifest: Manifest, made: Iterator[Image], clock: Clock
) -> dict[str, str]:
    """Write a scene's archive; returns its checksum."""
    scene = int(path.stem.rpartition("-")[2])
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as archive:
        for number, image in enumerate(made):
            with clock.stage("coding"):
                parts = {
                    f"{name}.png": data
                    for name, data in _pictures(image, manifest).items()
                }
                records = _labels(image, manifest)
                for name, masks in _masks(image).items():
                    runs = {str(k): rle_of_mask(mask) for k, mask in enumerate(masks)}
                    records[name] = runs
            with clock.stage("writing"):
                for name, record in records.items():
                    parts[f"{name}.json"] = _json_bytes(record)
                for name, data in sorted(parts.items()):
                    info = tarfile.TarInfo(f"{scene:06d}_{number:06d}.{name}")
                    info.size = len(data)
                    archive.addfile(info, io.BytesIO(data))
    return {path.name: digest_of(path)}


def _json_bytes(record: Any) -> bytes:
    return json.dumps(record, allow_nan=False).encode()
