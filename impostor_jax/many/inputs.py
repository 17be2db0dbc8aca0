"""What files, folders and patterns stand for: items with names of their own."""

__all__ = ["items_of", "views_of"]

import collections
import dataclasses
import glob
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from impostor_jax.arguments import float_array
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.io.camera_file import CameraFile, read_camera
from impostor_jax.io.dataset import MANIFEST, read_dataset
from impostor_jax.io.depth_folder import read_depth_folder
from impostor_jax.io.depth_image import SUFFIXES as IMAGES
from impostor_jax.io.depth_layouts import kind_of
from impostor_jax.io.input_file import opened
from impostor_jax.io.json_file import json_value
from impostor_jax.io.point_cloud import SUFFIXES as CLOUDS
from impostor_jax.many.items import (
    MASK,
    AbstractItem,
    CloudFile,
    DatasetImage,
    FolderFrame,
    ImageFile,
    OutlineFile,
    Views,
)
from impostor_jax.plain_arguments import one_of

LIST = ".txt"
"""Ending of a list of images, a path a line."""


class _Source(NamedTuple):
    """Something that an item is read from.

    Attributes:
        path: Whose folders and name become the item's name.
        item: The rest of it, of an image of a dataset; None of a file.
    """

    path: Path
    item: AbstractItem | None = None


def items_of(
    given: str | Path | Sequence[str | Path],
    camera: str | Path | CameraFile | None = None,
    beside: Sequence[str | Path] = (),
    meaning: str = MASK,
    *,
    are_outlines: bool = False,
) -> list[AbstractItem]:
    """The images or clouds that are meant, in order.

    Args:
        given: Depth images; folders of them; lists of them in text files, a path a
            line, seen from the list's folder; folders and archives of datasets of this
            project, BOP, TUM RGB-D, ScanNet and Redwood; or patterns of all these.
            Without a camera clouds of points, too.
        camera: Camera file, or what `read_camera` read, of images in files of their
            own. Of many a pattern: in `{folder}/camera.json` and `cameras/{name}.json`
            stand the image's own folder and its name without the ending. None of
            clouds and of datasets, which have their cameras.
        beside: Masks or label images of the images: one each, a folder that has them
            under the images' names as PNG, or a pattern like that of cameras.
        meaning: "mask" or "labels".
        are_outlines: Whether the images are no depth but masks of what has no readings.

    Raises:
        ValueError: Something does not exist or stands for nothing, two items are one,
            or masks are more or fewer than images.
    """
    one_of("meaning", meaning, ("mask", "labels"))
    if isinstance(given, str | Path):
        given = [given]
    sources = [source for one in given for source in _sources(str(one), camera)]
    if not sources:
        raise ValueError("a depth image must be given, got none")
    names = _names_of(sources)
    files = [source.path for source in sources if source.item is None]
    if beside and len(files) < len(sources):
        raise ValueError(f"{meaning} must not be given of datasets, which have theirs")
    found = iter(_beside(beside, files, names))
    items = []
    for source, name in zip(sources, names, strict=True):
        path = source.path
        if source.item is not None:
            items.append(dataclasses.replace(source.item, name=name))
        elif camera is None:
            items.append(CloudFile(name, path))
        elif are_outlines:
            items.append(OutlineFile(name, path, _camera_of(camera, path)))
        else:
            of_image = _camera_of(camera, path)
            items.append(ImageFile(name, path, of_image, next(found, None), meaning))
    return items


def views_of(
    given: Sequence[Path], camera: Path, masks: Sequence[Path], poses: Path
) -> Views:
    """Several images of one object.

    Args:
        given: As in `items_of`, files alone.
        camera: Likewise.
        masks: Likewise.
        poses: JSON file with a list of 4 x 4 matrices, from the world to the camera,
            one for each image.

    Raises:
        ValueError: As in `items_of`; or poses are more or fewer than images, or broken.
    """
    what = f"file of poses {str(poses)!r}"
    with opened(poses, what) as file:
        listed = json_value(file.read(), what)
    items = items_of(given, camera, masks)
    images = tuple(item for item in items if isinstance(item, ImageFile))
    if len(images) < len(items):
        raise ValueError("depth must be images in files of their own to be one fit")
    if not isinstance(listed, list) or len(listed) != len(images):
        raise ValueError(
            f"{what} must hold a list of {len(images)} matrices, one for each image"
        )
    for number, pose in enumerate(listed):
        float_array(f"pose {number} of {what}", pose, (4, 4))
    return Views("views", images, tuple(listed))


