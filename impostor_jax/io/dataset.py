"""Reading synthetic depth datasets: BOP folders, and BOP-webdataset archives.

A dataset is a folder with `manifest.json`, and in `train/` either a folder for each
scene (`000000/depth/000000.png`, `mask_visib/`, `scene_gt.json` and so on) or an
archive for each (`shard-000000.tar`). Beside the labels of that format, whose poses are
those of meshes, stand exact cylinders, in meters in the camera's frame, and the camera
with its lens: `scene_cylinders.json`, or `KEY.cylinders.json` in an archive.

References:
    Hodan et al., BOP: Benchmark for 6D Object Pose Estimation, ECCV 2018; formats as in
    the documentation of bop_toolkit.
"""

__all__ = [
    "CHECKSUMS",
    "MANIFEST",
    "SPLIT",
    "LabeledImage",
    "mask_of_rle",
    "read_dataset",
    "read_manifest",
    "rle_of_mask",
    "sensor_of",
]

import functools
import json
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.io.camera_file import camera_from_record, read_json_object
from impostor_jax.io.depth_image import read_depth, read_mask
from impostor_jax.io.sensor_record import sensor_from_record
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.sensor.base import AbstractDepthNoise

MANIFEST = "manifest.json"
SPLIT = "train"
CHECKSUMS = "checksums"
"""Folder of a file for each shard, as `sha256sum --check` reads them."""


class LabeledImage(NamedTuple):
    """One image of a dataset, and what it shows.

    Attributes:
        depth: Readings in meters; 0 where there is none.
        mask: Pixels of each of n cylinders that nothing hides.
        camera: The camera, whose frame is the cylinders'.
        cylinders: A batch (n,).
        visible_fraction: Of each cylinder's silhouette in an image with a margin of its
            own size on every side, the part that is seen.
        key: Number of the scene and of the image in it, as `000000_000012`.
    """

    depth: Float[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "n h w"]
    camera: PinholeCamera
    cylinders: Cylinder
    visible_fraction: Float[np.ndarray, " n"]
    key: str


def read_manifest(folder: Path) -> dict[str, Any]:
    """The record that a dataset keeps of how it was made.

    Raises:
        ValueError: There is none, or it is broken.
    """
    return read_json_object(folder / MANIFEST, f"manifest of dataset {str(folder)!r}")


def sensor_of(manifest: dict[str, Any]) -> AbstractDepthNoise:
    """The noise model that made a dataset's readings.

    Raises:
        ValueError: The manifest has none.
    """
    record = manifest.get("preset", {}).get("sensor")
    return sensor_from_record(record, "sensor of the manifest")


def read_dataset(path: str | Path) -> Iterator[LabeledImage]:
    """Iterate over the images of a dataset, in the order of their keys.

    Args:
        path: Folder of a dataset, or one of its archives.

    Raises:
        ValueError: There is no dataset, or a file of it is missing or broken.
    """
    home = Path(path)
    if home.is_file():
        return _read_archive(home)
    read_manifest(home)
    return _read_all(home / SPLIT)


def _read_all(split: Path) -> Iterator[LabeledImage]:
    # Names that begin with a point are of shards that are not whole.
    for shard in sorted(split.glob("[!.]*")):
        if shard.is_dir():
            yield from _read_scene(shard)
        elif shard.suffix == ".tar":
            yield from _read_archive(shard)


def _read_scene(folder: Path) -> Iterator[LabeledImage]:
    names = "scene_camera", "scene_gt_info", "scene_cylinders"
    camera, info, cylinders = (
        read_json_object(folder / f"{name}.json", f"{name} of scene {str(folder)!r}")
        for name in names
    )
    for number, label in cylinders.items():
        name = f"{int(number):06d}"
        scale_m = 1e-3 * camera[number]["depth_scale"]
        masks = [
            read_mask(folder / "mask_visib" / f"{name}_{k:06d}.png")
            for k in range(len(label["cylinders"]))
        ]
        yield _labeled(
            read_depth(folder / "depth" / f"{name}.png", scale_m),
            masks,
            label,
            info[number],
            f"{folder.name}_{name}",
        )


def _read_archive(path: Path) -> Iterator[LabeledImage]:
    try:
        with tarfile.open(path) as archive:
            parts: dict[str, bytes] = {}
            last = None
            for member in archive:
                key, _, part = member.name.partition(".")
                if last is not None and key != last:
                    yield _unpacked(last, parts)
                    parts = {}
                file = archive.extractfile(member)
                assert file is not None
                parts[part], last = file.read(), key
            if last is not None:
                yield _unpacked(last, parts)
    except (tarfile.TarError, KeyError) as error:
        raise ValueError(
            f"dataset archive {str(path)!r} is broken: {error!r}"
        ) from error


def _unpacked(key: str, parts: dict[str, bytes]) -> LabeledImage:
    """An image of the files of an archive that have one key."""
    names = ("camera", "gt_info", "cylinders", "mask_visib")
    camera, info, label, masks = (json.loads(parts[f"{name}.json"]) for name in names)
    buffer = np.frombuffer(parts["depth.png"], np.uint8)
    units = cv2.imdecode(buffer, cv2.IMREAD_UNCHANGED)
    if units is None:
        raise ValueError(f"depth image of {key} is not a readable image")
    decoded = [mask_of_rle(masks[str(k)]) for k in range(len(label["cylinders"]))]
    depth = units * (1e-3 * camera["depth_scale"])
    return _labeled(depth, decoded, label, info, key)


def _labeled(
    depth: Float[np.ndarray, "h w"],
    masks: list[Bool[np.ndarray, "h w"]],
    label: dict[str, Any],
    info: list[dict[str, Any]],
    key: str,
) -> LabeledImage:
    parts = {
        name: np.array([one[name] for one in label["cylinders"]], np.float32)
        for name in ("center_m", "axis", "radius_m", "height_m")
    }
    cylinders = Cylinder(
        parts["center_m"], parts["axis"], parts["radius_m"], parts["height_m"]
    )
    visible = np.array([one["visib_fract"] for one in info])
    camera = _camera(json.dumps(label["camera"]))
    return LabeledImage(depth, np.stack(masks), camera, cylinders, visible, key)


@functools.lru_cache(maxsize=16)
def _camera(text: str) -> PinholeCamera:
    """A dataset has few cameras, and those with a lens take long to make."""
    return camera_from_record(json.loads(text), "camera of the dataset").camera


def rle_of_mask(mask: Bool[np.ndarray, "h w"]) -> dict[str, Any]:
    """Run lengths of a mask, column by column, as COCO's uncompressed form has them."""
    flat = np.concatenate([[False], mask.ravel(order="F"), [False]])
    change = np.flatnonzero(flat[1:] != flat[:-1])
    ends = np.concatenate([[0], change, [mask.size]])
    counts = np.diff(ends).tolist()
    # The last run is of zeros, and may be empty.
    return {
        "size": list(mask.shape),
        "counts": counts[:-1] if not counts[-1] else counts,
    }


def mask_of_rle(record: dict[str, Any]) -> Bool[np.ndarray, "h w"]:
    """The mask of run lengths."""
    counts = np.asarray(record["counts"])
    values = np.arange(len(counts)) % 2 == 1
    return np.repeat(values, counts).reshape(record["size"], order="F")
