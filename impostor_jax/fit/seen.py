"""An object as an image shows it, on the host: all that a fit is told of one view."""

__all__ = ["Seen", "all_shown_by", "seen_by", "shown_by"]

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.camera.ray_table import (
    RayTable,
    Sight,
    depth_of_ranges,
    has_rays,
    turned_to,
)
from impostor_jax.camera.spherical import SphericalCamera
from impostor_jax.fit.edges import without_edges
from impostor_jax.fit.gather import ray_list, table_of
from impostor_jax.fit.problem import PoseBelief, RayList, Table
from impostor_jax.fit.regions import (
    chosen_pixels,
    most_readings,
    pixel_indices,
    small_holes,
    takes_all,
)
from impostor_jax.sensor.base import AbstractDepthNoise

Indices = Int[np.ndarray, " n"]


class Seen(NamedTuple):
    """An object in an image.

    Attributes:
        image: In meters; 0 where there is no reading.
        region: Pixels of the object, those that miss a reading included.
        camera: That took it.
        noise: Of its readings.
        unsure: Pixels of the object whose readings may be of what it touches: they
            tell where it ends, and not how deep it is; None where all are its own.
        missing: Pixels of the region that the sensor did not read; None without any.
            Of what is left out later it is known that the object is there.
        feet: At pixels beside which an end may be off, as of what it stands on, by how
            many; -1 elsewhere. None where there are none.
        pose: As of `Table`; what it is known to be off by is that of the camera.
    """

    image: Float[np.ndarray, "h w"]
    region: Bool[np.ndarray, "h w"]
    camera: Sight
    noise: AbstractDepthNoise
    unsure: Bool[np.ndarray, "h w"] | None = None
    missing: Bool[np.ndarray, "h w"] | None = None
    feet: Float[np.ndarray, "h w"] | None = None
    pose: PoseBelief | None = None

    @property
    def num_readings(self) -> int:
        """Pixels of the object that hold one."""
        return int(np.count_nonzero(self.image[self.region]))

    def rays(self) -> tuple[Indices, Indices, RayList]:
        """Rows and columns of its pixels, as of `pixel_indices`, and their rays."""
        row, col = pixel_indices(self.region)
        rays = ray_list(self.image, self.camera, row, col, self.noise)
        return row, col, rays

    def is_taken(self, readings: int | None) -> bool:
        """Whether a fit takes all its pixels, with as many `readings` as asked."""
        return takes_all(self.region, most_readings(readings, self.noise))

    def with_doubted_edges(self, pixels: float) -> "Seen":
        """The same where ends are off by so many pixels, as a standard deviation."""
        # With that one, if all within are as likely.
        return self._replace(feet=np.full(self.region.shape, 3**0.5 * pixels))

    def without_holes(self) -> "Seen":
        """The same with its small holes as pixels that miss a reading.

        A silhouette has none, but of what is in front, or said so by mistake: at each
        the object would seem to stop.
        """
        found = small_holes(self.region)
        if not found.any():
            return self
        image = np.where(found, 0, self.image).astype(self.image.dtype)
        return self._replace(image=image, region=self.region | found)

    def without_edges(self) -> "Seen":
        """The same without readings that its noise model does not speak for."""
        seen = self.image, self.region, self.camera, self.noise
        return self._replace(image=without_edges(*seen))


def seen_by(
    image: Float[np.ndarray, "h w"],
    mask: Bool[np.ndarray, "h w"],
    camera: Sight | SphericalCamera,
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
    if isinstance(camera, SphericalCamera):
        direction = _directions(camera)
        sight = RayTable.facing(
            direction,
            turned_to(_middle(direction, mask & (image > 0), mask)),
            _spacing(direction, mask),
            camera.camera_from_world and camera.camera_from_world.inverse(),
        )
        image, camera = depth_of_ranges(image, sight), sight
    region = mask & has_rays(camera)
    missing = region & (image == 0)
    return Seen(
        image, region, camera, noise, missing=missing if missing.any() else None
    )


def _directions(camera: SphericalCamera) -> Float[np.ndarray, "h w 3"]:
    elevation, azimuth = (
        np.asarray(angle, np.float64) for angle in (camera.elevation, camera.azimuth)
    )
    flat = np.cos(elevation)[:, None]
    down = np.broadcast_to(-np.sin(elevation)[:, None], (len(elevation), len(azimuth)))
    return np.stack([flat * np.sin(azimuth), down, flat * np.cos(azimuth)], axis=-1)


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


def shown_by(
    seen: Seen,
    readings: int | None = None,
    correlated: bool = False,
    least: int = 0,
    is_outline: bool = False,
) -> Table:
    """What a fit is given of an object whose edges are left out already.

    Args:
        seen: The object.
        readings: Of an `Effort`.
        correlated: Whether the covariance allows for correlated residuals.
        least: For how many pixels there are places at least.
        is_outline: Whether the region's edge is the silhouette, readings or not.
    """
    most = most_readings(readings, seen.noise)
    image = seen.image
    if seen.unsure is not None:
        image = np.where(seen.unsure, 0, image)
    row, col = pixel_indices(chosen_pixels(image, seen.region, most), most, least)
    table = table_of(
        seen.image,
        seen.region,
        row,
        col,
        seen.camera,
        seen.noise,
        correlated,
        seen.unsure,
        None if is_outline else seen.missing,
        seen.feet,
    )
    return table._replace(pose=seen.pose)


def all_shown_by(
    seen: Sequence[Seen],
    readings: int | None = None,
    correlated: bool = False,
    is_outline: bool = False,
) -> tuple[Table, ...]:
    """The same of an object in several images.

    All have as many places for pixels as the one with the most needs: what is compiled
    knows the number of images, and not the size of each.
    """
    least = 0
    if len(seen) > 1:
        least = max(int(np.count_nonzero(one.region)) for one in seen)
    how = readings, correlated, least, is_outline
    return tuple(shown_by(one, *how) for one in seen)
