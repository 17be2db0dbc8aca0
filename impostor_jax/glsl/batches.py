"""What a caller hands to a driver, checked."""

__all__ = ["Batch", "balls_of", "batches_in_camera"]

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from impostor_jax.arguments import is_concrete
from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.glsl.impostor import Ball, Impostor
from impostor_jax.glsl.impostors import IMPOSTORS, impostor_of
from impostor_jax.primitives.base import AbstractPrimitive, in_camera_frame
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.solid import Solid


@dataclasses.dataclass(frozen=True)
class Batch:
    """Primitives of one type.

    Attributes:
        primitives: A batch (n,) of NumPy arrays in the camera frame.
        first: Index of the first of them among all that are drawn.
        impostor: How they are drawn.
    """

    primitives: AbstractPrimitive
    first: int
    impostor: Impostor

    @property
    def count(self) -> int:
        """How many they are."""
        return self.primitives.batch_shape[0]


def batches_in_camera(primitives: Any, camera: Any) -> list[Batch]:
    """Primitives in the camera frame, in the order in which they are given.

    Args:
        primitives: One primitive, a batch (n,), or a sequence of these.
        camera: Without a lens.

    Raises:
        ValueError: A type is wrong, the camera has a lens, or something is traced.
    """
    if not isinstance(camera, PinholeCamera | OrthographicCamera):
        raise ValueError(
            "camera must be a PinholeCamera or an OrthographicCamera, got "
            f"{type(camera).__name__}"
        )
    if isinstance(camera, PinholeCamera) and camera.distortion is not None:
        raise ValueError("camera must have no lens: the shaders draw straight lines")
    if not is_concrete((primitives, camera)):
        raise ValueError("primitives and camera must be concrete, got traced ones")
    given = primitives if isinstance(primitives, Sequence) else (primitives,)
    batches, first = [], 0
    for one in given:
        batch = Batch(_batch(one, camera), first, impostor_of(one))
        if batch.count:
            batches.append(batch)
        first += batch.count
    if not first:
        raise ValueError("primitives must hold at least one, got none")
    return batches


def balls_of(batches: Sequence[Batch]) -> Ball:
    """Balls that hold all primitives of some batches."""
    balls = [one.impostor.ball(one.primitives) for one in batches]
    center, radius = zip(*balls, strict=True)
    return np.concatenate(center), np.concatenate(radius)


def _batch(
    primitive: Any, camera: PinholeCamera | OrthographicCamera
) -> AbstractPrimitive:
    """The primitive as a batch in the camera frame."""
    known = (*IMPOSTORS, Solid)
    if type(primitive) not in known or len(primitive.batch_shape) > 1:
        names = ", ".join(one.__name__ for one in known)
        raise ValueError(
            f"primitives must be one primitive of {names}, a batch (n,) of one of "
            f"them, or a sequence of these, got {type(primitive).__name__}"
        )
    for shape in primitive.shapes if isinstance(primitive, Solid) else (primitive,):
        if isinstance(shape, Heightfield) and callable(shape.height):
            raise ValueError(
                "height must be an array where a shader draws it, got a function; "
                "sample it on a grid"
            )
    if isinstance(primitive, Heightfield) and primitive.batch_shape:
        raise ValueError(
            "a heightfield must be a single one, got a batch of shape "
            f"{primitive.batch_shape}; give several as a sequence"
        )
    # Before it is a batch: the pose of a heightfield is that of one.
    placed = in_camera_frame(primitive, camera)
    if not primitive.batch_shape:
        placed = jax.tree.map(lambda field: field[None], placed)
    return jax.tree.map(np.asarray, placed)
