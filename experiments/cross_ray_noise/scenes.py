"""Round walls read along rays that err, by formulas of their own.

A true ray lies beside the one that a reading is told by, and is cast at the cylinder:
nothing here knows how a fit compares readings.
"""

__all__ = ["CASES", "Case", "Reading", "points_of", "read"]

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3

CAN_NOISE, STEM_NOISE = 0.001, 0.003
"""Along the ray, in meters: of images of a can, and of scans and points of stems."""

SCANNER_HEIGHT = 1.7
"""In meters."""

STEP = np.radians(0.05)
"""Between neighboring rows and columns of a scan."""

SEEN_LENGTH = 3.0
"""Of a stem, in meters."""

POINTS = 6000
"""Drawn evenly over a stem, of which the half that faces the scanner is seen."""


@dataclasses.dataclass(frozen=True)
class Case:
    """What errs, and of what.

    Attributes:
        source: "image" of a can, "scan" of a stem, or "points" evenly spread over one.
        kind: What errs, in words without spaces.
        radius: In meters.
        across: Standard deviation of a ray's place, in meters.
        angle: Of its direction, in radians.
        grid: Step to which coordinates are rounded, in meters.
        normal: Standard deviation along the normal, in place of that along the ray.
    """

    source: str
    kind: str
    radius: float
    across: float = 0.0
    angle: float = 0.0
    grid: float = 0.0
    normal: float = 0.0

    @property
    def label(self) -> str:
        """For a table."""
        return f"{self.source}.{2e3 * self.radius:.0f}mm.{self.kind}"

    @property
    def noise(self) -> float:
        """Standard deviation along the ray, in meters."""
        return CAN_NOISE if self.source == "image" else STEM_NOISE

    @property
    def told(self) -> dict[str, float] | None:
        """What a noise model is told of it; None where that has no word for it."""
        if self.grid or self.normal:
            return None
        return {"across": self.across, "angle": self.angle}


class Reading(NamedTuple):
    """What a sensor reads of a cylinder.

    Attributes:
        truth: The cylinder.
        points: (N, 3), in the frame of the origin.
        origin: Where the sensor stands.
        depth: The image, or None of points.
        mask: Of the cylinder: pixels whose known rays meet it.
        camera: Of the image.
    """

    truth: ij.Cylinder
    points: Float[np.ndarray, "n 3"]
    origin: Float[np.ndarray, "3"]
    depth: Float[np.ndarray, "h w"] | None = None
    mask: Bool[np.ndarray, "h w"] | None = None
    camera: AbstractCamera | None = None


def _cases() -> list[Case]:
    found = []
    for radius in (0.02, 0.04):
        found += [
            Case("image", "exact", radius),
            Case("image", "place_0.2mm", radius, across=0.0002),
            Case("image", "place_0.5mm", radius, across=0.0005),
            Case("image", "beam_1mrad", radius, angle=0.001),
        ]
    for radius in (0.05, 0.18):
        found += [
            Case("scan", "exact", radius),
            Case("scan", "beam_0.05mrad", radius, angle=5e-5),
            Case("scan", "beam_0.3mrad", radius, angle=3e-4),
            Case("scan", "place_3mm", radius, across=0.003),
        ]
    for radius in (0.05, 0.18):
        found += [
            Case("points", "exact", radius),
            Case("points", "grid_0.25mm", radius, grid=0.00025),
            Case("points", "grid_1mm", radius, grid=0.001),
            Case("points", "grid_10mm", radius, grid=0.01),
            Case("points", "beam_0.05mrad", radius, angle=5e-5),
            Case("points", "place_3mm", radius, across=0.003),
            Case("points", "normal_3mm", radius, normal=0.003),
        ]
    return found


CASES = _cases()
"""Of each source two sizes."""


def read(case: Case, rng: np.random.Generator) -> Reading:
    """Draw what a sensor reads."""
    if case.source == "points":
        return points_of(case, rng)
    return _image_of(case, rng)


