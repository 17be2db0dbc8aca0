"""Reading synthetic depth datasets: BOP folders, and BOP-webdataset archives.

A dataset is a folder with `manifest.json`, and in `train/` either a folder for each
scene (`000000/depth/000000.png`, `mask_visib/`, `scene_gt.json` and so on) or an
archive for each (`shard-000000.tar`). Beside the labels of that format, whose poses are
those of meshes, stand exact cylinders, in meters in the camera's frame, and the camera
with its lens: `scene_cylinders.json`, or `KEY.cylinders.json` in an archive. An image
may show no cylinder.

References:
    Hodan et al., BOP: Benchmark for 6D Object Pose Estimation, ECCV 2018; formats as in
    the documentation of bop_toolkit.
"""

__all__ = ["MANIFEST", "Dataset", "read_dataset", "read_manifest", "sensor_of"]

import bisect
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, overload

from typing_extensions import override

from impostor_jax.io.dataset_manifest import MANIFEST, read_manifest, shards_there
from impostor_jax.io.dataset_shard import LabeledImage, ShardArchive, ShardFolder
from impostor_jax.io.sensor_record import sensor_from_record
from impostor_jax.sensor.base import AbstractDepthNoise


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
    shards = shards_there(home, manifest, allow_partial=allow_partial)
    parts = [_Part(path, num_images) for path, num_images in shards]
    return Dataset(parts)


class _Part(NamedTuple):
    """A scene's folder or archive, and how many images it has; None if any number."""

    path: Path
    num_images: int | None

    def opened(self) -> "ShardFolder | ShardArchive":
        """Its labels, or its table of contents.

        Raises:
            ValueError: It is broken, or has another number of images.
        """
        shard = (ShardFolder if self.path.is_dir() else ShardArchive)(self.path)
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
        self._counts = [
            len(part.opened()) if part.num_images is None else part.num_images
            for part in parts
        ]
        self._ends = list(itertools.accumulate(self._counts))
        self._last: tuple[int, ShardFolder | ShardArchive] | None = None

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

    def keys(self) -> Iterator[str]:
        """Number of the scene and of the image in it, of each image, unread."""
        for part, count in zip(self._parts, self._counts, strict=True):
            scene = part.path.stem.removeprefix("shard-")
            yield from (f"{scene}_{number:06d}" for number in range(count))

    @override
    def __iter__(self) -> Iterator[LabeledImage]:
        for part in self._parts:
            shard = part.opened()
            for number in range(len(shard)):
                yield shard.image(number)
