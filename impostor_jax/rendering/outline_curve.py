"""The outline of a shape as a curve on it, in closed form.

That of a sphere is a circle (`sphere_outline`); here is that of a capped cylinder.

The two planes through the camera that touch the infinite wall touch it in two straight
lines, and these cut each rim in two arcs. Of a cap that the camera sees the far arc is
on the outline, of a hidden cap the near one. So the outline is two lines and two arcs;
a single rim where the camera looks along the wall from within; and nothing from inside
the solid. That holds however the solid lies, also where it reaches behind the camera.
"""

__all__ = ["Outline", "outline"]

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.camera.base import AbstractCamera, check_central
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.geometry.vec3 import Vec3, unit
from impostor_jax.numerics import eps, safe_divide, safe_sqrt
from impostor_jax.primitives.base import (
    AbstractPrimitive,
    check_single,
    in_camera_frame,
)
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.local_world import near_its_camera
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.rendering.outline_base import AbstractOutline, Place
from impostor_jax.rendering.sphere_outline import sphere_outline


class Outline(AbstractOutline):
    """Closed curve on a cylinder whose image is the cylinder's outline.

    It has four pieces: along one tangent line to the end on the side of +axis, across
    that end, back along the other line and across the other end; counterclockwise as
    the camera sees it. Seen end on, one rim is all that is left.

    Make it with `outline`. Lengths are in meters, in the camera frame; a camera's
    `project` brings all points into its image, through a lens too.

    Attributes:
        cylinder: In the camera frame.
        toward: Unit vector from the axis to the camera. Rim angles count from it.
        beside: Unit vector at a right rim angle.
        cosine: Of the rim angle of the tangent lines, which lie at plus and minus it; 1
            where there are none.
        sine: Of the same angle, in [0, 1].
        seen_end: 1 or -1 where the camera sees the cap at the end of +axis or -axis; 0
            where it sees none.
        clearance: Distance between camera and solid at least; negative inside.

    Derivatives:
        A point stays where it is on the body: at its rim angle, and at its share of the
        height. That is exact for how the outline moves along its normal.
    """

    cylinder: Cylinder
    toward: Float[Array, "3"]
    beside: Float[Array, "3"]
    cosine: Float[Array, ""]
    sine: Float[Array, ""]
    seen_end: Float[Array, ""]
    clearance: Float[Array, ""]

    @property
    @override
    def radius(self) -> Float[Array, ""]:
        return self.cylinder.radius

    @property
    @override
    def deepest(self) -> Vec3:
        body = self.cylinder
        c, a = Vec3.from_array(body.center), Vec3.from_array(body.axis)
        across = Vec3(-a.x * a.z, -a.y * a.z, 1 - a.z * a.z).normalize()
        end = jnp.where(a.z < 0, -body.height, body.height) / 2
        return c + a * end + across * body.radius

    @property
    def end_on(self) -> Bool[Array, ""]:
        """Whether the outline is a single rim, that of the seen end."""
        return (self.sine == 0) & (self.seen_end != 0)

    @property
    @jax.jit
    def lines(self) -> Float[Array, "2 2 3"]:
        """End points of the two tangent lines, in the order of the curve.

        Seen end on, all four are one point of the rim.
        """
        end = jnp.array([[-1, 1], [1, -1]], self.sine.dtype)
        share = jnp.where(self.end_on, self.seen_end, end)
        sine = self.sine * jnp.array([[1, 1], [-1, -1]], self.sine.dtype)
        return self.point(share, jnp.full_like(sine, self.cosine), sine)

    @property
    @jax.jit
    def arcs(self) -> Float[Array, "2 2"]:
        """First and last rim angle of the arcs at the ends of -axis and +axis.

        Seen end on, one goes all the way round and the other is empty.
        """
        end = jnp.array([-1, 1], self.sine.dtype)
        first = end * jnp.arctan2(self.sine, self.cosine)
        # From one tangent line to the other: the near way, or the far way round.
        turn = jnp.where(self.seen_end == end, end * (2 * jnp.pi), 0)
        return jnp.stack([first, turn - first], axis=1)

    @property
    @jax.jit
    def conics(self) -> Float[Array, "2 3 3"]:
        """Images of the rims at the ends of -axis and +axis.

        Symmetric matrices Q: x^T Q x is 0 for the points x = (x, y, 1) of the conic and
        negative within the rim.
        """
        a, r = self.cylinder.axis, self.cylinder.radius
        end = jnp.array([[-1], [1]], r.dtype)
        c = self.cylinder.center[None] + end * (a * (self.cylinder.height / 2))[None]
        c_a = jnp.sum(c * a[None], axis=1)[:, None, None]
        c_c = jnp.sum(c * c, axis=1)[:, None, None]
        mixed = c[:, :, None] * a[None, None]
        mixed = mixed + mixed.swapaxes(1, 2)
        outer = (a[:, None] * a[None])[None]
        # |c_a x - (a.x) c|^2 - r^2 (a.x)^2: where the ray x meets the plane of the rim.
        unit = jnp.eye(3, dtype=r.dtype)[None]
        return c_a * c_a * unit - c_a * mixed + (c_c - r * r) * outer

    @override
    def place(self, parameter: Float[Array, "*batch"]) -> Place:
        """Where on the body a point of the curve is.

        Args:
            parameter: In [0, 4]; the pieces meet at whole numbers. Seen end on, the
                rim takes all of it.

        Returns:
            Share of the half height, in [-1, 1], cosine and sine of the rim angle.
        """
        s = parameter
        share = jnp.clip(jnp.where(s < 2, 2 * s - 1, 5 - 2 * s), -1, 1)
        share = jnp.where(self.end_on, self.seen_end, share)
        end = jnp.where(s < 3, 1, -1)
        along_arc = jnp.where(s < 3, jnp.clip(s - 1, 0, 1), s - 3)
        end = jnp.where(self.end_on, self.seen_end, end)
        along_arc = jnp.where(self.end_on, s / 4, along_arc)
        # Half the rim angle, counted from the middle of the arc, is the direction of
        # (p, q), which goes along two chords: smooth enough, and no trigonometry.
        far = end == self.seen_end
        side = jnp.where(far, -1, 1)
        turn = end * side * (1 - 2 * along_arc)
        cos_half, sin_half = (1 + self.cosine) / 2, self.sine / 2
        p = 1 - jnp.abs(turn) * (1 - jnp.where(far, sin_half, cos_half))
        q = turn * jnp.where(far, cos_half, sin_half)
        scale = side / (p * p + q * q)
        return share, (p * p - q * q) * scale, 2 * p * q * scale

    @override
    def vectors(self) -> Float[Array, "4 3"]:
        """Center, half the axis, and the radii at rim angles 0 and 90 degrees."""
        body, a = self.cylinder, self.cylinder.axis
        across, still = jax.lax.stop_gradient(
            (jnp.stack([self.toward, self.beside]), a)
        )
        # Zero, with the derivative that keeps the vectors across the axis.
        lean = jnp.sum(across * (a - still)[None], axis=1)
        across = body.radius * (across - lean[:, None] * still[None])
        return jnp.stack([body.center, a * (body.height / 2), across[0], across[1]])


