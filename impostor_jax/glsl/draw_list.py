"""All that a driver is told in order to draw primitives with a camera."""

__all__ = [
    "CLEAR_COLOR",
    "MOST_SAMPLES",
    "MOST_TEXELS",
    "DrawCall",
    "DrawList",
    "calls_of",
    "draw_list_of",
    "textured",
]

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.glsl.batches import Batch, balls_of, batches_in_camera
from impostor_jax.glsl.conventions import DepthRange, depth_range, uniforms
from impostor_jax.glsl.impostor import Impostor
from impostor_jax.glsl.program import SAMPLES_PER_ROW, TEXELS_PER_ROW

MOST_SAMPLES = 2048 * SAMPLES_PER_ROW
"""Rows of a texture that every implementation of WebGL2 has, times its width."""

MOST_TEXELS = 2048 * TEXELS_PER_ROW
"""The same, of four numbers each."""

CLEAR_COLOR = (0.0, 0.0, 0.0, -1.0)
"""Where nothing is drawn: no position, and the index -1."""


@dataclasses.dataclass(frozen=True)
class DrawCall:
    """Primitives that one call draws.

    Attributes:
        impostor: How they are drawn.
        rows: Attributes of each, as `program.attributes` lists them.
        samples: Texture of what they have besides, without rows if nothing.
        numbers: And of what solids are made of.
    """

    impostor: Impostor
    rows: Float[np.ndarray, "n k"]
    samples: Float[np.ndarray, "rows cols"]
    numbers: Float[np.ndarray, "rows2 cols2 4"]

    @property
    def textures(self) -> dict[str, Float[np.ndarray, "..."]]:
        """The textures that there are, by their names in the shader."""
        both = {"numbers": self.numbers, "samples": self.samples}
        return {name: texels for name, texels in both.items() if texels.size}


@dataclasses.dataclass(frozen=True)
class DrawList:
    """What a driver draws.

    Attributes:
        calls: One for each type of primitive, and each structure of solids.
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
    stretch = depth_range(*balls_of(batches))
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


def textured(
    values: Float[np.ndarray, "n ..."], width: int
) -> Float[np.ndarray, "rows cols ..."]:
    """Values one after the other in the rows of a texture."""
    spare = [(0, -len(values) % width), *[(0, 0)] * (values.ndim - 1)]
    padded = np.pad(values, spare).astype(np.float32)
    return padded.reshape(-1, width, *values.shape[1:])


def _call(same: list[Batch]) -> DrawCall:
    """What draws the batches of one impostor."""
    name = same[0].impostor.name
    samples, first_samples = _listed(same, [one.impostor.samples for one in same], ())
    numbers, first_numbers = _listed(same, [one.impostor.numbers for one in same], (4,))
    for many, most, what in (
        (len(samples), MOST_SAMPLES, "samples"),
        (len(numbers), MOST_TEXELS, "texels"),
    ):
        if many > most:
            raise ValueError(
                f"{name}s must have at most {most} {what} in all, got {many}"
            )
    rows = [
        np.concatenate([one.impostor.columns(one.primitives), *counters], axis=-1)
        for one, *counters in zip(
            same, first_samples, first_numbers, map(_indices, same), strict=True
        )
    ]
    return DrawCall(
        same[0].impostor,
        np.concatenate(rows).astype(np.float32),
        textured(samples, SAMPLES_PER_ROW),
        textured(numbers, TEXELS_PER_ROW),
    )


def _listed(
    same: list[Batch],
    told: Sequence[Callable[[Any], Float[np.ndarray, "..."]] | None],
    shape: tuple[int, ...],
) -> tuple[Float[np.ndarray, "m ..."], list[Int[np.ndarray, "n k"]]]:
    """What batches have besides, one after the other, and where each one's begins.

    Args:
        same: The batches.
        told: What makes it of each batch's primitives, if anything does.
        shape: Of one value.
    """
    parts, firsts, count = [np.zeros((0, *shape))], [], 0
    for batch, of in zip(same, told, strict=True):
        if of is None:
            firsts.append(np.zeros((batch.count, 0), int))
            continue
        values = of(batch.primitives)
        firsts.append(count + values.shape[1] * np.arange(batch.count)[:, None])
        parts.append(values.reshape(-1, *shape))
        count += len(parts[-1])
    return np.concatenate(parts), firsts


def _indices(batch: Batch) -> Int[np.ndarray, "n 1"]:
    return batch.first + np.arange(batch.count)[:, None]
