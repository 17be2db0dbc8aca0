"""Where RGB-D datasets keep depth, cameras and poses: a list of shots of each folder.

References:
    Sturm et al., A Benchmark for the Evaluation of RGB-D SLAM Systems, IROS 2012; file
    formats and intrinsics as on the dataset's pages, and association as in its tool.
    Hodan et al., BOP: Benchmark for 6D Object Pose Estimation, ECCV 2018; formats as in
    bop_toolkit's `bop_datasets_format.md`.
    Choi et al., Robust Reconstruction of Indoor Scenes, CVPR 2015 (Redwood); the .log
    format as on its pages and in Open3D.
    Dai et al., ScanNet, CVPR 2017; folders as its SensReader exports them.
"""

__all__ = ["LAYOUTS", "Shot", "kind_of"]

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from impostor_jax.arguments import float_array, real_number
from impostor_jax.io.json_file import read_json_object
from impostor_jax.io.pose_file import (
    Matrix,
    bop_pose,
    checked_pose,
    inverse_pose,
    read_log,
    read_rows,
    rigid,
    text_lines,
)

Intrinsics = tuple[float, float, float, float]
"""fx, fy, cx and cy, in pixels; the center of the first pixel is at 0."""

PRIMESENSE: Intrinsics = (525.0, 525.0, 319.5, 239.5)
"""What OpenNI takes a camera of 640 x 480 pixels to have, as Redwood has it."""

FREIBURG: dict[str, Intrinsics] = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3),
    "freiburg2": (520.9, 521.0, 325.1, 249.7),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}
"""Of the color cameras of TUM's sequences, to which depth was registered. Those of the
first two have lenses, which the registration did not know, so none is taken off."""

TUM_UNIT_M, MILLIMETER = 1 / 5000, 0.001
"""Meters a unit of depth."""

MOST_SECONDS = 0.02
"""Between an image and its pose, in TUM's tool that associates them."""


class Shot(NamedTuple):
    """What a folder says of a frame.

    Attributes:
        name: Of the frame.
        depth: Image of integers.
        unit_m: Meters a unit of it.
        intrinsics: None where the folder does not say.
        camera_from_world: None where the folder has no poses.
        masks: Images of the visible parts of the objects.
        objects: Number of each one's model.
    """

    name: str
    depth: Path
    unit_m: float
    intrinsics: Intrinsics | None
    camera_from_world: Matrix | None
    masks: tuple[Path, ...] = ()
    objects: tuple[int, ...] = ()


def kind_of(folder: Path) -> str:
    """Which of the datasets a folder is of, by its files.

    Raises:
        ValueError: None of them.
    """
    if (folder / "scene_camera.json").is_file():
        return "bop"
    if (folder / "depth.txt").is_file():
        return "tum"
    if (folder / "intrinsic" / "intrinsic_depth.txt").is_file():
        return "scannet"
    if _trajectories(folder):
        return "redwood"
    raise ValueError(
        f"path must be a folder with scene_camera.json (BOP), depth.txt (TUM RGB-D), "
        f"intrinsic/intrinsic_depth.txt (ScanNet) or a trajectory.log (Redwood), got "
        f"{str(folder)!r}"
    )


def _tum_shots(folder: Path) -> list[Shot]:
    """Of a sequence: `depth.txt` lists seconds and files, `groundtruth.txt` poses.

    A frame without a pose within 20 ms is left out, if there are any poses.
    """
    listed = folder / "depth.txt"
    what = f"list {str(listed)!r}"
    lines = [line.split() for line in text_lines(listed, what)]
    try:
        files = [(float(seconds), name) for seconds, name in lines]
    except ValueError as error:
        raise ValueError(f"{what} must hold seconds and a file a line") from error
    known = [name for name in FREIBURG if name in folder.absolute().name]
    intrinsics = FREIBURG[known[0]] if known else None
    truth = folder / "groundtruth.txt"
    rows = read_rows(truth, 8) if truth.is_file() else None
    shots = []
    for seconds, name in files:
        pose = None
        if rows is not None:
            nearest = int(np.argmin(np.abs(rows[:, 0] - seconds)))
            if not abs(rows[nearest, 0] - seconds) <= MOST_SECONDS:
                continue
            pose = inverse_pose(_quaternion_pose(rows[nearest, 1:], str(truth)))
        path = folder / name
        shots.append(Shot(path.stem, path, TUM_UNIT_M, intrinsics, pose))
    return shots