def _sources(given: str, camera: str | Path | CameraFile | None) -> Iterator[_Source]:
    """What one path or pattern stands for."""
    path = Path(given)
    if path.exists():
        yield from _sources_at(path, camera)
        return
    if not glob.has_magic(given):
        raise ValueError(f"{given!r} does not exist")
    suffixes = CLOUDS if camera is None else IMAGES
    there = [Path(one) for one in sorted(glob.glob(given, recursive=True))]
    # Beside images lie other files, which a pattern may match.
    some = [one for one in there if one.is_dir() or one.suffix.lower() in suffixes]
    if not some:
        raise ValueError(f"{given!r} must match depth images, got none")
    for one in some:
        yield from _sources_at(one, camera)


def _sources_at(
    path: Path, camera: str | Path | CameraFile | None
) -> Iterator[_Source]:
    if path.is_dir():
        yield from _sources_in(path, camera)
    elif path.suffix == ".tar":
        yield from _of_dataset(path)
    elif camera is not None and path.suffix.lower() == LIST:
        lines = path.read_text(encoding="utf-8").splitlines()
        for line in filter(None, map(str.strip, lines)):
            # What a line names may be missing: that is a row of its own.
            yield _Source(path.parent / line)
    else:
        yield _Source(path)


def _sources_in(
    folder: Path, camera: str | Path | CameraFile | None
) -> Iterator[_Source]:
    if (folder / MANIFEST).is_file():
        yield from _of_dataset(folder)
        return
    suffixes = CLOUDS if camera is None else IMAGES
    files = [one for one in folder.iterdir() if one.suffix.lower() in suffixes]
    if _is_known(folder):
        yield from _of_folder(folder, camera)
    elif files:
        yield from map(_Source, sorted(files))
    else:
        raise ValueError(f"{str(folder)!r} must hold depth images, got none")


def _is_known(folder: Path) -> bool:
    """Whether a folder is of an RGB-D dataset."""
    try:
        return bool(kind_of(folder))
    except ValueError:
        return False


def _of_dataset(path: Path) -> Iterator[_Source]:
    for index, key in enumerate(read_dataset(path).keys()):
        yield _Source(path / key, DatasetImage(key, path, index))


def _of_folder(
    folder: Path, camera: str | Path | CameraFile | None
) -> Iterator[_Source]:
    known = None
    if camera is not None:
        file = camera if isinstance(camera, CameraFile) else read_camera(Path(camera))
        if not isinstance(file.camera, PinholeCamera):
            raise ValueError(f"camera must be a PinholeCamera of {str(folder)!r}")
        known = file.camera
    for shot in read_depth_folder(folder, camera=known).shots:
        yield _Source(folder / shot.name, FolderFrame(shot.name, shot, known))


def _names_of(sources: Sequence[_Source]) -> list[str]:
    """Names of items: their paths from the folder that they have in common.

    Raises:
        ValueError: One is given twice.
    """
    whole = [Path(os.path.abspath(source.path)) for source in sources]
    common = os.path.commonpath([path.parent for path in whole])
    paths = [path.relative_to(common) for path in whole]
    plain = [
        path.with_suffix("") if source.item is None else path
        for path, source in zip(paths, sources, strict=True)
    ]
    counts = collections.Counter(plain)
    # Of two files that differ in their endings alone these tell which is which.
    names = [
        (short if counts[short] == 1 else path).as_posix()
        for short, path in zip(plain, paths, strict=True)
    ]
    name, count = collections.Counter(names).most_common(1)[0]
    if count > 1:
        raise ValueError(f"depth images must be different, got {name!r} twice")
    return names


def _beside(
    given: Sequence[str | Path], images: Sequence[Path], names: Sequence[str]
) -> list[Path]:
    """Masks or labels of images, in their order; [] where none are given."""
    paths = [Path(one) for one in given]
    if len(paths) == 1 and paths[0].is_dir():
        return [paths[0] / f"{name}.png" for name in names]
    if len(paths) == 1 and _is_pattern(paths[0]):
        return [_filled(paths[0], image) for image in images]
    if paths and len(paths) != len(images):
        raise ValueError(
            "masks or labels must be one file a depth image, a folder of files of "
            f"their names, or a pattern, got {len(paths)} for {len(images)}"
        )
    return paths


def _camera_of(camera: str | Path | CameraFile, image: Path) -> Path | CameraFile:
    return camera if isinstance(camera, CameraFile) else _filled(Path(camera), image)


def _is_pattern(path: Path) -> bool:
    return any(name in str(path) for name in ("{folder}", "{name}"))


def _filled(path: Path, image: Path) -> Path:
    """A pattern with the folder and the name of an image; a plain path as it is."""
    text = str(path).replace("{folder}", str(image.parent))
    return Path(text.replace("{name}", image.stem))
