"""The scene file: shapes and, if it has them, camera, materials and lights, as JSON.

    {
      "version": 1,
      "camera": {"fx": 525, "fy": 525, "cx": 319.5, "cy": 239.5,
                 "width": 640, "height": 480},
      "shapes": [
        {"type": "sphere", "center": [0, 0, 1], "radius": 0.1,
         "material": {"transmit": 0.9, "fresnel": true}},
        {"type": "plane", "point": [0, 0.2, 1], "normal": [0, -1, 0]},
        {"type": "mesh", "path": "cup.ply", "scale": 0.001},
        {"type": "difference", "shapes": [
          {"type": "cylinder", "center": [0, 0, 1], "axis": [0, 1, 0],
           "radius": 0.05, "height": 0.2},
          {"type": "union", "shapes": [...]}
        ], "material": {"reflect": 0.1}}
      ],
      "lights": [
        {"type": "ambient", "intensity": 0.2},
        {"type": "point", "position": [1, -2, 0], "intensity": [0.8, 0.7, 0.6]}
      ],
      "background": [0.1, 0.2, 0.4]
    }

A shape's keys are the arguments of its class; what is left out takes the default. A
mesh has those of `read_mesh`, its path from the folder of the scene file, a `tube`
those of `tube`; it is written as the difference that it is. A `material` has the
arguments of `Material`, and is that of all triangles of a mesh. A light has those of
its class; its type is ambient, point or directional. Colors are linear. The camera has
the keys of a camera file and, where it has a pose, `camera_from_world`, four rows of
four numbers. Lengths are in meters, angles in radians.

A solid is a union, an intersection or a difference: of its `shapes`, which may be
solids, too, in any order and depth; a difference is the first without the others. In it
a plane stands for the half-space that its normal points away from, a heightfield for
the ground below it. The material is that of the outermost. A solid that was moved has
its pose, `world_from_shapes`, four rows of four numbers: moved one by one, its shapes
would be rounded each in its own way, and faces that are flush would be no longer.
"""

__all__ = ["VERSION", "SceneFile", "read_scene", "scene_from_record", "write_scene"]

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from impostor_jax.camera.base import posed
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.io.appearance_record import (
    color_from_record,
    light_from_record,
    light_record,
    material_from_record,
    material_record,
)
from impostor_jax.io.atomic import write_json
from impostor_jax.io.camera_file import FiledCamera, camera_from_record, camera_record
from impostor_jax.io.json_file import check_depth
from impostor_jax.io.parts import members
from impostor_jax.io.scene_record import VERSION, check_scene_record, read_scene_record
from impostor_jax.io.shape_record import pose_rows, shape_from_record, shape_record
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.rendering.lights import AbstractLight
from impostor_jax.rendering.material import Material

BLACK = (0.0, 0.0, 0.0)


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
    camera: FiledCamera | None = None
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
    return scene_from_record(read_scene_record(path), what, path.parent)


def scene_from_record(record: dict[str, Any], what: str, folder: Path) -> SceneFile:
    """What the record of a scene file holds.

    Args:
        record: As it was read.
        what: Names the file in errors.
        folder: That paths of meshes start from.

    Raises:
        ValueError: As of `read_scene`.
    """
    check_scene_record(record, what)
    entries, lights = record["shapes"], record.get("lights", [])
    try:
        read = [
            _read_entry(entry, f"shapes[{k}]", folder)
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
    camera: FiledCamera | None = None,
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
        ValueError: A heightfield is of a function, which no file can hold, solids are
            nested deeper than is read, or there are not as many materials as shapes.
    """
    record: dict[str, Any] = {"version": VERSION}
    if camera is not None:
        record["camera"] = camera_record(camera)
        if camera.camera_from_world is not None:
            record["camera"]["camera_from_world"] = pose_rows(camera.camera_from_world)
    singles = [single for shape in shapes for single in _singles(shape)]
    record["shapes"] = [shape_record(shape) for shape in singles]
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
    check_depth(record, "shapes")
    write_json(path, record)


def _read_camera(record: Any, what: str) -> FiledCamera:
    if not isinstance(record, dict):
        raise ValueError(f"camera of {what} must be a JSON object")
    values = dict(record)
    try:
        pose = RigidTransform.of(values.pop("camera_from_world", None))
    except ValueError as error:
        raise ValueError(f"camera of {what}: {error}") from error
    return posed(camera_from_record(values, f"camera of {what}").camera, pose)


def _read_entry(
    entry: Any, where: str, folder: Path
) -> tuple[AbstractPrimitive, Material | None]:
    """A shape, and its material if it has one."""
    if not isinstance(entry, dict) or "material" not in entry:
        return shape_from_record(entry, where, folder), None
    values = dict(entry)
    material = material_from_record(values.pop("material"), f"material of {where}")
    return shape_from_record(values, where, folder), material


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


def _singles(given: Any) -> list[Any]:
    """Shapes, or materials, of a batch (n,); or the only one."""
    is_material = isinstance(given, Material)
    return members(given, given.color.shape[:-1] if is_material else given.batch_shape)
