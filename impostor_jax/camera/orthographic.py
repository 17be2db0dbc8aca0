"""Orthographic camera: parallel rays."""

__all__ = ["OrthographicCamera"]

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.arguments import image_size, real_number
from impostor_jax.camera.base import AbstractCamera, Projection
from impostor_jax.camera.opengl import orthographic_arguments, pose_of_view
from impostor_jax.camera.pixels import (
    PixelBox,
    Pixels,
    linear_pixel_box,
    strided_intrinsics,
)
from impostor_jax.geometry.frames import Points, RigidTransform
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Scalar


class OrthographicCamera(AbstractCamera):
    """Camera at infinity; the point (x, y, z) is seen at u = fx x + cx, v = fy y + cy.

    Its rays start in the plane z = 0 of the camera frame and run along +z. It renders;
    outlines, coverage and fits need a `PinholeCamera`.

    Args:
        fx: Columns per meter; may be traced.
        fy: Rows per meter; may be traced.
        cx: Column of the camera frame's z axis, where the leftmost pixel's center is 0.
        cy: Row of the z axis, where the topmost pixel's center is 0.
        width: Number of columns.
        height: Number of rows.
        camera_from_world: Pose, a `RigidTransform` or a (4, 4) matrix; None where the
            camera frame is the world frame.

    Raises:
        ValueError: A value is out of range.
    """

    fx: Scalar
    fy: Scalar
    cx: Scalar
    cy: Scalar
    width: int = eqx.field(static=True)
    height: int = eqx.field(static=True)
    camera_from_world: RigidTransform | None

    def __init__(
        self,
        fx: Any,
        fy: Any,
        cx: Any,
        cy: Any,
        width: Any,
        height: Any,
        camera_from_world: Any = None,
    ):
        self.fx = real_number("fx", fx, positive=True, unit="pixels per meter")
        self.fy = real_number("fy", fy, positive=True, unit="pixels per meter")
        self.cx = real_number("cx", cx, unit="pixels")
        self.cy = real_number("cy", cy, unit="pixels")
        self.width, self.height = image_size(width, height)
        self.camera_from_world = RigidTransform.of(camera_from_world)

    @staticmethod
    def from_opengl(
        projection: Any, size: Any, view: Any = None
    ) -> "OrthographicCamera":
        """The camera of an orthographic projection of OpenGL, as of glOrtho.

        Args:
            projection: (4, 4), as of `PinholeCamera.from_opengl`.
            size: Width and height of the viewport, in pixels.
            view: As of `PinholeCamera.from_opengl`. Rays start in its plane z = 0,
                whatever the near plane is.

        Raises:
            ValueError: As of `PinholeCamera.from_opengl`, of a perspective projection.
        """
        arguments = orthographic_arguments(projection, size)
        return OrthographicCamera(**arguments, camera_from_world=pose_of_view(view))

    @property
    @override
    def projection(self) -> Projection:
        return "parallel"

    @override
    def rays(self, row: Pixels, col: Pixels, dtype: DTypeLike) -> Ray:
        x = (col.astype(dtype) - self.cx) / self.fx
        y = (row.astype(dtype) - self.cy) / self.fy
        zero, one = jnp.zeros_like(x), jnp.ones_like(x)
        return Ray(Vec3(x, y, zero), Vec3(zero, zero, one))

    @override
    def shifted(
        self, cols: Float[Array, ""], rows: Float[Array, ""]
    ) -> "OrthographicCamera":
        return eqx.tree_at(
            lambda c: (c.cx, c.cy), self, (self.cx - cols, self.cy - rows)
        )

    @override
    def strided(self, stride: int) -> "OrthographicCamera":
        return OrthographicCamera(
            **strided_intrinsics(self, stride),
            camera_from_world=self.camera_from_world,
        )

    @override
    def sees(self, row: Pixels, col: Pixels) -> Bool[Array, "*batch"] | None:
        return None

    @override
    def pixel_box(self, low: Float[Array, "2"], high: Float[Array, "2"]) -> PixelBox:
        return linear_pixel_box(self, low, high)

    @override
    def project(self, points: Points) -> Float[Array, "*batch 2"]:
        points = jnp.asarray(points)
        u = self.fx * points[..., 0] + self.cx
        return jnp.stack([u, self.fy * points[..., 1] + self.cy], axis=-1)
