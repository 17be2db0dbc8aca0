"""Pinhole camera with OpenCV's intrinsics and lens models."""

__all__ = ["PinholeCamera"]

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.arguments import float_array, image_size, is_concrete, real_number
from impostor_jax.camera.base import AbstractCamera, Projection
from impostor_jax.camera.lens import RayField, distort, solve_ray_field, undistort_step
from impostor_jax.camera.opengl import perspective_arguments, pose_of_view
from impostor_jax.camera.pixels import (
    PixelBox,
    Pixels,
    first_and_last,
    linear_pixel_box,
    strided_intrinsics,
)
from impostor_jax.geometry.frames import Points, RigidTransform
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Scalar


class PinholeCamera(AbstractCamera):
    """Pinhole camera; the point (x, y, z) is seen at u = fx x/z + cx, v = fy y/z + cy.

    Args:
        fx: Focal length along the rows, in pixels; may be traced.
        fy: Focal length along the columns, in pixels; may be traced.
        cx: Column of the principal point, where the leftmost pixel's center is 0.
        cy: Row of the principal point, where the topmost pixel's center is 0.
        width: Number of columns.
        height: Number of rows.
        distortion: Lens coefficients in OpenCV's order: 5, 8 or 14 of them, or 4 with
            `fisheye`. None and all zeros mean no lens, and cost nothing.
        fisheye: Whether `distortion` is of OpenCV's fisheye model.
        camera_from_world: Pose, a `RigidTransform` or a (4, 4) matrix; None where the
            camera frame is the world frame.

    Raises:
        ValueError: A value is out of range, or a camera with a lens is made from traced
            intrinsics (its rays are solved when it is made, outside JAX).
    """

    fx: Scalar
    fy: Scalar
    cx: Scalar
    cy: Scalar
    width: int = eqx.field(static=True)
    height: int = eqx.field(static=True)
    distortion: Float[Array, " n"] | None
    fisheye: bool = eqx.field(static=True)
    camera_from_world: RigidTransform | None
    ray_field: RayField | None

    def __init__(
        self,
        fx: Any,
        fy: Any,
        cx: Any,
        cy: Any,
        width: Any,
        height: Any,
        distortion: Any = None,
        fisheye: bool = False,
        camera_from_world: Any = None,
    ):
        self.fx = real_number("fx", fx, positive=True, unit="pixels")
        self.fy = real_number("fy", fy, positive=True, unit="pixels")
        self.cx = real_number("cx", cx, unit="pixels")
        self.cy = real_number("cy", cy, unit="pixels")
        self.width, self.height = image_size(width, height)
        self.fisheye = bool(fisheye)
        self.camera_from_world = RigidTransform.of(camera_from_world)
        self.distortion, self.ray_field = None, None
        if distortion is None:
            return
        coefficients = float_array("distortion", distortion, (None,))
        allowed = (4,) if self.fisheye else (5, 8, 14)
        if coefficients.ndim != 1 or coefficients.shape[0] not in allowed:
            raise ValueError(
                f"distortion must have {' or '.join(map(str, allowed))} coefficients "
                f"{'for a fisheye lens' if self.fisheye else 'in OpenCV order'}, "
                f"got {coefficients.shape[0]}"
            )
        if not is_concrete((fx, fy, cx, cy, coefficients)):
            raise ValueError(
                "a camera with distortion must be made from concrete numbers, got "
                "traced ones; make it outside jax.jit and pass it in"
            )
        if not self.fisheye and not np.any(np.asarray(coefficients)):
            return
        self.distortion = coefficients
        self.ray_field = solve_ray_field(
            self.matrix(),
            np.asarray(distortion, dtype=np.float64),
            self.fisheye,
            self.width,
            self.height,
        )

    @staticmethod
    def from_opengl(projection: Any, size: Any, view: Any = None) -> "PinholeCamera":
        """The camera of a perspective projection of OpenGL, as of glFrustum.

        It sees each point in the pixel that OpenGL draws it in, whose center is at 0.5
        there. The third row counts for `near_far_of` alone.

        Args:
            projection: (4, 4), which multiplies column vectors; may be traced.
            size: Width and height of the viewport, in pixels.
            view: View matrix of OpenGL, (4, 4), from the world to a camera that looks
                along -z with y up; may be traced. None where this package's camera
                frame is the world frame.

        Raises:
            ValueError: It is an orthographic projection, or one that is skewed,
                mirrored or in row vectors' order; or the view is no rigid motion.
        """
        arguments = perspective_arguments(projection, size)
        return PinholeCamera(**arguments, camera_from_world=pose_of_view(view))

    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """Intrinsic matrix K, in pixels; the fields must be concrete."""
        return np.array(
            [[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], dtype=np.float64
        )

    @property
    @override
    def projection(self) -> Projection:
        return "planar"

    @property
    def spacing(self) -> Scalar:
        """Distance of neighboring rays at a depth of 1, the larger of rows and columns.

        Without a lens.
        """
        if is_concrete((self.fx, self.fy)):
            # JAX takes 20 us.
            return 1 / min(float(self.fx), float(self.fy))
        return 1 / jnp.minimum(self.fx, self.fy)

    @override
    def rays(self, row: Pixels, col: Pixels, dtype: DTypeLike) -> Ray:
        x = (col.astype(dtype) - self.cx) / self.fx
        y = (row.astype(dtype) - self.cy) / self.fy
        if self.ray_field is not None and self.distortion is not None:
            coefficients = self.distortion.astype(dtype)
            start_x = jnp.asarray(self.ray_field.x)[row, col].astype(dtype)
            start_y = jnp.asarray(self.ray_field.y)[row, col].astype(dtype)
            seen = jnp.isfinite(start_x)
            x, y = undistort_step(
                jnp.where(seen, start_x, 0),
                jnp.where(seen, start_y, 0),
                (x, y),
                lambda x, y: distort(x, y, coefficients, self.fisheye),
            )
            x, y = jnp.where(seen, x, 0), jnp.where(seen, y, 0)
        zero = jnp.zeros_like(x)
        return Ray(
            origin=Vec3(zero, zero, zero), direction=Vec3(x, y, jnp.ones_like(x))
        )

    @override
    def shifted(
        self, cols: Float[Array, ""], rows: Float[Array, ""]
    ) -> "PinholeCamera":
        if self.ray_field is not None:
            raise ValueError(
                "effort must have samples of 1 for a camera with a lens, whose rays "
                "are known through the centers of pixels alone"
            )
        return eqx.tree_at(
            lambda c: (c.cx, c.cy), self, (self.cx - cols, self.cy - rows)
        )

    @override
    def strided(self, stride: int) -> "PinholeCamera":
        return PinholeCamera(
            **strided_intrinsics(self, stride),
            distortion=self.distortion,
            fisheye=self.fisheye,
            camera_from_world=self.camera_from_world,
        )

    @override
    def sees(self, row: Pixels, col: Pixels) -> Bool[Array, "*batch"] | None:
        if self.ray_field is None:
            return None
        return jnp.isfinite(jnp.asarray(self.ray_field.x)[row, col])

    @override
    def pixel_box(self, low: Float[Array, "2"], high: Float[Array, "2"]) -> PixelBox:
        if self.ray_field is not None:
            row, col = self.frame.pixels()
            d = self.rays(row, col, low.dtype).direction
            inside = (d.x >= low[0]) & (d.x <= high[0])
            inside &= jnp.isfinite(jnp.asarray(self.ray_field.x))
            inside &= (d.y >= low[1]) & (d.y <= high[1])
            rows, cols = jnp.any(inside, axis=1), jnp.any(inside, axis=0)
            return PixelBox(*first_and_last(rows), *first_and_last(cols))
        return linear_pixel_box(self, low, high)

    @override
    def project(self, points: Points) -> Float[Array, "*batch 2"]:
        points = jnp.asarray(points)
        x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
        if self.distortion is not None:
            x, y = distort(x, y, self.distortion.astype(points.dtype), self.fisheye)
        return jnp.stack([self.fx * x + self.cx, self.fy * y + self.cy], axis=-1)
