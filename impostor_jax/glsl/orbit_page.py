"""A page in which a traced scene is turned around by hand.

The shader that traces draws it, in a frame that stays that of the given camera; what
turns is the rays. They turn about a pivot, and one of the world's axes stays upright.
"""

__all__ = ["orbit_page", "upright"]

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.glsl.batches import Batch, balls_of
from impostor_jax.glsl.html import html_page, traced_message
from impostor_jax.glsl.trace_list import POINT, Traceable, trace_list_of
from impostor_jax.primitives.base import in_world_frame
from impostor_jax.rendering.lights import AbstractLight, AmbientLight, PointLight
from impostor_jax.rendering.material import Material

HEADLIGHT = (AmbientLight(0.2), PointLight((0.0, 0.0, 0.0), 0.8))
"""Light of a scene that has none, in the camera frame; what faces it is not clipped."""


def orbit_page(
    scene: Traceable,
    camera: PinholeCamera | OrthographicCamera,
    lights: Sequence[AbstractLight] = (),
    materials: Material | Sequence[Material] | None = None,
    background: Any = (0.0, 0.0, 0.0),
    depth: int = 3,
) -> str:
    """HTML page that traces a scene with WebGL2 and needs nothing else.

    A drag turns the camera around the scene, the wheel moves it nearer, a drag with the
    right button or shift moves it aside, and a double click brings it back. It turns
    about the middle of the shapes that the picture shows whole, or else what its middle
    shows; upright stays that axis of the world which is nearest to the picture's own
    upwards. The window is filled, and holds at least what the camera's image does.

    Args:
        scene: In the world frame, as `OffscreenRenderer.trace` takes it.
        camera: Where the page begins; without a lens.
        lights: In the world frame; if there are none, one goes along with the camera,
            beside a little from all sides.
        materials: Of each shape or of all; white and dull if None.
        background: Color of rays that meet nothing.
        depth: Most times that a ray is mirrored or bent.

    Returns:
        A page that shows sRGB, one ray a pixel, where the light is from 0 to 1.

    Raises:
        ValueError: As of `trace_list_of`.
    """
    shining = lights or [in_world_frame(light, camera) for light in HEADLIGHT]
    told = trace_list_of(scene, camera, shining, materials, background, depth)
    first, _ = told.places["lights"]
    message = {
        **traced_message(told, for_screen=True),
        "orthographic": told.key.orthographic,
        "pivot": _pivot(told.batches, camera),
        "up": upright(camera),
        # A light has two texels; in the first one are its place and its kind.
        "headlight": None if lights else {"place": first + 2, "kind": POINT},
    }
    return html_page("glsl/orbit_page.html", message)


def _pivot(
    batches: list[Batch], camera: PinholeCamera | OrthographicCamera
) -> list[float]:
    """What the camera turns about: in its frame, in front of it."""
    center, radius = balls_of(batches)
    # What is around the camera or has no end has a middle that nobody looks at.
    ahead = (center[:, 2] > 0) & (np.linalg.norm(center, axis=-1) > radius)
    pixel = np.asarray(camera.project(jnp.asarray(center[ahead])))
    size = (camera.width, camera.height)
    inside = ((pixel > -0.5) & (pixel < np.array(size) - 0.5)).all(axis=-1)
    shown = center[ahead][inside]
    if len(shown):
        return ((shown.min(axis=0) + shown.max(axis=0)) / 2).tolist()
    return _seen_in_the_middle(batches, camera)


def _seen_in_the_middle(
    batches: list[Batch], camera: PinholeCamera | OrthographicCamera
) -> list[float]:
    """Point on the middle pixel's ray that is seen there, or a meter away."""
    row, col = (jnp.asarray(size // 2) for size in (camera.height, camera.width))
    dtype = batches[0].primitives.dtype
    ray = camera.rays(row, col, dtype)
    depths = [
        np.asarray(jax.vmap(lambda shape: shape.intersect(ray).t)(batch.primitives))
        for batch in batches
    ]
    nearest = np.concatenate(depths).min()
    point = ray.at(jnp.asarray(nearest if np.isfinite(nearest) else 1.0, dtype))
    return np.asarray(point.stack()).tolist()


def upright(camera: AbstractCamera) -> list[float]:
    """The world's axis nearest to the picture's own upwards, in the camera frame."""
    pose = camera.camera_from_world
    rotation = np.eye(3) if pose is None else np.asarray(pose.rotation)
    upwards = -rotation[1]
    axis = int(np.argmax(np.abs(upwards)))
    return (np.sign(upwards[axis]) * rotation[:, axis]).tolist()
