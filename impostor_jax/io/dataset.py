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
    "MAX_IMAGES",
    "MAX_SHARDS",
    "SPLIT",
    "Dataset",
    "LabeledImage",
    "mask_of_rle",
    "read_dataset",
    "read_manifest",
    "rle_of_mask",
    "sensor_of",
]

import bisect
import contextlib
import functools
import itertools
import json
import os
import tarfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, overload

import numpy as np
from jaxtyping import Bool, Float
from typing_extensions import override

from impostor_jax.arguments import one_of, real_number, whole_number
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.io.camera_file import camera_from_record
from impostor_jax.io.depth_image import depth_of_png, read_depth, read_mask
from impostor_jax.io.input_file import require_file
from impostor_jax.io.json_file import json_value, read_json_object
from impostor_jax.io.sensor_record import sensor_from_record
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.sensor.base import AbstractDepthNoise

MANIFEST = "manifest.json"
SPLIT = "train"
CHECKSUMS = "checksums"
"""Folder of a file for each shard, as `sha256sum --check` reads them."""


MAX_IMAGES = 10**8
"""Most images of a dataset, each of which has a line in one file of an archive's."""

MAX_SHARDS = 10**6
"""Most shards, and images of one: their names have six digits."""


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
    what = f"manifest of dataset {str(folder)!r}"
    record = read_json_object(folder / MANIFEST, what)
    try:
        whole_number("count", record.get("count"), 1, MAX_IMAGES)
        whole_number("shard_size", record.get("shard_size"), 1, MAX_SHARDS)
        one_of("layout", record.get("layout"), ("bop", "webdataset"))
    except ValueError as error:
        raise ValueError(f"{what} is broken: {error}") from error
    return record


def sensor_of(manifest: dict[str, Any]) -> AbstractDepthNoise:
    """The noise model that made a dataset's readings.

    Raises:
        ValueError: The manifest has none.
    """
    record = manifest.get("preset", {}).get("sensor")
    return sensor_from_record(record, "sensor of the manifest")


