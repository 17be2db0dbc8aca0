"""All that a driver is told in order to trace a scene: shapes, materials and lights."""

__all__ = ["TraceList", "Traceable", "trace_list_of"]

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from impostor_jax.arguments import float_array, is_concrete, whole_number
from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.geometry.vec3 import unit
from impostor_jax.glsl.batches import Batch, batches_in_camera
from impostor_jax.glsl.conventions import DepthRange, uniforms
from impostor_jax.glsl.draw_list import (
    MOST_SAMPLES,
    MOST_TEXELS,
    DrawCall,
    calls_of,
    textured,
)
from impostor_jax.glsl.program import TEXELS_PER_ROW
from impostor_jax.glsl.trace_program import TraceKey
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.rendering.group import Group
from impostor_jax.rendering.lights import (
    AbstractLight,
    AmbientLight,
    DirectionalLight,
    PointLight,
)
from impostor_jax.rendering.material import DEFAULTS, Material, stacked
from impostor_jax.rendering.scene import Scene
from impostor_jax.rendering.secondary import anchors
from impostor_jax.rendering.trace import MOST_BOUNCES

AMBIENT, POINT, INVERSE_SQUARE, DIRECTIONAL = range(4)
"""Kinds of lights, as `trace.frag` numbers them."""

Traceable = Scene | AbstractPrimitive | Sequence[AbstractPrimitive]
"""What can be traced."""


@dataclasses.dataclass(frozen=True)
class TraceList:
    """What a driver traces.

    Attributes:
        key: What the shader is made for.
        numbers: Texture of shapes, materials and lights.
        samples: Texture of what shapes have besides, without rows if nothing.
        uniforms: Values of the shader's uniforms of floats; matrices column by column.
        places: Those of pairs of whole numbers: first texel, and how many things.
        batches: The shapes, in the frame of the camera.
    """

    key: TraceKey
    numbers: Float[np.ndarray, "rows cols 4"]
    samples: Float[np.ndarray, "rows2 cols2"]
    uniforms: dict[str, tuple[float, ...]]
    places: dict[str, tuple[int, int]]
    batches: list[Batch]

    @property
    def textures(self) -> dict[str, Float[np.ndarray, "..."]]:
        """The textures that there are, by their names in the shader."""
        both = {"numbers": self.numbers, "samples": self.samples}
        return {name: texels for name, texels in both.items() if texels.size}


def trace_list_of(
    scene: Traceable,
    camera: PinholeCamera | OrthographicCamera,
    lights: Sequence[AbstractLight],
    materials: Material | Sequence[Material] | None = None,
    background: Any = (0.0, 0.0, 0.0),
    depth: int = 3,
) -> TraceList:
    """What traces a scene, as `impostor_jax.trace` takes it.

    Args:
        scene: A scene, a shape, a batch (n,), or a sequence of shapes.
        camera: Without a lens.
        lights: In the world frame.
        materials: Of each shape or of all; white and dull if None.
        background: Color of rays that meet nothing.
        depth: Most times that a ray is mirrored or bent.

    Raises:
        ValueError: Something is out of range, traced, or none of what it should be;
            the camera has a lens; there are not as many materials as shapes; or the
            shapes are too many.
    """
    depth = whole_number("depth", depth, 0, MOST_BOUNCES, "bounces")
    shapes, order = _shapes_of(scene)
    batches = batches_in_camera(shapes, camera)
    count = sum(batch.count for batch in batches)
    made = _rows_of(materials, count)
    made = made if order is None else made[order]
    made = np.concatenate([_anchors(batches), made], axis=-1)
    mirrors, glass = made[:, 8].any(), made[:, 9].any()

    calls = calls_of(batches)
    parts, places, first, first_sample = [], {}, 0, 0
    for call in calls:
        parts.append(call.numbers.ravel())
        began = {"first_sample": first_sample, "first_number": first}
        first += call.numbers.size // 4
        first_sample += call.samples.size
        # The last column counts the primitives.
        rows = np.concatenate(
            [made[call.rows[:, -1].astype(int)], _fields(call, began)], axis=-1
        )
        parts.append(rows.ravel())
        places[f"{call.impostor.name}_listed"] = (first, len(rows))
        first += rows.size // 4
    parts.append(_lights(lights, camera).ravel())
    places["lights"] = (first, len(lights))
    numbers = np.concatenate(parts).reshape(-1, 4)
    for many, most, what in (
        (len(numbers), MOST_TEXELS, "texels"),
        (first_sample, MOST_SAMPLES, "samples"),
    ):
        if many > most:
            raise ValueError(
                f"scene and lights must fill at most {most} {what}, got {many}"
            )
    key = TraceKey(
        tuple(call.impostor for call in calls),
        isinstance(camera, OrthographicCamera),
        depth if mirrors or glass else 0,
        bool(depth and glass),
    )
    color = float_array("background", background, (3,))
    if color.ndim > 1 or not is_concrete(color):
        raise ValueError(
            f"background must be red, green and blue, concrete, got {background}"
        )
    values = {
        **uniforms(camera, DepthRange(0.0, 1.0, 0.0)),
        "background": tuple(float(part) for part in color),
        "turn": tuple(np.eye(3).ravel().tolist()),
        "eye": (0.0, 0.0, 0.0),
    }
    return TraceList(
        key,
        textured(numbers, TEXELS_PER_ROW),
        np.concatenate([call.samples for call in calls]),
        values,
        places,
        batches,
    )


