"""Rays that are told one by one: of a scanner's image, or of single points.

A fit compares depths along rays whose direction has z = 1. A scanner looks all around;
what it sees of one object is the image of these rays in a frame that looks there, and
what it measures along them is a depth of that frame.
"""

__all__ = [
    "RayTable",
    "Sight",
    "depth_of_ranges",
    "directions_of",
    "has_rays",
    "shows_image",
    "turned_to",
]

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from impostor_jax.camera.base import AbstractRays, not_accepted
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.pixels import Pixels
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Scalar

STEEPEST = 0.1
"""Cosine of the angle to the frame's z axis beyond which no ray is looked at: its depth
would be a small part of its range."""

LEAST_MEAN = 1e-3
"""Length of the mean of unit vectors from which it has a direction."""

Table = Float[np.ndarray, "h w"] | Float[Array, "h w"]


class RayTable(AbstractRays):
    """A ray for each pixel of an image, in a frame that looks along z.

    Attributes:
        x: Of the directions, with z = 1; not finite where there is none.
        y: Likewise.
        start: Where the rays begin, in meters; None where all begin at the origin.
        spacing: Distance of neighboring rays at a depth of 1.
        camera_from_world: Pose of the frame.
        width: Number of columns.
        height: Number of rows.
        is_image: Whether pixels side by side see places side by side; of points in any
            order they do not.
    """

    x: Table
    y: Table
    start: Float[np.ndarray, "h w 3"] | Float[Array, "h w 3"] | None
    spacing: Scalar
    camera_from_world: RigidTransform | None
    width: int = eqx.field(static=True)
    height: int = eqx.field(static=True)
    is_image: bool = eqx.field(static=True)

    @staticmethod
    def facing(
        direction: Float[np.ndarray, "h w 3"],
        rotation: Float[np.ndarray, "3 3"],
        spacing: float,
        world_from_source: RigidTransform | None = None,
        start: Float[np.ndarray, "h w 3"] | None = None,
        is_image: bool = True,
    ) -> "RayTable":
        """Rays of another frame in one that is turned to where they look.

        Args:
            direction: Of any length, in the frame that they are told in; zero where
                there is none.
            rotation: From that frame to the one that looks along z.
            spacing: Angle between neighboring rays, in radians.
            world_from_source: Pose of the frame that they are told in.
            start: Where they begin, in that frame; None for its origin.
            is_image: As of the class.
        """
        turned = direction @ rotation.T
        length = np.linalg.norm(turned, axis=-1)
        ahead = turned[..., 2] > STEEPEST * length
        z = np.where(ahead, turned[..., 2], 1)
        x, y = (np.where(ahead, turned[..., k] / z, np.inf) for k in (0, 1))
        dtype = np.dtype(jnp.result_type(float))
        pose = RigidTransform(rotation, np.zeros(3))
        if world_from_source is not None:
            pose = pose @ world_from_source.inverse()
        return RayTable(
            x=x.astype(dtype),
            y=y.astype(dtype),
            start=None if start is None else (start @ rotation.T).astype(dtype),
            spacing=jnp.asarray(spacing, dtype),
            camera_from_world=pose,
            width=x.shape[1],
            height=x.shape[0],
            is_image=is_image,
        )

    @property
    @override
    def is_central(self) -> bool:
        return self.start is None

    @override
    def rays(self, row: Pixels, col: Pixels, dtype: DTypeLike) -> Ray:
        x, y = (jnp.asarray(part)[row, col].astype(dtype) for part in (self.x, self.y))
        x, y = (jnp.where(jnp.isfinite(part), part, 0) for part in (x, y))
        zero = jnp.zeros_like(x)
        origin = Vec3(zero, zero, zero)
        if self.start is not None:
            origin = Vec3.from_array(jnp.asarray(self.start)[row, col].astype(dtype))
        return Ray(origin, Vec3(x, y, jnp.ones_like(x)))

    @override
    def sees(self, row: Pixels, col: Pixels) -> Bool[Array, "*batch"] | None:
        return jnp.isfinite(jnp.asarray(self.x)[row, col])


