"""The scene file: shapes and, if it has one, the camera, as JSON.

    {
      "version": 1,
      "camera": {"fx": 525, "fy": 525, "cx": 319.5, "cy": 239.5,
                 "width": 640, "height": 480},
      "shapes": [
        {"type": "sphere", "center": [0, 0, 1], "radius": 0.1},
        {"type": "plane", "point": [0, 0.2, 1], "normal": [0, -1, 0]}
      ]
    }

A shape's keys are the arguments of its class; what is left out takes the default. The
camera has the keys of a camera file and, where it has a pose, `camera_from_world`, four
rows of four numbers. Lengths are in meters, angles in radians.
"""

__all__ = ["VERSION", "SceneFile", "read_scene", "write_scene"]

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.io.atomic import write_json
from impostor_jax.io.camera_file import camera_from_record, camera_record
from impostor_jax.io.json_file import (
    arguments_of,
    check_keys,
    read_json_object,
    typed_record,
)
from impostor_jax.primitives import PRIMITIVES
from impostor_jax.primitives.base import AbstractPrimitive

VERSION = 1

STORED_AS = {("plane", "normal"): "unit_normal"}
"""Arguments that a class keeps under another name."""


class SceneFile(NamedTuple):
    """What a scene file holds.

    Attributes:
        shapes: In the order of the file, which is that of a scene's indices.
        camera: None where the file has none.
    """

    shapes: list[AbstractPrimitive]
    camera: PinholeCamera | None


def read_scene(path: Path) -> SceneFile:
    """Read shapes and camera.

    Raises:
        ValueError: The file is missing or broken, of another version, or holds a key
            or a value that is not understood; the message names it.
    """
    what = f"scene file {str(path)!r}"
    record = read_json_object(path, what)
    check_keys(record, ("version", "shapes"), ("version", "shapes", "camera"), what)
    if record["version"] != VERSION:
        raise ValueError(
            f"version of {what} must be {VERSION}, got {record['version']!r}"
        )
    entries = record["shapes"]
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"shapes of {what} must be a list that is not empty")
    try:
        shapes = [_read_shape(entry, f"shapes[{k}]") for k, entry in enumerate(entries)]
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from error
    camera = record.get("camera")
    return SceneFile(shapes, None if camera is None else _read_camera(camera, what))


def write_scene(
    path: Path,
    shapes: Sequence[AbstractPrimitive],
    camera: PinholeCamera | None = None,
) -> None:
    """Write shapes and camera as `read_scene` reads them.

    Args:
        path: File name.
        shapes: Single ones, or batches (n,), which are written one by one.
        camera: None leaves it out.

    Raises:
        ValueError: A heightfield is of a function, which no file can hold.
    """
    record: dict[str, Any] = {"version": VERSION}
    if camera is not None:
        record["camera"] = camera_record(camera)
        if camera.camera_from_world is not None:
            record["camera"]["camera_from_world"] = _matrix(camera.camera_from_world)
    singles = [single for shape in shapes for single in _singles(shape)]
    record["shapes"] = [_shape_record(shape) for shape in singles]
    write_json(path, record)


def _read_camera(record: Any, what: str) -> PinholeCamera:
    if not isinstance(record, dict):
        raise ValueError(f"camera of {what} must be a JSON object")
    values = dict(record)
    try:
        pose = RigidTransform.of(values.pop("camera_from_world", None))
    except ValueError as error:
        raise ValueError(f"camera of {what}: {error}") from error
    camera = camera_from_record(values, f"camera of {what}").camera
    return eqx.tree_at(
        lambda c: c.camera_from_world, camera, pose, is_leaf=lambda x: x is None
    )


def _read_shape(entry: Any, where: str) -> AbstractPrimitive:
    name, values = typed_record(PRIMITIVES, entry, where)
    where = f"{where} ({name})"
    for flag in ("caps", "cut_faces"):
        if not isinstance(values.get(flag, True), bool):
            raise ValueError(f"{flag} of {where} must be true or false")
    try:
        shape = PRIMITIVES[name](**values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from error
    if shape.batch_shape:
        raise ValueError(f"{where} must be one shape, got {shape.batch_shape} of them")
    return shape


def _singles(shape: AbstractPrimitive) -> list[AbstractPrimitive]:
    if not shape.batch_shape:
        return [shape]
    (count,) = shape.batch_shape
    return [jax.tree.map(lambda x, k=k: x[k], shape) for k in range(count)]


def _shape_record(shape: AbstractPrimitive) -> dict[str, Any]:
    name = next(name for name, kind in PRIMITIVES.items() if kind is type(shape))
    record: dict[str, Any] = {"type": name}
    for argument, parameter in arguments_of(type(shape)).items():
        value = getattr(shape, STORED_AS.get((name, argument), argument))
        if isinstance(value, RigidTransform):
            value = _matrix(value)
        elif isinstance(value, jax.Array | np.ndarray):
            value = np.asarray(value).tolist()
        elif not isinstance(value, bool | str | None):
            raise ValueError(
                f"{argument} of a {name} must be numbers to be written, got "
                f"{type(value).__name__}"
            )
        if value is not None and value != parameter.default:
            record[argument] = value
    return record


def _matrix(transform: RigidTransform) -> list[list[float]]:
    matrix = np.eye(4)
    matrix[:3, :3] = np.asarray(transform.rotation)
    matrix[:3, 3] = np.asarray(transform.translation)
    return matrix.tolist()