def _fields(call: DrawCall, began: dict[str, int]) -> Float[np.ndarray, "n k"]:
    """What fills the texels of each shape, by whose numbers those of the call began."""
    fields, counters = call.rows[:, :-1].astype(float), call.impostor.counters
    fields[:, fields.shape[1] - len(counters) :] += [began[name] for name in counters]
    spare = 4 * call.impostor.texels - fields.shape[1]
    return np.pad(fields, ((0, 0), (0, spare)))


def _shapes_of(scene: Traceable) -> tuple[Any, Int[np.ndarray, " n"] | None]:
    """The shapes one type after the other, and the numbers that they were given."""
    if not isinstance(scene, Scene):
        return scene, None
    shapes, order = [], []
    for group in scene.groups:
        index = np.asarray(group.index)
        there = np.flatnonzero(index >= 0)
        # Heightfields lie alone, and are drawn one by one.
        alone = isinstance(group.primitives, Heightfield)
        chosen = 0 if alone else there
        shapes.append(jax.tree.map(lambda x, k=chosen: x[k], group.primitives))
        order.append(index[there])
    return shapes, np.concatenate(order)


def _anchors(batches: list[Batch]) -> Float[np.ndarray, "n 4"]:
    """Of each shape, by which hits are rounded."""
    groups = [
        Group(jax.tree.map(jnp.asarray, batch.primitives), jnp.arange(batch.count))
        for batch in batches
    ]
    return np.concatenate([np.asarray(anchor) for anchor in anchors(groups)])


def _rows_of(
    materials: Material | Sequence[Material] | None, count: int
) -> Float[np.ndarray, "n 8"]:
    """What each shape is made of: color, exponent, reflect, transmit, ior, fresnel."""
    made = stacked(Material() if materials is None else materials)
    if not is_concrete(made):
        raise ValueError("materials must be concrete, got traced ones")
    given = made.color.shape[0]
    if given != count and not (given == 1 and not isinstance(materials, Sequence)):
        raise ValueError(
            f"materials must be as many as the scene's {count} shapes, or a single "
            f"one, got {given}"
        )
    columns = [np.asarray(made.color)]
    for name, default in DEFAULTS.items():
        value = getattr(made, name)
        value = np.full(given, default) if value is None else np.asarray(value)
        columns.append(value[:, None])
    return np.broadcast_to(np.concatenate(columns, axis=-1), (count, 8))


def _lights(
    lights: Sequence[AbstractLight], camera: PinholeCamera | OrthographicCamera
) -> Float[np.ndarray, "n 8"]:
    """Place or direction in the camera frame, kind, and intensity of each light."""
    rows = np.zeros((len(lights), 8))
    for row, light in zip(rows, lights, strict=True):
        if not isinstance(light, AmbientLight | PointLight | DirectionalLight):
            raise ValueError(
                f"lights must be lights, such as ij.PointLight, got {light!r}"
            )
        if not is_concrete(light):
            raise ValueError("lights must be concrete, got traced ones")
        if camera.camera_from_world is not None:
            light = light.transformed(camera.camera_from_world)
        row[3], row[4:7] = AMBIENT, np.asarray(light.intensity)
        if isinstance(light, PointLight):
            square = light.falloff == "inverse_square"
            row[:3], row[3] = light.position, INVERSE_SQUARE if square else POINT
        elif isinstance(light, DirectionalLight):
            row[:3], row[3] = unit(jnp.asarray(light.direction)), DIRECTIONAL
    return rows
