"""A scene of a dataset, of which an image is read when it is asked for.

That is a folder with its labels, or an archive with its table of contents.
"""

__all__ = ["LabeledImage", "ShardArchive", "ShardFolder"]

import contextlib
import functools
import json
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from impostor_jax.arguments import real_number
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.io.camera_file import FiledCamera, camera_from_record, pinhole_of
from impostor_jax.io.color_image import read_picture
from impostor_jax.io.depth_image import depth_of_png, read_depth, read_mask
from impostor_jax.io.input_file import require_file
from impostor_jax.io.json_file import json_value, read_json_object
from impostor_jax.io.pose_file import bop_pose
from impostor_jax.io.run_lengths import mask_of_rle
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder

FIELDS = {"center_m": (3,), "axis": (3,), "radius_m": (), "height_m": ()}
"""Of a cylinder's label, with their shapes."""


class LabeledImage(NamedTuple):
    """One image of a dataset, and what it shows.

    Attributes:
        depth: Readings in meters; 0 where there is none.
        mask: Pixels of each of n shapes that nothing hides.
        camera: The camera, whose frame is the shapes'.
        shapes: A batch (n,) of one type; `cylinders` is a name of it.
        visible_fraction: Of each shape's silhouette in an image with a margin of its
            own size on every side, the part that is seen.
        key: Number of the scene and of the image in it, as `000000_000012`.
        color: Red, green and blue in sRGB; None if the dataset has no color.
        seconds: Since the first image of the video that it is of; None if it is of
            none, like the next two.
        camera_from_world: Pose of the camera in it, (4, 4), in meters.
        identity: Number of each shape, the same in all images of the video.
    """

    depth: Float[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "n h w"]
    camera: FiledCamera
    shapes: AbstractPrimitive
    visible_fraction: Float[np.ndarray, " n"]
    key: str
    color: UInt8[np.ndarray, "h w 3"] | None = None
    seconds: float | None = None
    camera_from_world: Float[np.ndarray, "4 4"] | None = None
    identity: Int[np.ndarray, " n"] | None = None

    @property
    def pinhole(self) -> PinholeCamera:
        """The camera, for what takes no other than a pinhole camera.

        Raises:
            ValueError: It is a `SphericalCamera`.
        """
        return pinhole_of(self.camera, f"image {self.key} of the dataset")

    @property
    def cylinders(self) -> Cylinder:
        """The shapes, of a dataset of cylinders."""
        assert isinstance(self.shapes, Cylinder)
        return self.shapes


class ShardFolder:
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
        records = (labels[str(number)] for labels in self._labels.values())
        with _named(f"labels of image {number} of scene {str(folder)!r}"):
            image, scale_m = _without_pixels(f"{folder.name}_{name}", *records)
        size = (image.camera.height, image.camera.width)
        depth = read_depth(folder / "depth" / f"{name}.png", scale_m, size)
        masks = [
            read_mask(folder / "mask_visib" / f"{name}_{k:06d}.png", size)
            for k in range(len(image.visible_fraction))
        ]
        path, color = folder / "rgb" / f"{name}.png", None
        if path.parent.is_dir():
            what = f"color image {str(path)!r}"
            require_file(path, what)
            color = read_picture(path.read_bytes(), what, size)
        return _with_pixels(image, depth, masks, color)


class ShardArchive:
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
        *records, runs = (
            json_value(self._read(key, f"{name}.json"), f"{name} of {what}")
            for name in ("camera", "gt_info", "cylinders", "mask_visib")
        )
        with _named(f"labels of {what}"):
            image, scale_m = _without_pixels(key, *records)
            size = (image.camera.height, image.camera.width)
            masks = [
                mask_of_rle(_entry(runs, str(k), "mask_visib"), size)
                for k in range(len(image.visible_fraction))
            ]
        depth = depth_of_png(
            self._read(key, "depth.png"), scale_m, f"depth image of {what}", size
        )
        color = None
        if "rgb.png" in self._images[key]:
            what = f"color image of {what}"
            color = read_picture(self._read(key, "rgb.png"), what, size)
        return _with_pixels(image, depth, masks, color)

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


def _without_pixels(
    key: str, camera: Any, info: Any, cylinders: Any
) -> tuple[LabeledImage, float]:
    """The image of records, but for its pixels, and meters a unit of its depth.

    What is wrong with them raises something.
    """
    listed = cylinders["cylinders"]
    count = len(listed)
    if len(info) != count:
        raise ValueError(f"gt_info must have {count} cylinders, got {len(info)}")
    center, axis, radius, height = (
        np.array([one[name] for one in listed], np.float32).reshape(count, *shape)
        for name, shape in FIELDS.items()
    )
    scale = real_number("depth_scale", camera["depth_scale"], positive=True)
    image = LabeledImage(
        depth=np.zeros((0, 0)),
        mask=np.zeros((count, 0, 0), bool),
        camera=_camera(json.dumps(cylinders["camera"])),
        shapes=Cylinder(center, axis, radius, height),
        visible_fraction=np.array([float(one["visib_fract"]) for one in info]),
        key=key,
    )
    seconds = cylinders.get("time_s")
    if seconds is not None:
        image = image._replace(
            seconds=float(seconds),
            camera_from_world=bop_pose(camera),
            identity=np.array([int(one["identity"]) for one in listed], int),
        )
    return image, 1e-3 * scale


def _with_pixels(
    image: LabeledImage,
    depth: Float[np.ndarray, "h w"],
    masks: list[Bool[np.ndarray, "h w"]],
    color: UInt8[np.ndarray, "h w 3"] | None,
) -> LabeledImage:
    mask = np.array(masks, bool).reshape(len(masks), *depth.shape)
    return image._replace(depth=depth, mask=mask, color=color)


@functools.lru_cache(maxsize=16)
def _camera(text: str) -> FiledCamera:
    """A dataset has few cameras, and those with a lens take long to make."""
    return camera_from_record(json.loads(text), "camera of the dataset").camera
