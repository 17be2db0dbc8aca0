"""Depth images of RGB-D datasets, with their cameras and poses, from folders.

for frame in ij.io.read_depth_folder("rgbd_dataset_freiburg1_desk"):
    fit = ij.fit_cylinder(frame.depth, frame.camera)
"""

__all__ = ["DepthFolder", "DepthFrame", "read_depth_folder"]

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, overload

import numpy as np
from jaxtyping import Bool, Float
from typing_extensions import override

from impostor_jax.camera.base import posed
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.io.depth_image import read_depth, read_mask
from impostor_jax.io.depth_layouts import LAYOUTS, Shot, kind_of
from impostor_jax.plain_arguments import one_of

HAVE_CAMERAS = ("bop", "scannet")
"""Kinds of folders whose own files hold the intrinsics."""


class DepthFrame(NamedTuple):
    """A depth image of a folder.

    Attributes:
        depth: In meters; 0 where there is no reading.
        camera: With its pose in the dataset's world, where the folder has one.
        name: Of the image's file, without its ending.
        masks: Visible pixels of each of n objects, of BOP alone; they may be none.
        objects: Number of the model that each is of.
    """

    depth: Float[np.ndarray, "h w"]
    camera: PinholeCamera
    name: str
    masks: Bool[np.ndarray, "n h w"]
    objects: tuple[int, ...]


class DepthFolder(Sequence[DepthFrame]):
    """The frames of a folder, each of which is read when it is asked for.

    Attributes:
        shots: What the folder says of each.
        camera: That took them, where the folder does not say.
    """

    shots: tuple[Shot, ...]
    camera: PinholeCamera | None

    def __init__(self, shots: Sequence[Shot], camera: PinholeCamera | None):
        self.shots = tuple(shots)
        self.camera = camera

    @override
    def __len__(self) -> int:
        return len(self.shots)

    @overload
    def __getitem__(self, index: int) -> DepthFrame: ...

    @overload
    def __getitem__(self, index: slice) -> list[DepthFrame]: ...

    @override
    def __getitem__(self, index: int | slice) -> DepthFrame | list[DepthFrame]:
        if isinstance(index, slice):
            return [self[k] for k in range(len(self))[index]]
        shot, given = self.shots[index], self.camera
        size = None if given is None else (given.height, given.width)
        depth = read_depth(shot.depth, shot.unit_m, size).astype(np.float32)
        masks = [read_mask(path, depth.shape) for path in shot.masks]
        return DepthFrame(
            depth,
            _camera_of(shot, depth.shape) if given is None else _moved(given, shot),
            shot.name,
            np.array(masks, bool).reshape(len(masks), *depth.shape),
            shot.objects,
        )


def read_depth_folder(
    path: str | Path, kind: str | None = None, *, camera: PinholeCamera | None = None
) -> DepthFolder:
    """Read the depth images of an RGB-D dataset, in the order of the folder.

    Args:
        path: Folder of one sequence or scene. Units, cameras and poses are where each
            of these has them:

            - TUM RGB-D: `depth.txt` and, if there are poses, `groundtruth.txt`; the
              intrinsics are those of freiburg1, 2 or 3 in the folder's name.
            - BOP: `scene_camera.json`, `depth/` and, if there are masks,
              `scene_gt.json` and `mask_visib/`.
            - ScanNet, as its SensReader exports it: `depth/`, `pose/` and
              `intrinsic/intrinsic_depth.txt`.
            - Redwood: `depth/` and `trajectory.log`, or another .log or *traj*.txt.
        kind: "tum", "bop", "scannet" or "redwood"; told by the files if None.
        camera: Of TUM RGB-D and Redwood, instead of the one that the folder's images
            are known to be from. Its pose does not count where the folder has one.

    Returns:
        A sequence of frames, which are read when they are asked for. Those that the
        dataset has lost the pose of are left out.

    Raises:
        ValueError: The folder is of no such kind, a file is missing or broken, or the
            camera is not known, or is known and was given. A broken image raises it
            when it is read.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise ValueError(f"path must be a folder, got {str(folder)!r}")
    if kind is None:
        kind = kind_of(folder)
    else:
        one_of("kind", kind, LAYOUTS)
    if camera is not None and kind in HAVE_CAMERAS:
        raise ValueError(
            f"camera must not be given of a folder of {kind}, whose files have it"
        )
    shots = LAYOUTS[kind](folder)
    if not shots:
        raise ValueError(f"path must hold depth images, got none in {str(folder)!r}")
    if camera is None and shots[0].intrinsics is None:
        raise ValueError(
            "camera must be given where the folder's name has none of freiburg1, "
            f"freiburg2 and freiburg3, got {str(folder)!r}"
        )
    return DepthFolder(shots, camera)


def _camera_of(shot: Shot, size: tuple[int, int]) -> PinholeCamera:
    """The camera of a frame with intrinsics; `size` is rows and columns."""
    assert shot.intrinsics is not None
    height, width = size
    try:
        return PinholeCamera(
            *shot.intrinsics, width, height, camera_from_world=shot.camera_from_world
        )
    except ValueError as error:
        raise ValueError(f"camera of {str(shot.depth)!r}: {error}") from error


def _moved(camera: PinholeCamera, shot: Shot) -> PinholeCamera:
    """A camera with the pose of a frame, or its own where that has none."""
    if shot.camera_from_world is None:
        return camera
    return posed(camera, RigidTransform.from_matrix(shot.camera_from_world))
