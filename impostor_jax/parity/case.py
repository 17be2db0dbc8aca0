"""A scene that JAX and the drivers are compared on, and how large it is seen."""

__all__ = [
    "Case",
    "Primitives",
    "camera_of_kind",
    "camera_on",
    "scattered_case",
    "scattered_places",
]

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.primitives.base import AbstractPrimitive

WIDTH, HEIGHT = 160, 120

RADIUS_PX = 24.0
"""Radius in the image, where the distance lets it be seen whole."""

Primitives = AbstractPrimitive | Sequence[AbstractPrimitive]
"""One primitive, a batch, or a sequence of these."""


@dataclasses.dataclass(frozen=True)
class Case:
    """A scene with its camera, which is the world; the name is "camera/scene"."""

    name: str
    primitives: Primitives
    camera: PinholeCamera | OrthographicCamera

    @property
    def count(self) -> int:
        """How many primitives there are."""
        given = self.primitives
        listed = given if isinstance(given, Sequence) else (given,)
        return sum(int(np.prod(one.batch_shape)) for one in listed)


def camera_of_kind(
    kind: str, focal: float, finer: int = 1
) -> PinholeCamera | OrthographicCamera:
    """A camera, "perspective" or "orthographic", centered on the image.

    Args:
        kind: Which of the two.
        focal: Focal length in pixels; of parallel rays, pixels per meter.
        finer: Pixels in place of one, along each side.
    """
    camera = PinholeCamera if kind == "perspective" else OrthographicCamera
    width, height = finer * WIDTH, finer * HEIGHT
    return camera(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)


def camera_on(
    kind: str, distance: float, radius: float
) -> PinholeCamera | OrthographicCamera:
    """A camera, as `camera_of_kind`, that sees a radius with `RADIUS_PX` pixels.

    Args:
        kind: Which of the two.
        distance: In radii. From inside the view is as wide as from one radius away.
        radius: In meters.
    """
    part = max(distance, 1) if kind == "perspective" else 1 / radius
    return camera_of_kind(kind, RADIUS_PX * part)


def scattered_places(
    rng: np.random.Generator, kind: str, count: int
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Random centers and radii that a camera sees overlap."""
    # More of them are smaller, so that many are seen.
    radius = np.exp(rng.uniform(np.log(0.05), np.log(0.2), count)) / count**0.25
    z = rng.uniform(2.0, 6.0, count)
    x, y = rng.uniform(-0.6, 0.6, count), rng.uniform(-0.5, 0.5, count)
    if kind == "perspective":
        x, y, radius = x * z, y * z, radius * z
    return np.stack([x, y, z], axis=-1), radius


def scattered_case(name: str, kind: str, primitives: Primitives) -> Case:
    """Case of scattered primitives."""
    focal = 110.0 if kind == "perspective" else 100.0
    # Finer, since edges fill most of an image of so many.
    return Case(name, primitives, camera_of_kind(kind, 2 * focal, 2))
