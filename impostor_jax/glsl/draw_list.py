"""All that a driver is told in order to draw primitives with a camera."""

__all__ = ["CLEAR_COLOR", "DrawCall", "DrawList", "calls_of", "draw_list_of"]

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.glsl.batches import Batch, batches_in_camera
from impostor_jax.glsl.conventions import DepthRange, depth_range, uniforms
from impostor_jax.glsl.impostors import Impostor
from impostor_jax.glsl.program import SAMPLES_PER_ROW

MOST_SAMPLES = 2048 * SAMPLES_PER_ROW
"""Rows of a texture that every implementation of WebGL2 has, times its width."""

CLEAR_COLOR = (0.0, 0.0, 0.0, -1.0)
"""Where nothing is drawn: no position, and the index -1."""


@dataclasses.dataclass(frozen=True)
class DrawCall:
    """Primitives that one call draws.

    Attributes:
        impostor: How they are drawn.
        rows: Attributes of each, as `program.attributes` lists them.
        samples: Texture of what they have besides, without rows if nothing.
    """

    impostor: Impostor
    rows: Float[np.ndarray, "n k"]
    samples: Float[np.ndarray, "rows cols"]


@dataclasses.dataclass(frozen=True)
class DrawList:
    """What a driver draws.

    Attributes:
        calls: One for each type of primitive.
        orthographic: Whether the camera's rays are parallel.
        stretch: Depths that the depth buffer spans.
        uniforms: Values of the shaders' uniforms.
    """

    calls: list[DrawCall]
    orthographic: bool
    stretch: DepthRange
    uniforms: dict[str, tuple[float, ...]]


def draw_list_of(
    primitives: Any, camera: PinholeCamera | OrthographicCamera
) -> DrawList:
    """What draws primitives in the world frame, as `batches_in_camera` takes them.

    Raises:
        ValueError: A type is wrong, the camera has a lens, something is traced, or
            the samples are too many.
    """
    batches = batches_in_camera(primitives, camera)
    center, reach = zip(*(b.impostor.ball(b.primitives) for b in batches), strict=True)
    stretch = depth_range(np.concatenate(center), np.concatenate(reach))
    orthographic = isinstance(camera, OrthographicCamera)
    return DrawList(calls_of(batches), orthographic, stretch, uniforms(camera, stretch))


def calls_of(batches: list[Batch]) -> list[DrawCall]:
    """What is told of primitives, those of one impostor together.

    Raises:
        ValueError: The samples are too many.
    """
    alike: dict[str, list[Batch]] = {}
    for batch in batches:
        alike.setdefault(batch.impostor.name, []).append(batch)
    return [_call(same) for same in alike.values()]


def _call(same: list[Batch]) -> DrawCall:
    """What draws the batches of one impostor."""
    impostor, rows, count = same[0].impostor, [], 0
    given: list[Float[np.ndarray, "n k"]] = []
    for batch in same:
        first = None
        if impostor.samples:
            given.append(impostor.samples(batch.primitives))
            first = count + given[-1].shape[1] * np.arange(batch.count)
            count += given[-1].size
        rows.append(_rows(batch, first))
    if count > MOST_SAMPLES:
        raise ValueError(
            f"{impostor.name}s must have at most {MOST_SAMPLES} samples in all, "
            f"got {count}"
        )
    texture = np.zeros((-(-count // SAMPLES_PER_ROW), SAMPLES_PER_ROW), np.float32)
    if given:
        texture.ravel()[:count] = np.concatenate([part.ravel() for part in given])
    return DrawCall(impostor, np.concatenate(rows), texture)


def _rows(
    batch: Batch, first_sample: Int[np.ndarray, " n"] | None
) -> Float[np.ndarray, "n k"]:
    """Fields of each primitive and its counters, side by side."""
    values = batch.impostor.values(batch.primitives)
    fields = [
        np.asarray(values[name]).reshape(batch.count, count)
        for name, count in batch.impostor.fields.items()
    ]
    index = batch.first + np.arange(batch.count)
    counters = [index] if first_sample is None else [first_sample, index]
    columns = [counter[:, None] for counter in counters]
    return np.concatenate([*fields, *columns], axis=-1).astype(np.float32)
