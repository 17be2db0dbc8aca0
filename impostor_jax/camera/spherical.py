"""Spherical camera: the range image of a laser scanner that turns.

Each row has an elevation and each column an azimuth. The beams of a scanner are not
evenly apart, so both are tables and not intrinsics.
"""

__all__ = ["SphericalCamera"]

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.arguments import float_array, image_size, is_concrete, real_number
from impostor_jax.camera.base import AbstractCamera, Projection
from impostor_jax.camera.pixels import PixelBox, Pixels, first_and_last
from impostor_jax.geometry.frames import Points, RigidTransform
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import has_square, safe_norm

TURN = 2 * math.pi

FULL_TURN = TURN * (1 + 1e-6)
"""Largest span of a table of azimuths: a turn, rounded as single precision rounds."""

Table = Float[np.ndarray, " n"] | Float[Array, " n"]
"""Angles in radians, one for each row or for each column."""


class SphericalCamera(AbstractCamera):
    """Scanner at the origin of the camera frame: x right, y down, z forward.

    The pixel of elevation e and azimuth a looks along

        (cos e sin a, -sin e, cos e cos a),

    so azimuth 0 is forward and grows to the right, and elevation is positive upward. It
    sees all around: also what lies behind, z < 0.

    These directions have length 1. What maps, depth images and noise models call depth
    is therefore, for this camera alone, the range: the distance along the ray, and not
    z. `GeometryMaps.depth` and `GeometryMaps.range` are the same.

    It renders and draws readings. Coverage, samples in a pixel and signed distances
    need a `PinholeCamera`.

    Args:
        elevation: (H,), of each row, in radians from -pi/2 to pi/2, strictly rising or
            strictly falling; the spacing is free. May be traced.
        azimuth: (W,), of each column, in radians, likewise. They span one full turn at
            most, and may start anywhere.
        camera_from_world: Pose, a `RigidTransform` or a (4, 4) matrix; None where the
            camera frame is the world frame.

    Raises:
        ValueError: A table has another shape, is not monotonic, or is out of range.
    """

    elevation: Float[np.ndarray, " h"] | Float[Array, " h"]
    azimuth: Float[np.ndarray, " w"] | Float[Array, " w"]
    width: int = eqx.field(static=True)
    height: int = eqx.field(static=True)
    camera_from_world: RigidTransform | None

    def __init__(self, elevation: Any, azimuth: Any, camera_from_world: Any = None):
        self.elevation = _table("elevation", elevation)
        self.azimuth = _table("azimuth", azimuth)
        self.width, self.height = image_size(len(self.azimuth), len(self.elevation))
        self.camera_from_world = RigidTransform.of(camera_from_world)
        if is_concrete(self.elevation):
            steepest = np.abs(self.elevation).max()
            # A quarter turn, rounded up as single precision rounds.
            if steepest > FULL_TURN / 4:
                raise ValueError(
                    "elevation must be from -pi/2 to pi/2 radians, got "
                    f"{steepest:.6g} in size"
                )
        if is_concrete(self.azimuth):
            span = abs(self.azimuth[-1] - self.azimuth[0])
            if span > FULL_TURN:
                raise ValueError(
                    "azimuth must span one turn, 2 pi radians, at most, got "
                    f"{span:.6g} radians"
                )

    @staticmethod
    def regular(
        width: Any,
        height: Any,
        fov_up: Any,
        fov_down: Any,
        camera_from_world: Any = None,
    ) -> "SphericalCamera":
        """Scanner whose rows are evenly apart, and whose columns make a full turn.

        The middle between the two middle columns looks forward.

        Args:
            width: Number of columns, in one turn.
            height: Number of rows.
            fov_up: Elevation of the topmost row, in radians.
            fov_down: Elevation of the lowest row, in radians, below `fov_up`.
            camera_from_world: Pose, as of the class.

        Raises:
            ValueError: A value is out of range.
        """
        width, height = image_size(width, height)
        ends = real_number("fov_up", fov_up), real_number("fov_down", fov_down)
        if is_concrete(ends) and ends[0] <= ends[1]:
            raise ValueError(
                f"fov_up must be above fov_down, {ends[1]} radians, got {ends[0]}"
            )
        linspace = np.linspace if is_concrete(ends) else jnp.linspace
        return SphericalCamera(
            linspace(*ends, height), _columns_of_a_turn(width), camera_from_world
        )

    @staticmethod
    def of_beams(
        elevation_deg: Any, width: Any, camera_from_world: Any = None
    ) -> "SphericalCamera":
        """Scanner of several beams, as its manual lists them, and a full turn.

        Args:
            elevation_deg: Elevation of each beam in degrees, strictly rising or falling
                (a manual may list them in the order in which they fire: sort them).
            width: Number of columns, in one turn; the middle looks forward.
            camera_from_world: Pose, as of the class.

        Raises:
            ValueError: A value is out of range.
        """
        beams = _table("elevation_deg", elevation_deg, "degrees")
        width, _ = image_size(width, 1)
        return SphericalCamera(
            beams * (math.pi / 180), _columns_of_a_turn(width), camera_from_world
        )

    @property
    @override
    def projection(self) -> Projection:
        return "spherical"

    @override
    def rays(self, row: Pixels, col: Pixels, dtype: DTypeLike) -> Ray:
        # Sines of the tables, not of the pixels: a few thousand, not a million.
        e, a = (jnp.asarray(x, dtype) for x in (self.elevation, self.azimuth))
        sin_e, cos_e = jnp.sin(e)[row], jnp.cos(e)[row]
        sin_a, cos_a = jnp.sin(a)[col], jnp.cos(a)[col]
        zero = jnp.zeros_like(sin_e)
        return Ray(
            origin=Vec3(zero, zero, zero),
            direction=Vec3(cos_e * sin_a, -sin_e, cos_e * cos_a),
        )

    @override
    def shifted(
        self, cols: Float[Array, ""], rows: Float[Array, ""]
    ) -> "SphericalCamera":
        raise ValueError(
            "effort must have samples of 1 for a SphericalCamera, whose rays are known "
            "through the centers of pixels alone: between its beams there is nothing"
        )

    @override
    def strided(self, stride: int) -> "SphericalCamera":
        return SphericalCamera(
            self.elevation[::stride], self.azimuth[::stride], self.camera_from_world
        )

    @override
    def sees(self, row: Pixels, col: Pixels) -> Bool[Array, "*batch"] | None:
        return None

    @override
    def pixel_box(self, low: Float[Array, "2"], high: Float[Array, "2"]) -> PixelBox:
        e, a = (jnp.asarray(x, low.dtype) for x in (self.elevation, self.azimuth))
        # Into [-pi, pi], as azimuths of directions are.
        a = jnp.arctan2(jnp.sin(a), jnp.cos(a))
        return PixelBox(
            *first_and_last((e >= low[1]) & (e <= high[1])),
            *first_and_last((a >= low[0]) & (a <= high[0])),
        )

    @override
    def project(self, points: Points) -> Float[Array, "*batch 2"]:
        """Image coordinates (u, v), in pixels, of points of the camera frame.

        Between rows, and between columns, in proportion to the angle; beyond the first
        and the last, as between the two next to them. A single row, or column, counts
        one radian a pixel, upward or to the right. Azimuths are taken within half a
        turn of the middle of the table, so that u of a full turn is from -0.5 to
        width - 0.5.

        Derivatives:
            0 in u for points straight above or below, whose azimuth counts as 0.
        """
        points = jnp.asarray(points)
        x, y, z = (points[..., k] for k in range(3))
        across = safe_norm(points[..., ::2])
        # Their squares divide the derivatives of the angles.
        a = jnp.arctan2(x, jnp.where(has_square(across), z, 1))
        e = jnp.arctan2(-y, jnp.where(has_square(safe_norm(points)), across, 1))
        azimuth, elevation = (
            jnp.asarray(table, points.dtype) for table in (self.azimuth, self.elevation)
        )
        middle = (azimuth[0] + azimuth[-1]) / 2
        a = a - TURN * jnp.round((a - middle) / TURN)
        return jnp.stack([_place_in(azimuth, a), _place_in(elevation, e)], axis=-1)


