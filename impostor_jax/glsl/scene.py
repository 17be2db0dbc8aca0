"""All that a driver is told in order to draw primitives with a camera."""

__all__ = ["NOTHING", "Draw", "Scene", "scene_of"]

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.glsl.conventions import DepthRange, depth_range, uniforms
from impostor_jax.glsl.impostors import Impostor
from impostor_jax.glsl.request import Batch, batches_in_camera

NOTHING = (0.0, 0.0, 0.0, -1.0)
"""Where nothing is drawn: no position, and the index -1."""


@dataclasses.dataclass(frozen=True)
class Draw:
    """Primitives that one call draws.

    Attributes:
        impostor: How they are drawn.
        rows: Attributes of each, as `program.attributes` lists them.
    """

    impostor: Impostor
    rows: Float[np.ndarray, "n k"]


@dataclasses.dataclass(frozen=True)
class Scene:
    """What a driver draws.

    Attributes:
        draws: One for each type of primitive.
        orthographic: Whether the camera's rays are parallel.
        stretch: Depths that the depth buffer spans.
        uniforms: Values of the shaders' uniforms.
    """

    draws: list[Draw]
    orthographic: bool
    stretch: DepthRange
    uniforms: dict[str, tuple[float, ...]]


def scene_of(primitives: Any, camera: PinholeCamera | OrthographicCamera) -> Scene:
    """Scene of primitives in the world frame, as `batches_in_camera` takes them.

    Raises:
        ValueError: A type is wrong, the camera has a lens, or something is traced.
    """
    batches = batches_in_camera(primitives, camera)
    center, reach = zip(*(b.impostor.ball(b.primitives) for b in batches), strict=True)
    stretch = depth_range(np.concatenate(center), np.concatenate(reach))
    rows: dict[str, list[Batch]] = {}
    for batch in batches:
        rows.setdefault(batch.impostor.name, []).append(batch)
    draws = [
        Draw(same[0].impostor, np.concatenate([_rows(batch) for batch in same]))
        for same in rows.values()
    ]
    orthographic = isinstance(camera, OrthographicCamera)
    return Scene(draws, orthographic, stretch, uniforms(camera, stretch))


def _rows(batch: Batch) -> Float[np.ndarray, "n k"]:
    """Fields of each primitive and its index, side by side."""
    values = batch.impostor.values(batch.primitives)
    fields = [
        np.asarray(values[name]).reshape(batch.count, count)
        for name, count in batch.impostor.fields.items()
    ]
    index = batch.first + np.arange(batch.count)[:, None]
    return np.concatenate([*fields, index], axis=-1).astype(np.float32)
