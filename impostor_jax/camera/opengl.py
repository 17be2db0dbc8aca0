"""Projection and view matrices of OpenGL, for cameras.

They multiply column vectors. OpenGL's camera frame is x right, y up, z backward; its
window begins at the bottom left corner, and the center of the first pixel is at 0.5.
"""

__all__ = [
    "NearFar",
    "near_far_of",
    "orthographic_arguments",
    "perspective_arguments",
    "pose_of_view",
]

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.arguments import float_array, image_size, is_concrete
from impostor_jax.geometry.frames import RigidTransform

Matrix = Float[np.ndarray, "4 4"] | Float[Array, "4 4"]

FLIP = np.array([1.0, -1.0, -1.0, 1.0])
"""From OpenGL's camera frame to this package's, and back."""


class NearFar(NamedTuple):
    """Depths, in meters, as `render`, `trace` and `silhouettes` take them."""

    near: float
    far: float


def near_far_of(projection: Any, ndc: Any = (-1.0, 1.0)) -> NearFar:
    """Depths of the near and the far plane of a projection matrix of OpenGL.

        near, far = ij.near_far_of(projection)
        maps = ij.render(scene, camera, near=near, far=far)

    Args:
        projection: (4, 4), perspective or orthographic, of concrete numbers.
        ndc: Normalized device coordinates of the two planes: (-1, 1) of OpenGL, (0, 1)
            of its zero-to-one clipping and of Vulkan, (1, 0) where that is reversed.

    Returns:
        Both, near before far; far is infinite where the matrix has no far plane. An
        orthographic near may be negative, behind where rays start here; `render`
        refuses it.

    Raises:
        ValueError: It is no such matrix, its planes are oblique, or they are not in
            order: of another `ndc`.
    """
    matrix = _matrix("projection", projection)
    if not is_concrete(matrix):
        raise ValueError("projection must have concrete numbers, got traced ones")
    if np.shape(ndc) != (2,):
        raise ValueError(
            f"ndc must be those of the near and the far plane, got {ndc!r}"
        )
    is_perspective = matrix[3, 3] == 0
    (_check_perspective if is_perspective else _check_orthographic)(matrix)
    if np.any(matrix[2, :2] != 0):
        raise ValueError(
            "projection must have planes across the view, got an oblique one, with "
            f"the third row {matrix[2].tolist()}"
        )
    slope, offset = float(matrix[2, 2]), float(matrix[2, 3])
    near, far = (
        _divided(offset, end + slope)
        if is_perspective
        else _divided(offset - end, slope)
        for end in ndc
    )
    if not near < far or (is_perspective and near <= 0):
        raise ValueError(
            f"projection must have near before far, got {near} and {far} meters with "
            f"the normalized device coordinates {tuple(ndc)}; give others by ndc"
        )
    return NearFar(near, far)


def perspective_arguments(projection: Any, size: Any) -> dict[str, Any]:
    """Intrinsics and size of a `PinholeCamera`.

    Args:
        projection: (4, 4), as of glFrustum or gluPerspective; may be traced.
        size: Width and height in pixels.
    """
    m, size = _matrix("projection", projection), _size(size)
    if is_concrete(m):
        _check_perspective(m)
    return _arguments(m, size, 1 - m[0, 2], 1 + m[1, 2])


def orthographic_arguments(projection: Any, size: Any) -> dict[str, Any]:
    """Scales, place of the axis and size of an `OrthographicCamera`.

    Args:
        projection: (4, 4), as of glOrtho; may be traced.
        size: Width and height in pixels.
    """
    m, size = _matrix("projection", projection), _size(size)
    if is_concrete(m):
        _check_orthographic(m)
    return _arguments(m, size, 1 + m[0, 3], 1 - m[1, 3])


def _arguments(
    m: Matrix, size: tuple[int, int], right: Any, down: Any
) -> dict[str, Any]:
    """Arguments of a camera; the last two are where its axis is, in half sizes."""
    width, height = size
    return {
        "fx": m[0, 0] * (width / 2),
        "fy": m[1, 1] * (height / 2),
        "cx": right * (width / 2) - 0.5,
        "cy": down * (height / 2) - 0.5,
        "width": width,
        "height": height,
    }


def pose_of_view(view: Any) -> RigidTransform | None:
    """`camera_from_world` of a view matrix, (4, 4); None stays."""
    if view is None:
        return None
    matrix = _matrix("view", view)
    flip = FLIP if is_concrete(matrix) else jnp.asarray(FLIP, matrix.dtype)
    return RigidTransform.from_matrix(flip[:, None] * matrix)


def _matrix(name: str, given: Any) -> Matrix:
    """A matrix, in double precision where its numbers are known."""
    values = float_array(name, given, (4, 4))
    if values.ndim != 2:
        raise ValueError(f"{name} must be one matrix (4, 4), got {values.shape}")
    return np.asarray(given, np.float64) if is_concrete(given) else values


def _size(size: Any) -> tuple[int, int]:
    if np.shape(size) != (2,):
        raise ValueError(f"size must be width and height in pixels, got {size!r}")
    return image_size(*size)


def _check_perspective(m: Matrix) -> None:
    """Raise if a matrix of known numbers is none of a pinhole camera."""
    last = m[3].tolist()
    if last == [0, 0, 0, 1]:
        raise ValueError(
            "projection must be a perspective one for a PinholeCamera, got an "
            "orthographic one, which OrthographicCamera.from_opengl takes"
        )
    # Of a scaled row nobody knows whether it is not that of a transposed matrix.
    if last != [0, 0, -1, 0]:
        raise ValueError(
            "projection must end in the row 0 0 -1 0, as those do that multiply column "
            f"vectors and look along -z, got {last}; transpose one of row vectors"
        )
    _check_axes(m, [m[0, 3], m[1, 3]])


def _check_orthographic(m: Matrix) -> None:
    """Raise if a matrix of known numbers is none of parallel rays."""
    last = m[3].tolist()
    if last == [0, 0, -1, 0]:
        raise ValueError(
            "projection must be an orthographic one for an OrthographicCamera, got a "
            "perspective one, which PinholeCamera.from_opengl takes"
        )
    if last != [0, 0, 0, 1]:
        raise ValueError(
            "projection must end in the row 0 0 0 1, as those do that multiply column "
            f"vectors, got {last}; transpose one of row vectors"
        )
    _check_axes(m, [m[0, 2], m[1, 2]])


def _check_axes(m: Matrix, rest: list[Any]) -> None:
    """Raise unless x grows to the right, y upward, and nothing else moves either."""
    if m[0, 0] <= 0 or m[1, 1] <= 0:
        raise ValueError(
            "projection must have positive scales, of x to the right and y upward, got "
            f"{m[0, 0]} and {m[1, 1]}: a mirrored image is that of no camera"
        )
    if np.any(np.asarray([m[0, 1], m[1, 0], *rest]) != 0):
        raise ValueError(
            "projection must have no skew and no shift but that of the image, got the "
            f"rows {m[:2].tolist()}"
        )


def _divided(above: float, below: float) -> float:
    return above / below if below else math.inf
