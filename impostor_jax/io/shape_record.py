"""Shapes as JSON: arguments of their classes, and solids of shapes within shapes."""

__all__ = ["pose_rows", "shape_from_record", "shape_record"]

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.io.json_file import arguments_of, typed_record
from impostor_jax.io.mesh_file import read_mesh
from impostor_jax.io.parts import Tree, tree_of
from impostor_jax.io.pose_file import rigid
from impostor_jax.primitives import PRIMITIVES
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.solid import Solid, difference, intersection, union
from impostor_jax.primitives.tube import tube

IDENTITY = np.eye(4).tolist()

SOLIDS: dict[str, Callable[..., Solid]] = {
    "union": union,
    "intersection": intersection,
    "difference": difference,
}
"""What solids may be made by."""

STORED_AS = {("plane", "normal"): "unit_normal"}
"""Arguments that a class keeps under another name."""


def _solid(name: str, shapes: Any, world_from_shapes: Any = None) -> Solid:
    """A solid, of a list of shapes and of their pose."""
    solid = SOLIDS[name](*shapes)
    pose = RigidTransform.of(world_from_shapes)
    return solid if pose is None else solid.transformed(pose)


KINDS: dict[str, Callable[..., AbstractPrimitive]] = {
    **PRIMITIVES,
    "mesh": read_mesh,
    "tube": tube,
    **{name: partial(_solid, name) for name in SOLIDS},
}
"""What a shape may be made by."""


def shape_from_record(entry: Any, where: str, folder: Path) -> AbstractPrimitive:
    """Make a shape from its record.

    Args:
        entry: What the file holds.
        where: Its place in the file, for errors.
        folder: That paths of meshes start from.

    Raises:
        ValueError: It is not understood; the message names the place.
    """
    name, values = typed_record(KINDS, entry, where)
    place, where = where, f"{where} ({name})"
    for flag in ("caps", "cut_faces"):
        if not isinstance(values.get(flag, True), bool):
            raise ValueError(f"{flag} of {where} must be true or false")
    if name in SOLIDS:
        values["shapes"] = _read_parts(values["shapes"], place, folder)
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


def _read_parts(entries: Any, where: str, folder: Path) -> list[AbstractPrimitive]:
    """Shapes that a solid is made of."""
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"shapes of {where} must be a list that is not empty")
    shapes = []
    for k, entry in enumerate(entries):
        place = f"{where}.shapes[{k}]"
        if isinstance(entry, dict) and "material" in entry:
            raise ValueError(
                f"material of {place} must be that of the outermost solid, which has "
                "one alone"
            )
        shape = shape_from_record(entry, place, folder)
        try:
            # Alone, to tell which of several cannot be part of a solid.
            if not isinstance(shape, Solid):
                union(shape)
        except ValueError as error:
            raise ValueError(f"{place}: {error}") from error
        shapes.append(shape)
    return shapes


def shape_record(shape: AbstractPrimitive) -> dict[str, Any]:
    """What `shape_from_record` makes a single shape from.

    Raises:
        ValueError: It holds a heightfield of a function, which no file can hold, or one
            whose sides in a solid have been moved away from it.
    """
    if isinstance(shape, Solid):
        record = _tree_record(tree_of(shape))
        pose = pose_rows(shape)
        return record if pose == IDENTITY else {**record, "world_from_shapes": pose}
    name = next(name for name, kind in PRIMITIVES.items() if kind is type(shape))
    record: dict[str, Any] = {"type": name}
    for argument, parameter in arguments_of(type(shape)).items():
        value = getattr(shape, STORED_AS.get((name, argument), argument))
        if isinstance(value, RigidTransform):
            value = pose_rows(value)
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


def _tree_record(tree: Tree) -> dict[str, Any]:
    if isinstance(tree, AbstractPrimitive):
        return shape_record(tree)
    parts = [_tree_record(part) for part in tree.parts]
    return {"type": tree.operation, "shapes": parts}


def pose_rows(transform: RigidTransform | Solid) -> list[list[float]]:
    """Homogeneous matrix of a transform, or of a solid's pose."""
    rotation, translation = transform.rotation, transform.translation
    return rigid(np.asarray(rotation), np.asarray(translation)).tolist()