@near_its_camera
@jax.jit
def outline(primitive: AbstractPrimitive, camera: AbstractCamera) -> AbstractOutline:
    """Outline of a shape for a camera, in closed form.

    Args:
        primitive: A whole `Cylinder` or a `Sphere`, a single one, in the world frame;
            it may reach behind the camera.
        camera: Its pose is used, and nothing else.

    Returns:
        An `Outline`, two lines and two arcs, of a cylinder; a `SphereOutline`, a
        circle, of a sphere.

    Raises:
        ValueError: The shape is of another type, a batch, or a cylinder that is open
            or a sector; or the camera has no center.
    """
    check_central(camera)
    outline_of = _OUTLINES.get(type(primitive))
    if outline_of is None:
        raise ValueError(
            "primitive must be a Cylinder or a Sphere to have an outline in closed "
            f"form, got a {type(primitive).__name__}"
        )
    check_single(primitive)
    return outline_of(in_camera_frame(primitive, camera))


def _cylinder_outline(cylinder: Cylinder) -> Outline:
    """Outline of a cylinder in the camera frame."""
    if not cylinder.is_whole:
        raise ValueError(
            "cylinder must be closed and go all the way round to have an outline in "
            "closed form, got an open one or a sector"
        )
    cylinder = eqx.tree_at(lambda c: c.axis, cylinder, unit(cylinder.axis))
    c, a = Vec3.from_array(cylinder.center), Vec3.from_array(cylinder.axis)
    r, along = cylinder.radius, c.dot(a)
    across = c - a * along
    # Once more, since a far center leaves a rounding along the axis.
    across = across - a * across.dot(a)
    distance = across.norm()
    # On the axis, to rounding, any direction serves.
    off_axis = distance * distance > eps(r.dtype, 4) ** 2 * c.dot(c)
    inverse = safe_divide(jnp.ones_like(distance), distance)
    fallback = Vec3.from_array(tangent_basis(cylinder.axis)[0])
    toward = (across * -inverse).where(off_axis, fallback)
    in_wall = distance < r
    gap = (distance - r) * (distance + r)
    past_cap = jnp.abs(along) - cylinder.height / 2
    return Outline(
        cylinder=cylinder,
        toward=toward.stack(),
        beside=a.cross(toward).stack(),
        cosine=jnp.where(in_wall, 1, r * inverse),
        sine=jnp.where(in_wall, 0, safe_sqrt(gap) * inverse),
        # The camera is at the origin: it sees the cap that the center looks away from.
        seen_end=jnp.where(past_cap > 0, -jnp.sign(along), 0),
        clearance=jnp.maximum(distance - r, past_cap),
    )


_OUTLINES: dict[type[AbstractPrimitive], Callable[[Any], AbstractOutline]] = {
    Cylinder: _cylinder_outline,
    Sphere: sphere_outline,
}
