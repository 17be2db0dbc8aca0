"""Arrays of the scenes of a batch, which one program takes."""

__all__ = ["batch_of"]

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from data_synth.appearance import Appearance
from data_synth.capture import BATCH, SceneBatch, ShownLook
from data_synth.draw import Drawn
from data_synth.look import Look
from data_synth.preset import Preset
from impostor_jax.io.camera_file import FiledCamera
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.rendering.material import Material

AWAY = (0.0, 1e4, -10.0)
"""Where shapes are that only fill up a batch, in meters: behind a camera, and deeper
below a scanner than it looks down."""

FILLERS: dict[type[AbstractPrimitive], dict[str, Any]] = {
    Box: {"center": AWAY, "rotation": np.eye(3), "size": (0.01, 0.01, 0.01)},
    Cylinder: {"center": AWAY, "axis": (0, 0, 1), "radius": 0.01, "height": 0.01},
    Frustum: {"p1": AWAY, "p2": (0, 1e4, -11.0), "radius1": 0.01, "radius2": 0.01},
    Plane: {"point": AWAY, "normal": (0, 0, -1)},
    Sphere: {"center": AWAY, "radius": 0.01},
}
"""Arguments of these shapes."""


def batch_of(
    preset: Preset, cameras: Sequence[FiledCamera], scenes: Mapping[int, Drawn]
) -> SceneBatch:
    """Arrays of scenes, filled up to as many shapes for each.

    Args:
        preset: Says how many shapes there may be.
        cameras: Those of the dataset.
        scenes: By their places in the batch.
    """
    num_bound = np.zeros(BATCH, np.int32)
    seen_by = [cameras[0]] * BATCH
    for k, scene in scenes.items():
        seen_by[k] = cameras[scene.camera]
        num_bound[k] = len(scene.poses) - scene.num_clutter
    # Of cylinders one at least, which no image need show.
    most = {Cylinder: max(preset.most_cylinders, 1), **preset.most_others}
    cylinders, *others = (_filled_up(*of_kind, scenes) for of_kind in most.items())
    assert isinstance(cylinders, Cylinder)
    return SceneBatch(
        camera=jax.tree.map(lambda *x: np.stack(x), *seen_by),
        cylinders=cylinders,
        others=tuple(others),
        look=_looks(preset.appearance, most, scenes),
        num_bound=jnp.asarray(num_bound),
        is_used=jnp.array([k in scenes for k in range(BATCH)]),
    )


def _filled_up(
    kind: type[AbstractPrimitive], most: int, scenes: Mapping[int, Drawn]
) -> AbstractPrimitive:
    """The shapes of a type, and others behind the camera."""
    values = {}
    for name, value in FILLERS[kind].items():
        filler = np.asarray(value, np.float32)
        values[name] = np.broadcast_to(filler, (BATCH, most, *filler.shape)).copy()
        for k, scene in scenes.items():
            parts = [
                np.reshape(arguments[name], (-1, *filler.shape))
                for arguments, _ in _shapes(scene, kind)
            ]
            if parts:
                given = np.concatenate(parts)
                values[name][k, : len(given)] = given
    return kind(**values)


def _shapes(
    scene: Drawn, kind: type[AbstractPrimitive]
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Arguments of all shapes of a type, one by one or some together, and materials.

    Of these there are none if no color is wanted.
    """
    look = scene.look or Look(
        [{}] * len(scene.planes), [{}] * len(scene.poses), [{}] * len(scene.scenery),
        lights=[], background=[],
    )  # fmt: skip
    if kind is Plane:
        planes = [{"point": point, "normal": normal} for point, normal in scene.planes]
        return list(zip(planes, look.planes, strict=True))
    things = (*scene.poses, *scene.scenery)
    materials = (*look.cylinders, *look.scenery)
    return [
        (thing.arguments(), material)
        for thing, material in zip(things, materials, strict=True)
        if thing.primitive is kind
    ]


def _looks(
    appearance: Appearance | None,
    most: Mapping[type[AbstractPrimitive], int],
    scenes: Mapping[int, Drawn],
) -> ShownLook | None:
    """Materials and lights, of what only fills up the batch, too."""
    if appearance is None:
        return None
    values: dict[str, Any] = {"color": np.ones(3), "exponent": 1.0}
    if appearance.mirrors:
        values["reflect"] = 0.0
    if appearance.glasses:
        values |= {"transmit": 0.0, "ior": 1.0}
    count = sum(most.values())
    arrays = {
        name: np.broadcast_to(value, (BATCH, count, *np.shape(value))).astype(
            np.float32
        )
        for name, value in values.items()
    }
    # The first light is that from all sides.
    intensity = np.zeros((BATCH, 1 + appearance.lamps), np.float32)
    position = np.zeros((BATCH, 1 + appearance.lamps, 3), np.float32)
    background = np.zeros((BATCH, 3), np.float32)
    for k, scene in scenes.items():
        assert scene.look is not None
        background[k] = scene.look.background
        for row, light in enumerate(scene.look.lights):
            intensity[k, row] = light["intensity"]
            position[k, row] = light.get("position", 0.0)
        place = 0
        for kind, room in most.items():
            first = place
            for arguments, material in _shapes(scene, kind):
                last = first + _number(kind, arguments)
                for name in values.keys() & material.keys():
                    arrays[name][k, first:last] = material[name]
                first = last
            place += room
    lights = map(jnp.asarray, (intensity, position, background))
    material = Material(**arrays)  # pyright: ignore[reportArgumentType]
    return ShownLook(material, *lights)


def _number(kind: type[AbstractPrimitive], arguments: dict[str, Any]) -> int:
    """How many shapes arguments are of."""
    name, filler = next(iter(FILLERS[kind].items()))
    return np.size(arguments[name]) // np.size(filler)
