"""A scan as several views: sectors of its columns, each looked at from its middle.

The rays of a sector all meet the plane z = 1 of a frame that is turned to its middle,
as those of a lens do. So it is searched as it is, reading by reading, and nothing is
resampled. Sectors overlap by more than a cylinder is wide, so that each is whole in
one; fits take the scan itself.
"""

__all__ = ["Sector", "sectors_of", "view_of_sector"]

import dataclasses
import math

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.camera.spherical import SphericalCamera
from impostor_jax.find.view import View, sigmas_of, stride_of
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.sensor.base import AbstractDepthNoise

APART = math.radians(60)
"""Angle between the middles of sectors."""

HALF = math.radians(40)
"""Of the angle of a sector: neighbors have 20 degrees in common."""

ROUNDING = 1e-9
"""Of angles in double precision, in radians."""

STEEPEST = math.radians(60)
"""Elevation to which is searched: steeper rays hardly meet the plane z = 1."""


@dataclasses.dataclass(frozen=True)
class Sector:
    """Some columns of a scan.

    Attributes:
        cols: Their numbers, in the order of their azimuths.
        azimuth: Of each, from the middle of the sector, in radians.
        middle: Azimuth of that, in radians.
        width: Number of columns of the scan.
    """

    cols: Int[np.ndarray, " w"]
    azimuth: Float[np.ndarray, " w"]
    middle: float
    width: int

    @property
    def sector_from_camera(self) -> RigidTransform:
        """Into the frame that looks into the middle of the sector."""
        c, s = math.cos(self.middle), math.sin(self.middle)
        return RigidTransform(
            [[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]], (0.0, 0.0, 0.0)
        )

    def of_scan(self, mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h W"]:
        """A mask of the sector, as one of the scan."""
        whole = np.zeros((mask.shape[0], self.width), bool)
        whole[:, self.cols] = mask
        return whole


def sectors_of(camera: SphericalCamera) -> list[Sector]:
    """Sectors that hold all columns of a scan, the leftmost first."""
    azimuth = np.asarray(camera.azimuth, np.float64)
    sectors = []
    for middle in _middles(azimuth.min(), azimuth.max()):
        # Within half a turn of the middle: of a full turn there is no border.
        away = (azimuth - middle + math.pi) % (2 * math.pi) - math.pi
        order = np.argsort(away, kind="stable")
        cols = order[np.abs(away[order]) <= HALF + ROUNDING]
        sectors.append(Sector(cols, away[cols], float(middle), len(azimuth)))
    return sectors


def view_of_sector(
    sector: Sector,
    ranges: Float[np.ndarray, "h W"],
    camera: SphericalCamera,
    noise: AbstractDepthNoise,
    most_pixels: int,
    stride: int = 1,
) -> View:
    """The view of a sector, in its own frame.

    Args:
        sector: Of the scan, of two rows and columns at least.
        ranges: Readings of the scan, in meters; 0 where there is none.
        camera: That took it; concrete.
        noise: Of its readings, along the rays.
        most_pixels: That are searched.
        stride: Of rows and columns; larger where there would be more pixels.
    """
    own = ranges[:, sector.cols]
    stride = stride_of(own.shape, most_pixels, stride)
    e = np.asarray(camera.elevation, np.float64)[::stride, None]
    a = sector.azimuth[None, ::stride]
    forward = np.where(np.abs(e) <= STEEPEST, np.cos(e) * np.cos(a), 0)
    picked = np.where(forward > 0, own[::stride, ::stride], 0).astype(np.float32)
    sigma, grazing = sigmas_of(noise, picked)
    up = np.tan(np.clip(e, -STEEPEST, STEEPEST))
    spacing = [np.abs(np.diff(table)).mean() for table in (e[:, 0], a[0])]
    return View(
        depth=(picked * forward).astype(np.float32),
        x=np.broadcast_to(np.tan(a), picked.shape).astype(np.float32),
        y=(-up / np.cos(a)).astype(np.float32),
        is_central=True,
        sigma=(sigma * forward).astype(np.float32),
        grazing=grazing,
        footprint=float(max(spacing)),
        stride=stride,
    )


def _middles(low: float, high: float) -> Float[np.ndarray, " n"]:
    """Azimuths of the middles of sectors that hold all between two azimuths."""
    span, shared = high - low, 2 * HALF - APART
    if 2 * math.pi - span < shared:
        count = round(2 * math.pi / APART)
        return low + (np.arange(count) + 0.5) * APART
    if span <= 2 * HALF:
        return np.array([(low + high) / 2])
    count = 1 + math.ceil((span - 2 * HALF) / APART - ROUNDING)
    return np.linspace(low + HALF, high - HALF, count)