Sight = PinholeCamera | RayTable
"""What a fit sees an object by: rays whose direction has z = 1."""


def directions_of(
    camera: Sight,
    row: Int[np.ndarray, "*batch"],
    col: Int[np.ndarray, "*batch"],
    dtype: DTypeLike,
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """Directions (x, y, 1) of a concrete camera's rays, without a device.

    0 where a pixel has no ray.
    """
    solved = camera if isinstance(camera, RayTable) else camera.ray_field
    if solved is not None:
        x, y = (np.asarray(part)[row, col] for part in (solved.x, solved.y))
        seen = np.isfinite(x)
        x, y = np.where(seen, x, 0), np.where(seen, y, 0)
    else:
        assert isinstance(camera, PinholeCamera)
        numbers = camera.fx, camera.fy, camera.cx, camera.cy
        fx, fy, cx, cy = (np.asarray(number, dtype) for number in numbers)
        x, y = (col.astype(dtype) - cx) / fx, (row.astype(dtype) - cy) / fy
    return x.astype(dtype), y.astype(dtype)


def shows_image(camera: Sight) -> bool:
    """Whether readings were chosen by their rays; points in any order were not."""
    return not isinstance(camera, RayTable) or camera.is_image


def has_rays(camera: Sight) -> Bool[np.ndarray, "#h #w"]:
    """Which pixels of a concrete camera have a ray, without a device.

    Of one place where all of them have.
    """
    solved = camera if isinstance(camera, RayTable) else camera.ray_field
    if solved is None:
        return np.ones((1, 1), bool)
    return np.isfinite(np.asarray(solved.x))


def depth_of_ranges(ranges: Any, camera: Any) -> Float[np.ndarray, "h w"]:
    """Planar depth of distances along the rays, as some simulators write them.

        depth = ij.depth_of_ranges(distances, camera)

    Args:
        ranges: (H, W), from the camera's center, in meters; 0 and what is not finite
            mean no reading.
        camera: Pinhole, with or without a lens.

    Returns:
        (H, W), in meters; 0 where there is no reading or no ray.

    Raises:
        ValueError: The camera is another, or the image has another shape than its own.
    """
    if not isinstance(camera, Sight):
        raise ValueError(f"camera must be a PinholeCamera, got {not_accepted(camera)}")
    given = np.asarray(ranges)
    if given.shape != (camera.height, camera.width):
        raise ValueError(
            f"ranges must have shape {(camera.height, camera.width)}, the camera's, "
            f"got {given.shape}"
        )
    dtype = given.dtype if np.issubdtype(given.dtype, np.floating) else np.float64
    row, col = np.meshgrid(*map(np.arange, given.shape), indexing="ij")
    x, y = directions_of(camera, row, col, np.dtype(dtype))
    read = np.isfinite(given) & has_rays(camera)
    return np.where(read, given, 0) / np.sqrt(1 + x * x + y * y)


def turned_to(direction: Float[np.ndarray, "*batch 3"]) -> np.ndarray:
    """Rotations (*batch, 3, 3) to frames whose z axis is along a direction.

    Any will do for what has none, as the mean of directions all around.
    """
    length = np.linalg.norm(direction, axis=-1, keepdims=True)
    is_known = length > LEAST_MEAN
    z = np.where(is_known, direction / np.where(is_known, length, 1), np.eye(3)[2])
    # Whichever of two axes is more across it.
    is_x = np.abs(z[..., :1]) < np.abs(z[..., 1:2])
    across = np.where(is_x, np.eye(3)[0], np.eye(3)[1])
    x = across - z * np.sum(z * across, axis=-1, keepdims=True)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    # `np.cross` takes most of the time of a single one.
    (a, b, c), (d, e, f) = (np.moveaxis(one, -1, 0) for one in (z, x))
    y = np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=-1)
    return np.stack([x, y, z], axis=-2)
