"""The scene file: shapes and, if it has them, camera, materials and lights, as JSON.

    {
      "version": 1,
      "camera": {"fx": 525, "fy": 525, "cx": 319.5, "cy": 239.5,
                 "width": 640, "height": 480},
      "shapes": [
        {"type": "sphere", "center": [0, 0, 1], "radius": 0.1,
         "material": {"transmit": 0.9, "fresnel": true}},
        {"type": "plane", "point": [0, 0.2, 1], "normal": [0, -1, 0]},
        {"type": "mesh", "path": "cup.ply", "scale": 0.001}
      ],
      "lights": [
        {"type": "ambient", "intensity": 0.2},
        {"type": "point", "position": [1, -2, 0], "intensity": [0.8, 0.7, 0.6]}
      ],
      "background": [0.1, 0.2, 0.4]
    }

A shape's keys are the arguments of its class; what is left out takes the default. A
mesh has those of `read_mesh`, its path from the folder of the scene file. A `material`
has the arguments of `Material`, and is that of all triangles of a mesh. A light has
those of its class; its type is ambient, point or directional. Colors are linear. The
camera has the keys of a camera file and, where it has a pose, `camera_from_world`, four
rows of four numbers. Lengths are in meters, angles in radians.
"""

__all__ = ["VERSION", "SceneFile", "read_scene", "write_scene"]

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.io.appearance_record import (
    color_from_record,
    light_from_record,
    light_record,
    material_from_record,
    material_record,
)
from impostor_jax.io.atomic import write_json
from impostor_jax.io.camera_file import camera_from_record, camera_record
from impostor_jax.io.json_file import (
    arguments_of,
    check_keys,
    read_json_object,
    typed_record,
)
from impostor_jax.io.mesh_file import read_mesh
from impostor_jax.primitives import PRIMITIVES
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.rendering.lights import AbstractLight
from impostor_jax.rendering.material import Material

VERSION = 1

REQUIRED = ("version", "shapes")
ALLOWED = (*REQUIRED, "camera", "lights", "background")

BLACK = (0.0, 0.0, 0.0)

KINDS: dict[str, Callable[..., AbstractPrimitive]] = {**PRIMITIVES, "mesh": read_mesh}
"""What a shape may be made by."""

STORED_AS = {("plane", "normal"): "unit_normal"}
"""Arguments that a class keeps under another name."""


class SceneFile(NamedTuple):
    """What a scene file holds.

    Attributes:
        shapes: In the order of the file, which is that of a scene's indices; a mesh is
            a batch (n,).
        camera: None where the file has none.
        materials: One of each shape, a batch (n,) of a mesh, as `trace` takes them;
            None where no shape has one.
        lights: In the order of the file; empty where it has none.
        background: Linear red, green and blue; black where the file has none.
    """

    shapes: list[AbstractPrimitive]
    camera: PinholeCamera | None = None
    materials: list[Material] | None = None
    lights: Sequence[AbstractLight] = ()
    background: tuple[float, float, float] = BLACK


def read_scene(path: Path) -> SceneFile:
    """Read shapes, camera, materials and lights.

    Raises:
        ValueError: The file is missing or broken, of another version, or holds a key
            or a value that is not understood; the message names it.
    """
    what = f"scene file {str(path)!r}"
    record = read_json_object(path, what)
    check_keys(record, REQUIRED, ALLOWED, what)
    if record["version"] != VERSION:
        raise ValueError(
            f"version of {what} must be {VERSION}, got {record['version']!r}"
        )
    entries, lights = record["shapes"], record.get("lights", [])
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"shapes of {what} must be a list that is not empty")
    if not isinstance(lights, list):
        raise ValueError(f"lights of {what} must be a list, got {lights!r}")
    try:
        read = [
            _read_entry(entry, f"shapes[{k}]", path.parent)
            for k, entry in enumerate(entries)
        ]
        lights = [
            light_from_record(light, f"lights[{k}]") for k, light in enumerate(lights)
        ]
        background = color_from_record(record.get("background", BLACK), "background")
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from error
    shapes = [shape for shape, _ in read]
    camera = record.get("camera")
    return SceneFile(
        shapes,
        None if camera is None else _read_camera(camera, what),
        _materials_of(read),
        lights,
        background,
    )


