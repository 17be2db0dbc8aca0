"""Find every cylinder in a depth image."""

__all__ = ["find_cylinders"]

from typing import Any

import numpy as np

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.effort import Effort
from impostor_jax.find.found import Found
from impostor_jax.find.search import search
from impostor_jax.fit.request import checked_noise
from impostor_jax.primitives.plane import Plane


def find_cylinders(
    depth: Any,
    camera: AbstractCamera,
    sigma: Any = None,
    *,
    min_pixels: int = 150,
    min_arc: float = 0.9,
    radius_range: tuple[float, float] = (0.003, 1.0),
    prior: Any = None,
    effort: Effort | str = "balanced",
) -> Found:
    """Find every cylinder in a depth image."""
    noise = checked_noise(sigma)
    image = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    view, normals, planes, found = search(image, camera, noise, min_pixels)
    fits = tuple(f for f, _, _ in found)
    masks = np.array([e.region for _, e, _ in found], bool).reshape(-1, *image.shape)
    visible = np.array([e.explained / max(e.size, 1) for _, e, _ in found])
    nothing = np.zeros((0, 3), np.float32)
    return Found(fits, masks, visible, np.full(len(fits), 0.5), np.zeros(len(fits), bool), Plane(nothing, nothing))
