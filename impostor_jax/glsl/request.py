"""What a caller hands to a driver, checked."""

__all__ = ["batch_in_camera"]

from typing import Any

import jax
import numpy as np

from impostor_jax.arguments import is_concrete
from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.primitives.base import in_camera_frame
from impostor_jax.primitives.cylinder import Cylinder


def batch_in_camera(cylinders: Any, camera: Any) -> Cylinder:
    """Cylinders as a batch (n,) in the camera frame.

    Raises:
        ValueError: A type is wrong, the camera has a lens, or something is traced.
    """
    if not isinstance(cylinders, Cylinder) or cylinders.radius.ndim > 1:
        raise ValueError(
            "cylinders must be one Cylinder or a batch (n,) of them, got "
            f"{type(cylinders).__name__}"
        )
    if not isinstance(camera, PinholeCamera | OrthographicCamera):
        raise ValueError(
            "camera must be a PinholeCamera or an OrthographicCamera, got "
            f"{type(camera).__name__}"
        )
    if isinstance(camera, PinholeCamera) and camera.distortion is not None:
        raise ValueError("camera must have no lens: the shaders draw straight lines")
    if not is_concrete((cylinders, camera)):
        raise ValueError("cylinders and camera must be concrete, got traced ones")
    if not cylinders.radius.ndim:
        cylinders = jax.tree.map(lambda field: field[None], cylinders)
    if not cylinders.radius.shape[0]:
        raise ValueError("cylinders must hold at least one, got an empty batch")
    return jax.tree.map(np.asarray, in_camera_frame(cylinders, camera))
