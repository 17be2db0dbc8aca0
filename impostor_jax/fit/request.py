"""Checks of what `fit_cylinder` is asked."""

__all__ = [
    "MIN_READINGS",
    "DepthImage",
    "Mask",
    "check_readings",
    "check_types",
    "checked_depth",
    "checked_fixed",
    "checked_mask",
]

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.arguments import is_concrete, one_of
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.parameterization import PARAMETERS
from impostor_jax.primitives.cylinder import Cylinder

DepthImage = Float[np.ndarray, "h w"] | Float[Array, "h w"]
Mask = Bool[np.ndarray, "h w"] | Bool[Array, "h w"]

MIN_READINGS = 50
"""A fit with fewer readings is refused."""


def checked_fixed(fixed: Sequence[str], initial: Cylinder | None) -> tuple[str, ...]:
    """Names of held parameters, in their order in `PARAMETERS`."""
    if isinstance(fixed, str):
        raise ValueError(f"fixed must be a sequence of names, got {fixed!r}")
    for name in fixed:
        one_of("fixed", name, PARAMETERS)
    if len(set(fixed)) == len(PARAMETERS):
        raise ValueError("fixed must leave a parameter to fit, got all four")
    if fixed and initial is None:
        raise ValueError(
            f"initial must be given with fixed={tuple(fixed)}: held parameters keep "
            "their value in it"
        )
    return tuple(name for name in PARAMETERS if name in fixed)


def check_types(camera: PinholeCamera, initial: Cylinder | None) -> None:
    """Raise unless the objects are what their names say."""
    if not isinstance(camera, PinholeCamera):
        raise ValueError(f"camera must be a PinholeCamera, got {type(camera).__name__}")
    if initial is None:
        return
    if not isinstance(initial, Cylinder) or initial.radius.ndim:
        raise ValueError(f"initial must be one Cylinder, got {initial!r}")


def checked_depth(depth: Any, camera: PinholeCamera) -> DepthImage:
    """Depth as a float image with 0 for missing readings."""
    if not isinstance(depth, jax.Array):
        depth = np.asarray(depth)
    shape = (camera.height, camera.width)
    if depth.shape != shape:
        raise ValueError(
            f"depth must have the camera's shape {shape}, got {depth.shape}"
        )
    if not jnp.issubdtype(depth.dtype, np.floating):
        raise ValueError(
            f"depth must be floating-point meters, got {depth.dtype}; multiply integer "
            "readings by their depth scale"
        )
    if is_concrete(depth):
        values = np.asarray(depth)
        values = np.where(np.isfinite(values), values, 0)
        if values.size and values.min() < 0:
            raise ValueError(
                f"depth must not be negative, got {values.min()} meters; missing "
                "readings are 0, NaN or infinity"
            )
        return values.astype(jnp.result_type(float))
    return jnp.where(jnp.isfinite(depth), depth, 0).astype(jnp.result_type(float))


def checked_mask(mask: Any, camera: PinholeCamera) -> Mask | None:
    """Mask as booleans of the camera's shape; None stays."""
    if mask is None:
        return None
    if not isinstance(mask, jax.Array):
        mask = np.asarray(mask)
    shape = (camera.height, camera.width)
    if mask.shape != shape:
        raise ValueError(f"mask must have the camera's shape {shape}, got {mask.shape}")
    if not (mask.dtype == bool or jnp.issubdtype(mask.dtype, np.integer)):
        raise ValueError(f"mask must be of booleans or integers, got {mask.dtype}")
    return mask if mask.dtype == bool else mask != 0


def check_readings(
    depth: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"] | None
) -> None:
    """Raise where there are too few readings for a fit."""
    if mask is not None and not mask.any():
        raise ValueError("mask must hold at least one pixel, got an empty one")
    count = np.count_nonzero(depth if mask is None else depth[mask])
    if count < MIN_READINGS:
        where = "" if mask is None else " inside the mask"
        raise ValueError(
            f"depth must hold at least {MIN_READINGS} readings{where}, got {count}"
        )
