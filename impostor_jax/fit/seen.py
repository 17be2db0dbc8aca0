"""An object as an image shows it, on the host: all that a fit is told of one view."""

__all__ = ["Seen", "pixels_shown", "seen_by"]

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.camera.base import AbstractRays
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.ray_table import RayTable, Sight, turned_to
from impostor_jax.fit.problem import Shown
from impostor_jax.fit.regions import pixel_indices, without_edges
from impostor_jax.sensor.base import AbstractDepthNoise


class Seen(NamedTuple):
    """An object in an image.

    Attributes:
        image: In meters; 0 where there is no reading.
        region: Pixels of the object, those that miss a reading included.
        camera: That took it.
        noise: Of its readings.
    """

    image: Float[np.ndarray, "h w"]
    region: Bool[np.ndarray, "h w"]
    camera: Sight
    noise: AbstractDepthNoise


def seen_by(
    image: Float[np.ndarray, "h w"],
    mask: Bool[np.ndarray, "h w"],
    camera: AbstractRays,
    noise: AbstractDepthNoise,
) -> Seen:
    """The object that a mask shows, by rays whose direction has z = 1.

    Of a camera that looks all around, in a frame that looks at the object.

    Args:
        image: Depths; of a camera that looks all around, ranges.
        mask: Pixels of the object.
        camera: Concrete.
        noise: Of the readings.
    """
    if not isinstance(camera, PinholeCamera | RayTable):
        direction = np.asarray(_directions(camera), np.float64)
        sight = RayTable.facing(
            direction,
            turned_to(_middle(direction, mask & (image > 0), mask)),
            _spacing(direction, mask),
            camera.camera_from_world and camera.camera_from_world.inverse(),
        )
        image, camera = sight.depth_of(image), sight
    if isinstance(camera, RayTable):
        mask = mask & np.isfinite(np.asarray(camera.x))
    elif camera.ray_field is not None:
        mask = mask & np.isfinite(np.asarray(camera.ray_field.x))
    return Seen(image, mask, camera, noise)


@jax.jit
def _directions(camera: AbstractRays) -> Float[Array, "h w 3"]:
    row, col = camera.frame.pixels()
    return camera.rays(row, col, jnp.result_type(float)).direction.stack()


def _middle(
    direction: Float[np.ndarray, "h w 3"], *parts: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "3"]:
    """Mean direction of the first part of an image that holds a pixel, or of all."""
    some = next((part for part in parts if part.any()), np.ones_like(parts[0]))
    return direction[some].mean(axis=0)


def _spacing(
    direction: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]
) -> float:
    """Angle between rays of neighboring rows, or columns, of an object: the larger."""
    found = []
    for axis in (0, 1):
        apart = np.linalg.norm(np.diff(direction, axis=axis), axis=-1)
        inside = mask[1:] if axis == 0 else mask[:, 1:]
        found.append(np.median(apart[inside] if inside.any() else apart))
    return float(max(found))


def pixels_shown(seen: Seen, readings: int | None = None) -> Shown:
    """What `fit_from` is given of it.

    Args:
        seen: The object.
        readings: Of an `Effort`.
    """
    image = np.asarray(without_edges(*seen))
    row, col = pixel_indices(seen.region, readings)
    return Shown(image, seen.region, row, col, seen.camera, seen.noise)