def points_of(case: Case, rng: np.random.Generator) -> Reading:
    """Points of a stem 10 m from the scanner, as many on each part of its wall."""
    origin = np.array([0.0, 0.0, SCANNER_HEIGHT])
    center, axis = np.array([4.0, 9.0, 1.5]), np.array([0.03, -0.02, 1.0])
    truth = ij.Cylinder(center, axis, case.radius, SEEN_LENGTH)
    axis /= np.linalg.norm(axis)
    normal = np.cross(axis, rng.normal(size=(POINTS, 3)))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = rng.uniform(-SEEN_LENGTH / 2, SEEN_LENGTH / 2, (POINTS, 1)) * axis
    points = center + along + case.radius * normal
    seen = np.sum(normal * (origin - points), axis=1) > 0
    points, normal = points[seen], normal[seen]
    ray = points - origin
    far = np.linalg.norm(ray, axis=1, keepdims=True)
    ray /= far
    if case.normal:
        points = points + normal * rng.normal(0, case.normal, far.shape)
    else:
        points = points + ray * rng.normal(0, case.noise, far.shape)
    error = np.hypot(case.across, case.angle * far)
    for side in _sides(ray):
        points = points + side * error * rng.normal(size=far.shape)
    if case.grid:
        points = np.round(points / case.grid) * case.grid
    return Reading(truth, points, origin)


def _image_of(case: Case, rng: np.random.Generator) -> Reading:
    if case.source == "image":
        camera = ij.PinholeCamera(525.0, 525.0, 159.5, 119.5, width=320, height=240)
        truth = ij.Cylinder((0, 0, 0.8), (0.3, 0.8, 0.52), case.radius, 0.12)
    else:
        half = np.arctan2(1.3 * case.radius + 0.1, 10.0)
        rows = np.arange(np.arctan2(1.3, 10), np.arctan2(-1.3, 10), -STEP)
        camera = ij.SphericalCamera(rows, np.arange(-half, half, STEP))
        truth = ij.Cylinder((0, 0.2, 10.0), (0.03, 1.0, -0.02), case.radius, 14.0)
    row, col = np.mgrid[: camera.height, : camera.width]
    rays = camera.rays(jnp.asarray(row), jnp.asarray(col), jnp.float32)
    direction = np.asarray(rays.direction.stack(), np.float64)
    unit = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    distance = float(np.linalg.norm(np.asarray(truth.center)))
    start, turned = np.zeros_like(unit), unit
    for side in _sides(unit):
        draws = rng.normal(size=(2, *row.shape, 1))
        start = start + case.across * draws[0] * side
        turned = turned + case.angle * draws[1] * side
    mask, far = np.isfinite(_cast(truth, 0 * unit, unit)), _cast(truth, start, turned)
    far = far + rng.normal(0, case.noise, far.shape)
    seen = mask & np.isfinite(far) & (far < 2 * distance)
    far = np.where(seen, far, 0)
    points = far[..., None] * unit
    depth = far if case.source == "scan" else points[..., 2]
    origin = np.zeros(3)
    return Reading(truth, points[seen], origin, depth.astype(np.float32), mask, camera)


def _cast(
    shape: ij.Cylinder,
    start: Float[np.ndarray, "h w 3"],
    direction: Float[np.ndarray, "h w 3"],
) -> Float[np.ndarray, "h w"]:
    """Distances along rays, infinite where they miss."""
    parts = (Vec3.from_array(jnp.asarray(x, float)) for x in (start, direction))
    return np.asarray(shape.intersect(Ray(*parts)).t, np.float64)


def _sides(ray: Float[np.ndarray, "*n 3"]) -> list[Float[np.ndarray, "*n 3"]]:
    """Two directions across a ray."""
    one = np.cross(ray, (0.3, 1.0, 0.2))
    one /= np.linalg.norm(one, axis=-1, keepdims=True)
    return [one, np.cross(ray, one)]