def _table(name: str, value: Any, unit: str = "radians") -> Table:
    """Angles that rise or fall strictly, in double precision where they are known."""
    array = float_array(name, value, (None,), unit)
    if array.ndim != 1 or not len(array):
        raise ValueError(f"{name} must be {unit} of shape (n,), got {array.shape}")
    if not is_concrete(value):
        return array
    # As Python's numbers of other cameras: they take the precision of what they meet.
    angles = np.asarray(value, np.float64)
    steps = np.diff(angles)
    if not ((steps > 0).all() or (steps < 0).all()):
        raise ValueError(f"{name} must rise strictly or fall strictly, got {angles}")
    return angles


def _columns_of_a_turn(width: int) -> Float[np.ndarray, " w"]:
    """Azimuths of evenly spaced columns, symmetric about the direction forward."""
    return ((np.arange(width) + 0.5) / width - 0.5) * TURN


def _place_in(
    table: Float[Array, " n"], angle: Float[Array, "*batch"]
) -> Float[Array, "*batch"]:
    """Where an angle lies in a table, counted from its first entry."""
    if len(table) == 1:
        return angle - table[0]
    sign = jnp.sign(table[-1] - table[0])
    number = jnp.arange(len(table), dtype=table.dtype)
    return jnp.interp(
        sign * angle, sign * table, number, left="extrapolate", right="extrapolate"
    )