def write_scene(
    path: Path,
    shapes: Sequence[AbstractPrimitive],
    camera: PinholeCamera | None = None,
    materials: Material | Sequence[Material] | None = None,
    lights: Sequence[AbstractLight] = (),
    background: Any = BLACK,
) -> None:
    """Write what `read_scene` reads.

    Args:
        path: File name.
        shapes: Single ones, or batches (n,), which are written one by one.
        camera: None leaves it out.
        materials: As `trace` takes them: one of each shape, where a batch counts as
            many; or a single one of all; None leaves them out.
        lights: In the world frame; none leaves them out.
        background: Linear red, green and blue; black is left out.

    Raises:
        ValueError: A heightfield is of a function, which no file can hold, or there are
            not as many materials as shapes.
    """
    record: dict[str, Any] = {"version": VERSION}
    if camera is not None:
        record["camera"] = camera_record(camera)
        if camera.camera_from_world is not None:
            record["camera"]["camera_from_world"] = _matrix(camera.camera_from_world)
    singles = [single for shape in shapes for single in _singles(shape)]
    record["shapes"] = [_shape_record(shape) for shape in singles]
    if materials is not None:
        given = [materials] if isinstance(materials, Material) else materials
        made = [single for material in given for single in _singles(material)]
        if isinstance(materials, Material) and len(made) == 1:
            made *= len(singles)
        if len(made) != len(singles):
            raise ValueError(
                f"materials must be as many as the {len(singles)} shapes, or a single "
                f"one, got {len(made)}"
            )
        for entry, material in zip(record["shapes"], made, strict=True):
            entry["material"] = material_record(material)
    if lights:
        record["lights"] = [light_record(light) for light in lights]
    color = color_from_record(background, "background")
    if color != BLACK:
        record["background"] = list(color)
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


def _read_entry(
    entry: Any, where: str, folder: Path
) -> tuple[AbstractPrimitive, Material | None]:
    """A shape, and its material if it has one."""
    if not isinstance(entry, dict) or "material" not in entry:
        return _read_shape(entry, where, folder), None
    values = dict(entry)
    material = material_from_record(values.pop("material"), f"material of {where}")
    return _read_shape(values, where, folder), material


def _materials_of(
    read: Sequence[tuple[AbstractPrimitive, Material | None]],
) -> list[Material] | None:
    """A material of each shape, the default where it has none; None if none has one."""
    if all(material is None for _, material in read):
        return None
    return [
        jax.tree.map(
            lambda x, shape=shape: jnp.broadcast_to(x, (*shape.batch_shape, *x.shape)),
            Material() if material is None else material,
        )
        for shape, material in read
    ]


def _read_shape(entry: Any, where: str, folder: Path) -> AbstractPrimitive:
    name, values = typed_record(KINDS, entry, where)
    where = f"{where} ({name})"
    for flag in ("caps", "cut_faces"):
        if not isinstance(values.get(flag, True), bool):
            raise ValueError(f"{flag} of {where} must be true or false")
    if name == "mesh":
        if not isinstance(values["path"], str):
            raise ValueError(f"path of {where} must be a file name")
        values["path"] = folder / values["path"]
    try:
        shape = KINDS[name](**values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from error
    if shape.batch_shape and name != "mesh":
        raise ValueError(f"{where} must be one shape, got {shape.batch_shape} of them")
    return shape


def _singles(given: Any) -> list[Any]:
    """Shapes, or materials, of a batch (n,); or the only one."""
    is_material = isinstance(given, Material)
    batch = given.color.shape[:-1] if is_material else given.batch_shape
    return [
        jax.tree.map(lambda x, k=k: x.reshape(-1, *x.shape[len(batch) :])[k], given)
        for k in range(math.prod(batch))
    ]


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
