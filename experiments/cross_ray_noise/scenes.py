"""Round walls that are read along rays which are not quite those that are known.

Nothing here is drawn by the package: rays are displaced, and meet the wall by a formula
of this file.
"""

__all__ = ["KINDS", "READERS", "SIZES", "Errors", "Wall", "across", "draw_wall"]

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij


@dataclasses.dataclass(frozen=True)
class Errors:
    """What the readings of a wall err by.

    Attributes:
        along: Standard deviation along the ray, in meters.
        across: Of a ray's place, along each of two directions, in meters.
        angle: Of a ray's direction, likewise, in radians.
        grid: To which coordinates are rounded, in meters; 0 if they are not.
    """

    along: float
    across: float = 0.0
    angle: float = 0.0
    grid: float = 0.0

    def told(self) -> ij.ConstantNoise:
        """The noise model of one who knows them; a file shows its grid by itself."""
        return ij.ConstantNoise(self.along, across=self.across, angle=self.angle)


@dataclasses.dataclass(frozen=True)
class Setting:
    """A wall and the sensor that reads it.

    Attributes:
        radius: Of the wall, in meters.
        distance: Of its axis, in meters.
        height: Of the part that is read, in meters.
    """

    radius: float
    distance: float
    height: float


STEM = Setting(0.18, 10.0, 2.5)
PIPE = Setting(0.04, 0.5, 0.4)

READERS = {"points": STEM, "scan": STEM, "image": PIPE}
"""Points of a stem, a range image of it, and a depth image of a pipe."""

SIZES = {
    "points": {"small": 1000, "large": 4000},
    "scan": {"small": 0.2, "large": 0.1},
    "image": {"small": (80, 60), "large": (160, 120)},
}
"""Number of points, degrees between rows and columns, width and height: of the wall
about 600 to 1000 readings, and 2500 to 4000."""

_OF_STEM = {
    "exact": Errors(0.003),
    "beam of 0.05 mrad": Errors(0.003, angle=5e-5),
    "0.3 mm across": Errors(0.003, across=0.0003),
    "all directions": Errors(0.003, across=0.003),
}
KINDS = {
    "points": {**_OF_STEM, "grid of 1 mm": Errors(0.003, grid=0.001)},
    "scan": _OF_STEM,
    "image": {
        "exact": Errors(0.001),
        "beam of 1 mrad": Errors(0.001, angle=1e-3),
        "0.1 mm across": Errors(0.001, across=0.0001),
        "all directions": Errors(0.001, across=0.001),
    },
}
"""What readings of each reader err by."""

MOST_TILTED = np.radians(10.0)
"""Of the axis against the vertical, towards the sensor and across."""


@dataclasses.dataclass(frozen=True)
class Wall:
    """A wall, and what was read of it by a sensor at the origin.

    Attributes:
        center: A point of the axis, in meters.
        axis: Unit vector.
        radius: In meters.
        points: The readings.
        errors: What they err by.
        depth: The same as an image, in meters; None of points.
        camera: That took it.
        mask: Pixels whose known rays meet the wall.
    """

    center: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float
    points: Float[np.ndarray, "n 3"]
    errors: Errors
    depth: Float[np.ndarray, "h w"] | None = None
    camera: ij.PinholeCamera | ij.SphericalCamera | None = None
    mask: Bool[np.ndarray, "h w"] | None = None