def read_dataset(path: str | Path, *, allow_partial: bool = False) -> "Dataset":
    """Read the images of a dataset, in the order of their keys.

    Args:
        path: Folder of a dataset, or one of its archives.
        allow_partial: Whether shards that are not there yet are left out. Else a
            dataset that lacks one is refused.

    Returns:
        A sequence of images, which are read when they are asked for: `len()`, an
        index, and as many iterations as one likes.

    Raises:
        ValueError: There is no dataset, or a part of it is missing. A file that is
            missing or broken raises it when its image is read.
    """
    home = Path(path)
    if home.is_file():
        return Dataset([_Part(home, None)])
    manifest = read_manifest(home)
    count, size = manifest["count"], manifest["shard_size"]
    is_archive = manifest["layout"] == "webdataset"
    split = home / SPLIT
    # A name that begins with a point is of a shard that is not whole.
    there = set(os.listdir(split)) if split.is_dir() else set()
    parts = []
    for shard in range(-(-count // size)):
        name = f"shard-{shard:06d}.tar" if is_archive else f"{shard:06d}"
        if name in there:
            parts.append(_Part(split / name, min(size, count - shard * size)))
        elif not allow_partial:
            raise ValueError(
                f"dataset {str(home)!r} must have {count} images, but "
                f"{str(split / name)!r} is missing; impostor-synth resume makes it"
            )
    return Dataset(parts)


class _Part(NamedTuple):
    """A scene's folder or archive, and how many images it has; None if any number."""

    path: Path
    num_images: int | None

    def opened(self) -> "_Scene | _Archive":
        """Its labels, or its table of contents.

        Raises:
            ValueError: It is broken, or has another number of images.
        """
        shard = (_Scene if self.path.is_dir() else _Archive)(self.path)
        if self.num_images not in (None, len(shard)):
            raise ValueError(
                f"{str(self.path)!r} must have {self.num_images} images, got "
                f"{len(shard)}"
            )
        return shard


class Dataset(Sequence[LabeledImage]):
    """The images of a dataset, each of which is read when it is asked for.

    Args:
        parts: Its scenes.
    """

    def __init__(self, parts: Sequence[_Part]):
        self._parts = tuple(parts)
        # Opened to count where nothing says how many there are.
        counts = (
            len(part.opened()) if part.num_images is None else part.num_images
            for part in parts
        )
        self._ends = list(itertools.accumulate(counts))
        self._last: tuple[int, _Scene | _Archive] | None = None

    @override
    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    @overload
    def __getitem__(self, index: int) -> LabeledImage: ...

    @overload
    def __getitem__(self, index: slice) -> list[LabeledImage]: ...

    @override
    def __getitem__(self, index: int | slice) -> LabeledImage | list[LabeledImage]:
        if isinstance(index, slice):
            return [self[k] for k in range(len(self))[index]]
        try:
            number = range(len(self))[index]
        except IndexError:
            raise IndexError(
                f"index must be below {len(self)}, the number of images, got {index}"
            ) from None
        part = bisect.bisect_right(self._ends, number)
        # Images are mostly read one after the other.
        if self._last is None or self._last[0] != part:
            self._last = part, self._parts[part].opened()
        first = self._ends[part - 1] if part else 0
        return self._last[1].image(number - first)

    @override
    def __iter__(self) -> Iterator[LabeledImage]:
        for part in self._parts:
            shard = part.opened()
            for number in range(len(shard)):
                yield shard.image(number)


class _Scene:
    """A scene's folder, with its labels."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._labels = {
            name: read_json_object(folder / f"{name}.json", self._what(name))
            for name in ("scene_camera", "scene_gt_info", "scene_cylinders")
        }
        for number in range(len(self)):
            for name, labels in self._labels.items():
                _entry(labels, str(number), self._what(name))

    def __len__(self) -> int:
        return max(len(labels) for labels in self._labels.values())

    def _what(self, name: str) -> str:
        return f"{name} of scene {str(self._folder)!r}"

    def image(self, number: int) -> LabeledImage:
        """One of its images."""
        name, folder = f"{number:06d}", self._folder
        camera, info, cylinders = (
            labels[str(number)] for labels in self._labels.values()
        )
        with _named(f"labels of image {number} of scene {str(folder)!r}"):
            label = _Label.of(camera, info, cylinders)
        size = (label.camera.height, label.camera.width)
        depth = read_depth(folder / "depth" / f"{name}.png", label.scale_m, size)
        masks = [
            read_mask(folder / "mask_visib" / f"{name}_{k:06d}.png", size)
            for k in range(label.num_cylinders)
        ]
        return label.image(depth, masks, f"{folder.name}_{name}")


class _Archive:
    """An archive of a scene, with its table of contents."""

    def __init__(self, path: Path):
        self._path = path
        self._what = f"dataset archive {str(path)!r}"
        require_file(path, self._what)
        self._images: dict[str, dict[str, tuple[int, int]]] = {}
        try:
            with tarfile.open(path, "r:") as archive:
                for member in archive:
                    key, _, part = member.name.partition(".")
                    place = member.offset_data, member.size
                    if sum(place) > path.stat().st_size:
                        raise ValueError(f"{member.name} is cut off")
                    self._images.setdefault(key, {})[part] = place
        except (tarfile.TarError, OSError, ValueError) as error:
            raise ValueError(f"{self._what} is broken: {error!r}") from error
        self._keys = list(self._images)

    def __len__(self) -> int:
        return len(self._keys)

    def image(self, number: int) -> LabeledImage:
        """One of its images."""
        key = self._keys[number]
        what = f"{self._what} at {key}"
        camera, info, cylinders, masks = (
            json_value(self._read(key, f"{name}.json"), f"{name} of {what}")
            for name in ("camera", "gt_info", "cylinders", "mask_visib")
        )
        with _named(f"labels of {what}"):
            label = _Label.of(camera, info, cylinders)
            size = (label.camera.height, label.camera.width)
            runs = [
                _entry(masks, str(k), "mask_visib") for k in range(label.num_cylinders)
            ]
            decoded = [mask_of_rle(run, size) for run in runs]
        depth = depth_of_png(
            self._read(key, "depth.png"), label.scale_m, f"depth image of {what}", size
        )
        return label.image(depth, decoded, key)

    def _read(self, key: str, part: str) -> bytes:
        try:
            start, size = self._images[key][part]
        except KeyError:
            raise ValueError(f"{self._what} is broken: it lacks {key}.{part}") from None
        with self._path.open("rb") as file:
            file.seek(start)
            data = file.read(size)
        if len(data) != size:
            raise ValueError(f"{self._what} is broken: {key}.{part} is cut off")
        return data


@contextlib.contextmanager
def _named(what: str) -> Iterator[None]:
    """Turn what a label that is not as it should be raises into a `ValueError`."""
    try:
        yield
    except KeyError as error:
        raise ValueError(f"{what} lack {error}") from error
    except (AttributeError, TypeError, ValueError, IndexError) as error:
        raise ValueError(f"{what} are broken: {error}") from error


def _entry(labels: Any, key: str, what: str) -> Any:
    """What labels have under a key."""
    if not isinstance(labels, dict) or key not in labels:
        raise ValueError(f"{what} lacks {key!r}")
    return labels[key]


class _Label(NamedTuple):
    """Labels of one image, as they are used."""

    camera: PinholeCamera
    cylinders: Cylinder
    visible_fraction: Float[np.ndarray, " n"]
    scale_m: float
    num_cylinders: int

    @staticmethod
    def of(camera: Any, info: Any, cylinders: Any) -> "_Label":
        """The labels of records; what is wrong with them raises something."""
        parts = {
            name: np.array([one[name] for one in cylinders["cylinders"]], np.float32)
            for name in ("center_m", "axis", "radius_m", "height_m")
        }
        count = len(cylinders["cylinders"])
        if len(info) != count:
            raise ValueError(f"gt_info must have {count} cylinders, got {len(info)}")
        shapes = Cylinder(
            parts["center_m"], parts["axis"], parts["radius_m"], parts["height_m"]
        )
        scale = real_number("depth_scale", camera["depth_scale"], positive=True)
        return _Label(
            camera=_camera(json.dumps(cylinders["camera"])),
            cylinders=shapes,
            visible_fraction=np.array([float(one["visib_fract"]) for one in info]),
            scale_m=1e-3 * scale,
            num_cylinders=count,
        )

    def image(
        self,
        depth: Float[np.ndarray, "h w"],
        masks: list[Bool[np.ndarray, "h w"]],
        key: str,
    ) -> LabeledImage:
        """The image with these labels."""
        return LabeledImage(
            depth,
            np.array(masks, bool).reshape(self.num_cylinders, *depth.shape),
            self.camera,
            self.cylinders,
            self.visible_fraction,
            key,
        )


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


def mask_of_rle(
    record: dict[str, Any], size: tuple[int, int]
) -> Bool[np.ndarray, "h w"]:
    """The mask of run lengths.

    Args:
        record: As `rle_of_mask` makes it.
        size: Rows and columns that it must have.

    Raises:
        ValueError: It has another size, or its runs do not fill it.
    """
    if list(record["size"]) != list(size):
        raise ValueError(f"size of a mask must be {list(size)}, got {record['size']}")
    counts = np.asarray(record["counts"])
    is_whole = counts.ndim == 1 and np.issubdtype(counts.dtype, np.integer)
    count = size[0] * size[1]
    # Each is checked, since the sum of large ones may overflow.
    fits = is_whole and ((counts >= 0) & (counts <= count)).all()
    if not fits or counts.sum() != count:
        raise ValueError(f"counts of a mask must be runs of {count} pixels")
    values = np.arange(len(counts)) % 2 == 1
    return np.repeat(values, counts).reshape(size, order="F")
