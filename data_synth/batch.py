"""Arrays of the scenes of a batch, which one program takes."""

__all__ = ["batch_of"]

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from data_synth.capture import BATCH, SceneBatch
from data_synth.draw import Drawn
from data_synth.preset import Preset
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.sphere import Sphere

AWAY = (0.0, 0.0, -10.0)
"""Where shapes are that only fill up a batch: behind the camera, in meters."""

FILLERS: dict[type[AbstractPrimitive], dict[str, Any]] = {
    Box: {"center": AWAY, "rotation": np.eye(3), "size": (0.01, 0.01, 0.01)},
    Cylinder: {"center": AWAY, "axis": (0, 0, 1), "radius": 0.01, "height": 0.01},
    Frustum: {"p1": AWAY, "p2": (0, 0, -11.0), "radius1": 0.01, "radius2": 0.01},
    Plane: {"point": AWAY, "normal": (0, 0, -1)},
    Sphere: {"center": AWAY, "radius": 0.01},
}
"""Arguments of these shapes."""


def batch_of(
    preset: Preset, cameras: Sequence[PinholeCamera], scenes: Mapping[int, Drawn]
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
    cylinders = _filled_up(Cylinder, max(preset.most_cylinders, 1), scenes)
    assert isinstance(cylinders, Cylinder)
    return SceneBatch(
        camera=jax.tree.map(lambda *x: np.stack(x), *seen_by),
        cylinders=cylinders,
        others=tuple(
            _filled_up(kind, most, scenes) for kind, most in preset.most_others.items()
        ),
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
                for arguments in _arguments(scene, kind)
            ]
            if parts:
                given = np.concatenate(parts)
                values[name][k, : len(given)] = given
    return kind(**values)


def _arguments(scene: Drawn, kind: type[AbstractPrimitive]) -> list[dict[str, Any]]:
    """Those of all shapes of a type in a scene, one by one or some together."""
    if kind is Plane:
        return [{"point": point, "normal": normal} for point, normal in scene.planes]
    things = (*scene.poses, *scene.scenery)
    return [thing.arguments() for thing in things if thing.primitive is kind]
