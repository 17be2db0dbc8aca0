"""Images and clouds that are read where the work on them is done.

Each is a few words that tell where it lies, which any process can be sent.
"""

__all__ = [
    "AbstractItem",
    "Camera",
    "CloudFile",
    "DatasetImage",
    "FolderFrame",
    "ImageFile",
    "OutlineFile",
    "Shown",
    "Views",
]

import abc
import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Integer
from typing_extensions import override

from impostor_jax.camera.base import posed
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.request import check_one_object
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.io.camera_file import CameraFile, camera_record, read_camera
from impostor_jax.io.dataset import MANIFEST, read_dataset
from impostor_jax.io.depth_folder import DepthFolder
from impostor_jax.io.depth_image import read_depth
from impostor_jax.io.depth_layouts import Shot
from impostor_jax.io.image_file import Size, read_integers
from impostor_jax.io.input_file import sha256_of
from impostor_jax.io.points_file import read_points
from impostor_jax.io.shape_record import pose_rows

Camera = Path | CameraFile
"""A camera file, or what is in one."""

LABELS, MASK = "labels", "mask"
"""What an image beside the depth holds."""


class Shown(NamedTuple):
    """What an item holds.

    Attributes:
        depth: (H, W), in meters; of several views a list. None of a cloud and of an
            outline.
        camera: That took it; likewise. None of a cloud.
        labels: (H, W), number of the object that each pixel shows, 0 of none; or, of a
            single object without a number, the mask of it; of several views a list.
            None where nothing is told.
        points: Of a cloud, in meters.
        origin: Where the sensor stood, of a cloud whose file says it.
    """

    depth: Any
    camera: Any
    labels: Any = None
    points: Float[np.ndarray, "n 3"] | None = None
    origin: Any = None


@dataclasses.dataclass(frozen=True)
class AbstractItem(abc.ABC):
    """Something that a task is done on.

    Attributes:
        name: Tells it from all others of a run, with slashes between folders.
    """

    name: str

    @abc.abstractmethod
    def read(self) -> Shown:
        """What it holds.

        Raises:
            ValueError: A file is missing, broken or of another kind or size.
        """

    @abc.abstractmethod
    def fingerprint(self) -> Any:
        """What is another where the item is, as JSON can hold it.

        Raises:
            OSError: A file is missing.
        """


@dataclasses.dataclass(frozen=True)
class ImageFile(AbstractItem):
    """A depth image in a file of its own.

    Attributes:
        path: Of the image.
        camera: That took it.
        beside: Image of its mask or its labels.
        meaning: Which of both that is.
    """

    path: Path
    camera: Camera
    beside: Path | None = None
    meaning: str = MASK

    @override
    def read(self) -> Shown:
        camera, depth_scale_m = _read_camera(self.camera)
        size = camera.height, camera.width
        depth = read_depth(self.path, depth_scale_m, size)
        labels = None
        if self.beside is not None:
            labels = _read_beside(self.beside, size, self.meaning)
        return Shown(depth, camera, labels)

    @override
    def fingerprint(self) -> Any:
        beside = None if self.beside is None else sha256_of(self.beside)
        return [sha256_of(self.path), _camera_told(self.camera), beside]


@dataclasses.dataclass(frozen=True)
class FolderFrame(AbstractItem):
    """A frame of an RGB-D dataset, which has cameras, poses and masks of its own.

    Attributes:
        shot: What the dataset's folder says of it.
        camera: That took it, where the folder does not say.
    """

    shot: Shot
    camera: PinholeCamera | None

    @override
    def read(self) -> Shown:
        frame = DepthFolder([self.shot], self.camera)[0]
        return Shown(frame.depth, frame.camera, _labels_of(frame.masks))

    @override
    def fingerprint(self) -> Any:
        _, path, unit_m, intrinsics, pose, masks, _ = self.shot
        files = [sha256_of(one) for one in (path, *masks)]
        moved = None if pose is None else pose.tolist()
        camera = (
            None if self.camera is None else _told_of(CameraFile(self.camera, None))
        )
        return [files, unit_m, intrinsics, moved, camera]


