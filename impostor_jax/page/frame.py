"""The frame of a page: that of the first camera, moved to what is looked at.

There the numbers are small, so that single precision, which shaders have, is enough
wherever the world has its origin.
"""

__all__ = ["PageFrame", "frame_around", "page_frame", "pose_of"]

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from impostor_jax.arguments import is_exact
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.glsl.batches import Batch, balls_of, batches_in_camera
from impostor_jax.page.readings import points_of
from impostor_jax.page.shown import ImageView, Shown
from impostor_jax.primitives.base import AbstractPrimitive


@dataclasses.dataclass(frozen=True)
class PageFrame:
    """Where on a page the world is: x right, y down, z forward, as the first camera.

    Attributes:
        rotation: `page_from_world`.
        translation: In meters.
        radius: Of the ball around the origin that holds what is looked at, in meters.
    """

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]
    radius: float

    def apply(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Map points of the world."""
        return self.turned(points) + self.translation

    def turned(self, vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Map directions of the world."""
        return vectors @ self.rotation.T

    def from_camera(
        self, points: Float[np.ndarray, "*n 3"], camera: AbstractCamera
    ) -> Float[np.ndarray, "*n 3"]:
        """Map points of a camera's frame."""
        rotation, translation = pose_of(camera)
        return self.apply((points - translation) @ rotation)

    def batch(self, shape: AbstractPrimitive) -> Batch:
        """A shape of the world as the shaders take it, in this frame."""
        (batch,) = batches_in_camera(_single(shape), _looking(self))
        return batch


def page_frame(shown: Sequence[Shown], views: Sequence[ImageView]) -> PageFrame:
    """The frame in which the shapes, or else the readings of failed fits, are central.

    Args:
        shown: The fits.
        views: Their images; at least one.
    """
    rotation, translation = pose_of(views[0].camera)
    as_camera = PageFrame(rotation, translation, 0.0)
    batches = [as_camera.batch(one.fit.shape) for one in shown if one.fit.is_shape]
    if batches:
        centers, radii = balls_of(batches)
    else:
        centers = np.concatenate([_looked_at(view, as_camera) for view in views])
        radii = np.zeros(len(centers))
    return _around(rotation, translation, centers, radii)


def frame_around(
    camera: AbstractCamera,
    centers: Float[np.ndarray, "n 3"],
    radii: Float[np.ndarray, " n"],
) -> PageFrame:
    """The frame in which some balls of the world are central.

    Args:
        camera: The first one.
        centers: In meters; at least one.
        radii: In meters.
    """
    rotation, translation = pose_of(camera)
    in_camera = centers @ rotation.T + translation
    return _around(rotation, translation, in_camera, radii)


def _around(
    rotation: Float[np.ndarray, "3 3"],
    translation: Float[np.ndarray, "3"],
    centers: Float[np.ndarray, "n 3"],
    radii: Float[np.ndarray, " n"],
) -> PageFrame:
    """The frame of balls whose centers are told in that of a camera."""
    low = np.min(centers - radii[:, None], axis=0)
    high = np.max(centers + radii[:, None], axis=0)
    middle = (low + high) / 2
    reach = np.linalg.norm(centers - middle, axis=-1) + radii
    return PageFrame(rotation, translation - middle, float(reach.max()) or 1.0)


def _looked_at(view: ImageView, frame: PageFrame) -> Float[np.ndarray, "n 3"]:
    """Ends of the box that holds most readings of the fits, or of the whole image."""
    for seen in (view.owner >= 0, view.depth > 0):
        if seen.any():
            rows, cols = np.nonzero(seen)
            points = frame.from_camera(points_of(view, rows, cols), view.camera)
            return np.percentile(points, (5, 95), axis=0)
    return np.array([[0.0, 0.0, 1.0]])


def pose_of(
    camera: AbstractCamera,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Rotation and translation of `camera_from_world`."""
    move = camera.camera_from_world
    if move is None:
        return np.eye(3), np.zeros(3)
    return np.asarray(move.rotation, float), np.asarray(move.translation, float)


def _single(shape: AbstractPrimitive) -> AbstractPrimitive:
    """A shape in the default precision, whichever it was fitted in."""
    default = jnp.result_type(float)

    def converted(x: Any) -> Any:
        # What lies far off keeps its digits until it is told from near.
        return x if is_exact(x) else jnp.asarray(np.asarray(x), default)

    return jax.tree.map(converted, shape)


def _looking(frame: PageFrame) -> PinholeCamera:
    """A camera in whose frame is what a page shows; nothing else of it counts."""
    pose = RigidTransform(frame.rotation, frame.translation)
    return PinholeCamera(1.0, 1.0, 0.0, 0.0, 1, 1, camera_from_world=pose)