def _quaternion_pose(numbers: Float[np.ndarray, " 7"], what: str) -> Matrix:
    """Pose of a position and a quaternion, whose scalar comes last."""
    if not (np.isfinite(numbers).all() and np.linalg.norm(numbers[3:]) > 0):
        raise ValueError(f"file {what!r} must hold finite poses, got {numbers}")
    return rigid(Rotation.from_quat(numbers[3:]).as_matrix(), numbers[:3])


def _bop_shots(folder: Path) -> list[Shot]:
    """Of a scene's folder: a camera for each image, and masks where there are some."""
    what = f"scene_camera of scene {str(folder)!r}"
    cameras = read_json_object(folder / "scene_camera.json", what)
    truth_file, truth = folder / "scene_gt.json", {}
    if truth_file.is_file():
        truth = read_json_object(truth_file, f"scene_gt of scene {str(folder)!r}")
    shots = []
    for key, record in cameras.items():
        try:
            k = np.asarray(float_array("cam_K", record["cam_K"], (9,)), float)
            scale = real_number("depth_scale", record["depth_scale"], positive=True)
            name = f"{int(key):06d}"
            objects = tuple(int(one["obj_id"]) for one in truth.get(key, []))
            pose = _bop_pose(record)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"{what} is broken at {key!r}: {error}") from error
        masks = tuple(
            folder / "mask_visib" / f"{name}_{i:06d}.png" for i in range(len(objects))
        )
        has_masks = (folder / "mask_visib").is_dir()
        shots.append(
            Shot(
                name,
                _depth_of(folder, name),
                MILLIMETER * scale,
                (float(k[0]), float(k[4]), float(k[2]), float(k[5])),
                pose,
                masks if has_masks else (),
                objects if has_masks else (),
            )
        )
    return sorted(shots, key=lambda shot: shot.name)


def _bop_pose(record: dict[str, Any]) -> Matrix | None:
    if "cam_R_w2c" not in record:
        return None
    for name, count in (("cam_R_w2c", 9), ("cam_t_w2c", 3)):
        float_array(name, record[name], (count,))
    return bop_pose(record)


def _depth_of(folder: Path, name: str) -> Path:
    """Depth image of a name; ITODD's are TIFF files, all others' PNG files."""
    tiff = folder / "depth" / f"{name}.tif"
    return tiff if tiff.is_file() else tiff.with_suffix(".png")


def _redwood_shots(folder: Path) -> list[Shot]:
    """Of images of a PrimeSense camera, with a pose of each in one file, or none.

    The k-th pose is that of the k-th image; images beyond the last have none and are
    left out.
    """
    images = sorted((folder / "depth").glob("*.png"))
    found = _trajectories(folder)
    if len(found) > 1:
        names = ", ".join(path.name for path in found)
        raise ValueError(
            f"path must hold one trajectory, got {names} in {str(folder)!r}"
        )
    poses: list[Matrix | None] = [None] * len(images)
    if found:
        poses = [inverse_pose(pose) for pose in read_log(found[0])]
    return [
        Shot(path.stem, path, MILLIMETER, PRIMESENSE, pose)
        for path, pose in zip(images, poses, strict=False)
    ]


def _trajectories(folder: Path) -> list[Path]:
    """Files of poses; one of the plain name goes before all others."""
    plain = folder / "trajectory.log"
    if plain.is_file():
        return [plain]
    return sorted([*folder.glob("*.log"), *folder.glob("*traj*.txt")])


def _scannet_shots(folder: Path) -> list[Shot]:
    """Of what SensReader exports: `depth/N.png`, `pose/N.txt` and `intrinsic/`.

    A frame whose pose is not finite, where tracking was lost, is left out.
    """
    k = read_rows(folder / "intrinsic" / "intrinsic_depth.txt", 4)
    if len(k) != 4:
        raise ValueError(f"intrinsic_depth.txt of {str(folder)!r} must be 4 x 4")
    intrinsics = (float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]))
    images = sorted(
        (folder / "depth").glob("*.png"),
        key=lambda path: (len(path.stem), path.stem),
    )
    shots = []
    for path in images:
        file = folder / "pose" / f"{path.stem}.txt"
        pose = read_rows(file, 4)
        if np.isfinite(pose).all():
            inverse = inverse_pose(checked_pose(pose, f"pose file {str(file)!r}"))
            shots.append(Shot(path.stem, path, MILLIMETER, intrinsics, inverse))
    return shots


LAYOUTS: dict[str, Callable[[Path], list[Shot]]] = {
    "bop": _bop_shots,
    "redwood": _redwood_shots,
    "scannet": _scannet_shots,
    "tum": _tum_shots,
}
"""By the names of the kinds."""
