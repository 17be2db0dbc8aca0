"""The outline of a sphere as a circle on it, in closed form.

The rays that touch a sphere of radius r, at the distance d, meet its radii at right
angles. So they touch it in a circle around the line from its center to the camera: the
angle between that line and the radii to the circle has the cosine r / d. The circle's
image is a conic: an ellipse where the sphere is wholly in front of the camera's plane
z = 0, else a parabola or a branch of a hyperbola.
"""

__all__ = ["SphereOutline", "sphere_outline"]

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from typing_extensions import override

from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import safe_divide, safe_norm, safe_normalize, safe_sqrt
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.rendering.outline_base import AbstractOutline, Place


class SphereOutline(AbstractOutline):
    """Circle on a sphere whose image is the sphere's outline.

    Make it with `outline`. Lengths are in meters, in the camera frame; a camera's
    `project` brings all points into its image, through a lens too.

    Attributes:
        sphere: In the camera frame.
        toward: Unit vector from the center to the camera.
        cosine: Of the angle between it and the radii to the circle; 1 inside.
        sine: Of the same angle, in [0, 1].
        clearance: Distance between camera and sphere; negative inside.

    Derivatives:
        A point stays where it is on the body: at the end of a radius whose direction is
        held. That is exact for how the outline moves along its normal.
    """

    sphere: Sphere
    toward: Float[Array, "3"]
    cosine: Float[Array, ""]
    sine: Float[Array, ""]
    clearance: Float[Array, ""]

    @property
    @override
    def radius(self) -> Float[Array, ""]:
        return self.sphere.radius

    @property
    @override
    def deepest(self) -> Vec3:
        c = Vec3.from_array(self.sphere.center)
        return Vec3(c.x, c.y, c.z + self.sphere.radius)

    @property
    @jax.jit
    def conic(self) -> Float[Array, "3 3"]:
        """Image of the circle.

        Symmetric matrix Q: x^T Q x is 0 for the points x = (x, y, 1) of the outline and
        negative within it.
        """
        c, r = self.sphere.center, self.sphere.radius
        # |x|^2 (|c|^2 - r^2) - (c.x)^2: how near the ray x comes to the center.
        square = self.clearance * (self.clearance + 2 * r)
        return square * jnp.eye(3, dtype=r.dtype) - c[:, None] * c[None]

    @override
    def vectors(self) -> Float[Array, "4 3"]:
        across = tangent_basis(self.toward)
        frame = jnp.stack([self.toward, across[0], across[1]])
        radii = self.sphere.radius * jax.lax.stop_gradient(frame)
        return jnp.stack([self.sphere.center, *radii])

    @override
    def place(self, parameter: Float[Array, "*batch"]) -> Place:
        """Direction of the radius to a point of the curve.

        Args:
            parameter: In [0, 4], in quarters of the circle.

        Returns:
            Its components toward the camera and in two directions across that.
        """
        angle = parameter * (jnp.pi / 2)
        toward = jnp.full_like(angle, self.cosine)
        return toward, self.sine * jnp.cos(angle), self.sine * jnp.sin(angle)


def sphere_outline(sphere: Sphere) -> SphereOutline:
    """Outline of a sphere: `sphere` is a single one, in the camera frame."""
    c, r = jnp.asarray(sphere.center), sphere.radius
    distance = safe_norm(c)
    # At the center any direction serves.
    forward = jnp.array([0, 0, 1], c.dtype)
    toward = safe_normalize(jnp.where(distance > 0, -c, forward))
    outside = distance > r
    gap = (distance - r) * (distance + r)
    return SphereOutline(
        sphere=sphere,
        toward=toward,
        cosine=jnp.where(outside, safe_divide(r, distance), 1),
        sine=jnp.where(outside, safe_divide(safe_sqrt(gap), distance), 0),
        clearance=distance - r,
    )
