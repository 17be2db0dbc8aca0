"""A world whose coordinates are large, as those of maps are, seen from near by.

A camera and a shape 500 km from the origin lie on a grid of 3 cm to 0.5 m in single
precision. Where the pose of a camera keeps double precision, both are told from the
camera's place instead, in double precision, before anything is rounded; what is found
is told from the origin again, in double precision, too.
"""

__all__ = ["LocalWorld", "near_its_camera", "seen_near"]

import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from jaxtyping import Float

from impostor_jax.arguments import is_concrete
from impostor_jax.camera.base import AbstractRays, posed
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.primitives.base import AbstractPrimitive, Movable

Placed = TypeVar("Placed", bound=Movable)
Rays = TypeVar("Rays", bound=AbstractRays)
Function = TypeVar("Function", bound=Callable[..., Any])


class LocalWorld(NamedTuple):
    """A frame with the directions of the world's, that begins at a camera.

    Attributes:
        place: Where it begins, in the world, in meters.
    """

    place: Float[np.ndarray, "3"]

    @staticmethod
    def of(cameras: Iterable[Any]) -> "LocalWorld | None":
        """That of the first camera that is far off; None where each is near.

        A pose that is traced, or came in single precision, counts as near: it has no
        digits to keep.
        """
        for camera in cameras:
            pose = (
                camera.camera_from_world if isinstance(camera, AbstractRays) else None
            )
            if pose is not None and pose.is_exact and is_concrete(pose):
                return LocalWorld(np.asarray(pose.inverse().translation, np.float64))
        return None

    @property
    def local_from_world(self) -> RigidTransform:
        """Motion of what is in the world."""
        return RigidTransform(np.eye(3), -self.place)

    @property
    def world_from_local(self) -> RigidTransform:
        """Motion of what was found."""
        return RigidTransform(np.eye(3), self.place)

    def near(self, placed: Placed) -> Placed:
        """Express what has a place in the world from here."""
        # A thing stays what it is; its method cannot say so.
        return cast(Placed, placed.transformed(self.local_from_world))

    def seen_by(self, camera: Rays) -> Rays:
        """The same camera, with its pose in this frame."""
        pose = self.world_from_local
        if camera.camera_from_world is not None:
            pose = camera.camera_from_world @ pose
        return posed(camera, pose)

    def told_in_world(self, shape: AbstractPrimitive) -> AbstractPrimitive:
        """Express a shape, or a batch, that was found here in the world."""
        return shape.transformed(self.world_from_local)


def seen_near(camera: Any, *placed: Any) -> tuple[Any, ...]:
    """A camera and what it sees, both told from the camera's place if that is far off.

    Near the origin they are what they were. What has no place, as the sky, stays.
    """
    world = LocalWorld.of([camera])
    if world is None:
        return camera, *placed
    moved = (world.near(one) if isinstance(one, Movable) else one for one in placed)
    return world.seen_by(camera), *moved


def near_its_camera(function: Function) -> Function:
    """Let a function of what is placed, its camera and more meet both near the origin.

    It is called from outside a program, in which all is rounded.
    """
    signature = inspect.signature(function)
    placed, camera = list(signature.parameters)[:2]

    @functools.wraps(function)
    def called(*args: Any, **kwargs: Any) -> Any:
        given = signature.bind(*args, **kwargs)
        values = given.arguments
        values[camera], values[placed] = seen_near(values[camera], values[placed])
        return function(*given.args, **given.kwargs)

    return cast(Function, called)
