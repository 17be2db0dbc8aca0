"""Lens distortion: OpenCV's polynomial and fisheye models, and their inverse.

A lens maps the point (x, y) of the plane z = 1 to a distorted point. Rendering needs
the inverse, which has no closed form: OpenCV solves it once for every pixel when a
camera is made. One Newton step on that stored field, written in JAX, then makes the
rays exact to rounding and differentiable in the intrinsics and in the coefficients, by
the implicit function theorem.
"""

__all__ = ["RayField", "distort", "solve_ray_field", "undistort_step"]

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.numerics import safe_divide, safe_sqrt
from impostor_jax.opencv import cv2

Coordinate = Float[Array, "*batch"]


class RayField(eqx.Module):
    """Undistorted points (x, y) of the plane z = 1 that the pixels see.

    Both are `+inf` where no ray reaches the pixel through the lens. All fields are
    floats, so a camera can be differentiated in as a whole.
    """

    x: Float[np.ndarray, "h w"] | Float[Array, "h w"]
    y: Float[np.ndarray, "h w"] | Float[Array, "h w"]


def distort(
    x: Coordinate, y: Coordinate, coefficients: Float[Array, " n"], fisheye: bool
) -> tuple[Coordinate, Coordinate]:
    """Map undistorted to distorted points of the plane z = 1.

    Args:
        x: First coordinate, no unit.
        y: Second coordinate.
        coefficients: In OpenCV's order: k1 k2 p1 p2 k3 [k4 k5 k6 [s1 s2 s3 s4 tx ty]];
            for a fisheye lens k1 k2 k3 k4.
        fisheye: Whether the lens is of OpenCV's fisheye model.

    References:
        OpenCV documentation, modules calib3d and calib3d::fisheye.
    """
    if fisheye:
        return _fisheye(x, y, coefficients)
    k = jnp.zeros(14, coefficients.dtype).at[: coefficients.shape[0]].set(coefficients)
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tilt_x, tilt_y = k
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (
        1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    )
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2)
    yd = y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y) + r2 * (s3 + r2 * s4)
    if coefficients.shape[0] < 14:
        return xd, yd
    # The image plane is tilted about x, then about y, and seen from the lens's center.
    sin_x, cos_x = jnp.sin(tilt_x), jnp.cos(tilt_x)
    sin_y, cos_y = jnp.sin(tilt_y), jnp.cos(tilt_y)
    r13, r23, r33 = -sin_y * cos_x, sin_x, cos_y * cos_x
    tilted_x = cos_y * xd + sin_y * sin_x * yd + r13
    tilted_y = cos_x * yd + r23
    tilted_z = sin_y * xd - cos_y * sin_x * yd + r33
    return (
        (r33 * tilted_x - r13 * tilted_z) / tilted_z,
        (r33 * tilted_y - r23 * tilted_z) / tilted_z,
    )


def _fisheye(
    x: Coordinate, y: Coordinate, coefficients: Float[Array, "4"]
) -> tuple[Coordinate, Coordinate]:
    k1, k2, k3, k4 = coefficients
    r = safe_sqrt(x * x + y * y)
    theta = jnp.arctan(r)
    t2 = theta * theta
    bent = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    scale = jnp.where(r == 0, 1, safe_divide(bent, r))
    return x * scale, y * scale


def undistort_step(
    x: Coordinate,
    y: Coordinate,
    target: tuple[Coordinate, Coordinate],
    lens: Callable[[Coordinate, Coordinate], tuple[Coordinate, Coordinate]],
) -> tuple[Coordinate, Coordinate]:
    """One Newton step towards the point that `lens` maps to `target`.

    Derivatives:
        In `target` and in whatever `lens` closes over, of first order: from a converged
        (x, y), which is held constant, a Newton step is the implicit function theorem.
    """
    x, y = jax.lax.stop_gradient((x, y))
    one, zero = jnp.ones_like(x), jnp.zeros_like(x)
    (xd, yd), (a, c) = jax.jvp(lens, (x, y), (one, zero))
    _, (b, d) = jax.jvp(lens, (x, y), (zero, one))
    a, b, c, d = jax.lax.stop_gradient((a, b, c, d))
    miss_x, miss_y = xd - target[0], yd - target[1]
    determinant = a * d - b * c
    return (
        x - safe_divide(d * miss_x - b * miss_y, determinant),
        y - safe_divide(a * miss_y - c * miss_x, determinant),
    )


def solve_ray_field(
    camera_matrix: Float[np.ndarray, "3 3"],
    coefficients: Float[np.ndarray, " n"],
    fisheye: bool,
    width: int,
    height: int,
) -> RayField:
    """Solve the inverse of the lens for every pixel center, in double precision.

    A pixel counts as valid where the solution maps back to it within 0.01 px.
    """
    v, u = np.mgrid[0:height, 0:width].astype(np.float64)
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    module = cv2.fisheye if fisheye else cv2
    points = module.undistortPoints(
        pixels, camera_matrix, coefficients, criteria=criteria
    )
    finite = np.where(np.isfinite(points), points, 0.0)
    spatial = np.concatenate([finite, np.ones_like(finite[..., :1])], axis=-1)
    still = np.zeros(3)
    back, _ = module.projectPoints(spatial, still, still, camera_matrix, coefficients)
    miss = np.abs(back.reshape(pixels.shape) - pixels).max(axis=(1, 2))
    valid = (miss < 0.01) & np.isfinite(points).all(axis=(1, 2))
    x, y = np.where(valid[:, None], finite[:, 0], np.inf).T.reshape(2, height, width)
    return RayField(x=x, y=y)
