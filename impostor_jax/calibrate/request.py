"""Checks of what a calibration is given."""

__all__ = ["checked_images", "checked_masks", "checked_objects"]

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.arguments import real_number, unmasked
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.regions import warn_of_units
from impostor_jax.fit.request import checked_depth, checked_noise


def checked_images(depths: Any, camera: AbstractCamera) -> Float[np.ndarray, "n h w"]:
    """All images, with 0 for missing readings."""
    shape = camera.height, camera.width
    images = np.asarray(unmasked(depths))
    if images.ndim not in (2, 3) or images.shape[-2:] != shape or not images.size:
        raise ValueError(
            f"depths must be (N, H, W) or (H, W), of the camera's shape {shape}, got "
            f"{images.shape}"
        )
    images = images.reshape(-1, *shape)
    images = np.stack([np.asarray(checked_depth(image, camera)) for image in images])
    # One is told of as well as all.
    warn_of_units(images[0], images[0] > 0, checked_noise(None))
    return images


def checked_masks(
    name: str, mask: Any, shape: tuple[int, ...]
) -> Bool[np.ndarray, "n h w"]:
    """Masks of all images; all of each where there are none."""
    if mask is None:
        return np.ones(shape, bool)
    masks = np.asarray(unmasked(mask))
    if masks.shape not in (shape, shape[1:]):
        raise ValueError(
            f"{name} must have the shape {shape} of depths, or {shape[1:]} of one for "
            f"all, got {masks.shape}"
        )
    if not (masks.dtype == bool or np.issubdtype(masks.dtype, np.integer)):
        raise ValueError(f"{name} must be of booleans or integers, got {masks.dtype}")
    return np.broadcast_to(masks != 0, shape)


def checked_objects(
    objects: Any, radius: Any, camera: AbstractCamera, shape: tuple[int, ...]
) -> Bool[np.ndarray, "n h w"]:
    """Masks of the object of known size; empty where there is none."""
    if (objects is None) != (radius is None):
        missing, other = ("radius", "objects")[:: 1 if radius is None else -1]
        raise ValueError(f"{missing} must be given with {other}, got None")
    if objects is None:
        return np.zeros(shape, bool)
    real_number("radius", radius, positive=True, unit="meters")
    if not isinstance(camera, PinholeCamera):
        raise ValueError(
            f"camera must be a PinholeCamera where objects are given, got "
            f"{type(camera).__name__}"
        )
    seen = checked_masks("objects", objects, shape)
    if not seen.any():
        raise ValueError("objects must hold at least one pixel, got empty masks")
    return seen