@dataclasses.dataclass(frozen=True)
class DatasetImage(AbstractItem):
    """An image of a dataset that this project made.

    Attributes:
        dataset: Its folder, or an archive of it.
        index: Of the image.
    """

    dataset: Path
    index: int

    @override
    def read(self) -> Shown:
        image = _dataset_at(self.dataset)[self.index]
        return Shown(image.depth, image.camera, _labels_of(image.mask))

    @override
    def fingerprint(self) -> Any:
        # Scenes are written once: what a dataset is made of is in its manifest.
        path = self.dataset
        return [sha256_of(path if path.is_file() else path / MANIFEST)]


@dataclasses.dataclass(frozen=True)
class OutlineFile(AbstractItem):
    """The mask, or the labels, of objects of which there are no readings.

    Attributes:
        path: Of the image.
        camera: That saw them.
    """

    path: Path
    camera: Camera

    @override
    def read(self) -> Shown:
        camera, _ = _read_camera(self.camera)
        size = camera.height, camera.width
        numbers = read_integers(self.path, f"mask {str(self.path)!r}", size)
        is_single = len(np.unique(numbers[numbers != 0])) < 2
        return Shown(None, camera, numbers != 0 if is_single else numbers)

    @override
    def fingerprint(self) -> Any:
        return [sha256_of(self.path), _camera_told(self.camera)]


@dataclasses.dataclass(frozen=True)
class Views(AbstractItem):
    """Several images of one object.

    Attributes:
        images: Each with the mask of the object, or none of them.
        poses: (4, 4) of each, from the world to the camera.
    """

    images: tuple[ImageFile, ...]
    poses: tuple[Any, ...]

    @override
    def read(self) -> Shown:
        views = [image.read() for image in self.images]
        cameras = [
            posed(view.camera, RigidTransform.from_matrix(pose))
            for view, pose in zip(views, self.poses, strict=True)
        ]
        masks = [view.labels for view in views]
        is_masked = any(mask is not None for mask in masks)
        return Shown([v.depth for v in views], cameras, masks if is_masked else None)

    @override
    def fingerprint(self) -> Any:
        poses = [np.asarray(pose, float).tolist() for pose in self.poses]
        return [[image.fingerprint() for image in self.images], poses]


@dataclasses.dataclass(frozen=True)
class CloudFile(AbstractItem):
    """A cloud of points.

    Attributes:
        path: Of its file.
    """

    path: Path

    @override
    def read(self) -> Shown:
        cloud = read_points(self.path)
        return Shown(None, None, None, cloud.points, cloud.origin)

    @override
    def fingerprint(self) -> Any:
        return [sha256_of(self.path)]


def _labels_of(masks: Bool[np.ndarray, "n h w"]) -> Integer[np.ndarray, "h w"] | None:
    """Numbers of the objects that pixels show, the first 1; None of no objects."""
    if not len(masks):
        return None
    numbers = np.arange(1, len(masks) + 1).reshape(-1, 1, 1)
    return np.max(np.where(masks, numbers, 0), axis=0)


def _read_beside(
    path: Path, size: Size, meaning: str
) -> Integer[np.ndarray, "h w"] | Bool[np.ndarray, "h w"]:
    """Numbers of the objects that pixels show; or, of a mask, where its one is."""
    if meaning == LABELS:
        return read_integers(path, f"label image {str(path)!r}", size)
    what = f"mask {str(path)!r}"
    values = read_integers(path, what, size)
    check_one_object(values, what, "--labels fits each")
    return values != 0


def _camera_told(camera: Camera) -> Any:
    """What a camera is, as JSON can hold it."""
    if isinstance(camera, Path):
        return _of_file(sha256_of, camera, camera.stat().st_mtime_ns)
    return _told_of(camera)


def _told_of(camera: CameraFile) -> Any:
    pose = camera.camera.camera_from_world
    moved = None if pose is None else pose_rows(pose)
    return [camera_record(*camera), moved]


def _read_camera(camera: Camera) -> CameraFile:
    if isinstance(camera, CameraFile):
        return camera
    changed = camera.stat().st_mtime_ns if camera.exists() else 0
    return _of_file(read_camera, camera, changed)


@functools.lru_cache(maxsize=2000)
def _of_file(function: Callable[[Path], Any], path: Path, changed: int) -> Any:
    """What is made of a file that many images share, as it was last changed."""
    del changed
    return function(path)


_dataset_at = functools.lru_cache(maxsize=8)(read_dataset)