def draw_wall(reader: str, size: str, kind: str, rng: np.random.Generator) -> Wall:
    """A wall somewhere before the sensor, and what the reader reads of it.

    Args:
        reader: Of `READERS`.
        size: Of its `SIZES`.
        kind: Of its `KINDS`.
        rng: Source of all that is drawn.
    """
    setting, errors = READERS[reader], KINDS[reader][kind]
    center = np.array([0, 0, setting.distance])
    center = center + setting.radius * rng.uniform(-0.2, 0.2, 3)
    axis = np.array([0, 1, 0]) + [1, 0, 1] * np.tan(
        rng.uniform(-MOST_TILTED, MOST_TILTED, 3)
    )
    axis /= np.linalg.norm(axis)
    place = (center, axis, setting.radius)
    if reader == "points":
        points = _points(place, setting.height, SIZES[reader][size], errors, rng)
        return Wall(*place, points, errors)
    camera = _camera(reader, size, setting)
    row, col = camera.frame.pixels()
    directions = np.asarray(camera.rays(row, col, jnp.float32).direction.stack(), float)
    mask = np.isfinite(_met(place, np.zeros_like(directions), directions))
    moved = _moved(directions, mask, errors, rng)
    t = _met(place, *moved) + rng.normal(0, errors.along, mask.shape)
    depth = np.where(mask & np.isfinite(t), t, 0).astype(np.float32)
    points = (depth[..., None] * directions)[depth > 0]
    return Wall(*place, points, errors, depth, camera, mask)


def _camera(
    reader: str, size: str, setting: Setting
) -> ij.PinholeCamera | ij.SphericalCamera:
    """One whose image the wall crosses from the upper to the lower end."""
    if reader == "image":
        width, height = SIZES[reader][size]
        focal = 1.25 * width
        center = ((width - 1) / 2, (height - 1) / 2)
        return ij.PinholeCamera(focal, focal, *center, width, height)
    step = np.radians(SIZES[reader][size])
    high, wide = (
        np.arctan2(half, setting.distance)
        for half in (setting.height / 2, 2 * setting.radius)
    )
    return ij.SphericalCamera(
        np.arange(-high, high, step), np.arange(-wide, wide, step)
    )


def _points(
    place: tuple, height: float, count: int, errors: Errors, rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """Points evenly spread over the side of a wall that faces the origin, moved."""
    center, axis, radius = place
    one, two = across(axis)
    turn = rng.uniform(0, 2 * np.pi, (4 * count, 1))
    normal = np.cos(turn) * one + np.sin(turn) * two
    up = rng.uniform(-height / 2, height / 2, (4 * count, 1))
    points = center + radius * normal + up * axis
    points = points[np.sum(points * normal, axis=1) < 0][:count]
    far = np.linalg.norm(points, axis=1, keepdims=True)
    unit = points / far
    error = np.hypot(errors.across, errors.angle * far)
    for direction in across(unit):
        points = points + direction * error * rng.normal(size=far.shape)
    points = points + unit * rng.normal(0, errors.along, far.shape)
    return np.round(points / errors.grid) * errors.grid if errors.grid else points


def _moved(
    directions: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    errors: Errors,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w 3"]]:
    """Origins and directions of the rays that were read."""
    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    start, turn = np.zeros_like(directions), np.zeros_like(directions)
    for direction in across(unit):
        start += direction * rng.normal(0, 1, (*mask.shape, 1)) * errors.across
        turn += direction * rng.normal(0, 1, (*mask.shape, 1)) * errors.angle
    return start, directions + turn


def across(
    unit: Float[np.ndarray, "*batch 3"],
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
    """Two unit vectors across others."""
    one = np.cross(unit, (0.3, 0.2, -0.1))
    one /= np.linalg.norm(one, axis=-1, keepdims=True)
    return one, np.cross(unit, one)


def _met(
    place: tuple,
    start: Float[np.ndarray, "h w 3"],
    direction: Float[np.ndarray, "h w 3"],
) -> Float[np.ndarray, "h w"]:
    """How many of their directions rays go to an endless wall; NaN where they miss."""
    center, axis, radius = place
    away, along = (
        x - (x @ axis)[..., None] * axis for x in (start - center, direction)
    )
    a, b = np.sum(along * along, -1), np.sum(along * away, -1)
    c = np.sum(away * away, -1) - radius**2
    with np.errstate(invalid="ignore"):
        return (-b - np.sqrt(b * b - a * c)) / a
