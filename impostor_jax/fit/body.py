"""What a fit needs of a shape: how rays pass it, and how it moves.

The wall of each shape is a quadric. Along a ray it is A t^2 - 2 B t + C, so the ray
passes it nearest at n = B / A, and cuts it half a chord before and behind, whose square
is q = n^2 - C / A. Both are smooth where the ray grazes the wall and beyond.
"""

__all__ = [
    "AbstractBody",
    "Passing",
    "Readout",
    "SurfaceSeen",
    "blunted_root",
    "coordinates_of",
]

import abc
from collections import OrderedDict
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.rows import Rows
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.base import AbstractPrimitive

Numbers = Float[Array, "*batch"]

Readout = OrderedDict[str, Array]
"""What a user reads of a shape, by name, in an order that JAX keeps."""


class Passing(eqx.Module):
    """How a ray's line passes a body.

    Attributes:
        local: The ray, relative to the body's center, from its point nearest to there.
        foot: Depth of that point.
        inverse: 1 / A; 0 for a ray that never crosses the wall.
        m: A vector that its shape needs for derivatives.
        nearest: Ray parameter of the nearest approach, from the foot.
        square: Squared half-chord in the infinite wall, negative on a miss.
        half: Half-chord, blunted; negative on a miss, and where A is negative: a ray
            within a cone enters it where it passes nearer to the axis of the other
            nappe.
        bend: Derivative of the half-chord in its square.
        outside: Whether the ray starts outside the solid.
        cap: Ray parameter of the cap that it would see.
        on_cap: Whether it sees that, or would if that went on past its rim.
        rim: Distance from the axis of the point in that cap's plane.
        wide: Radius of that cap.
        falls: How far past the rim that is. The depth grows by it there, so that the
            object's pixels draw the rim out.
        keep: Far past it the depth goes back to the wall's, since a ray along the
            plane meets it anywhere: weight of the plane, 1 on the cap.
    """

    local: Ray
    foot: Numbers
    inverse: Numbers
    m: Vec3
    nearest: Numbers
    square: Numbers
    half: Numbers
    bend: Numbers
    outside: Bool[Array, "*batch"]
    cap: Numbers
    on_cap: Bool[Array, "*batch"]
    rim: Numbers
    wide: Numbers
    falls: Numbers
    keep: Numbers

    @property
    def sign(self) -> Numbers:
        """-1 where the ray sees the wall that it enters, 1 where it leaves it."""
        return jnp.where(self.outside, -1.0, 1.0).astype(self.half.dtype)

    @property
    def wall(self) -> Numbers:
        """Ray parameter of the wall that it sees, from the foot."""
        return self.nearest + self.sign * self.half

    @property
    def depth(self) -> Numbers:
        """Depth of the surface, continued past its outline."""
        on_plane = self.wall + (self.cap + self.falls - self.wall) * self.keep
        return jnp.where(self.on_cap, on_plane, self.wall) + self.foot


def blunted_root(
    square: Numbers, chord: float | Float[Array, "*#batch"]
) -> tuple[Numbers, Numbers]:
    """Half-chord from its square, blunted as `Rows.chord` says, and its derivative."""
    fourth = jnp.maximum(square**2 + chord**4, np.finfo(square.dtype).tiny)
    blunt = jax.lax.rsqrt(jnp.sqrt(fourth))
    half = square * blunt
    return half, blunt * (1 - (half * blunt) ** 2 / 2)


class SurfaceSeen(eqx.Module):
    """What a ray sees of a body, continued past its outline.

    A body without ends has 0 for all that is said of them.

    Attributes:
        depth: In meters; finite for every ray.
        cos_incidence: Cosine between the surface's normal and the ray.
        outside: Whether the ray starts outside, and sees the surface that it enters.
        on_cap: Whether the surface is a cap.
        nearest: Depth of the nearest approach to the axis.
        square: Squared half-chord of the ray in the wall, in depth; negative on a miss.
        along: Coordinate along the axis, from the center, of the wall's point.
        enter_along: Of the point where the ray enters the wall.
        leave_along: Of the point where it leaves it.
        slope: Component of the ray's direction along the axis.
        cap_distance: Distance from the axis of the point in the plane of the cap that
            the ray would see, in radii of that cap.
    """

    depth: Numbers
    cos_incidence: Numbers
    outside: Bool[Array, "*batch"]
    on_cap: Bool[Array, "*batch"]
    nearest: Numbers
    square: Numbers
    along: Numbers
    enter_along: Numbers
    leave_along: Numbers
    slope: Numbers
    cap_distance: Numbers


class AbstractBody(eqx.Module):
    """A shape as a fit moves it, in meters.

    It moves in natural coordinates, in radians, meters and logarithms of lengths, that
    differ from shape to shape.

    Attributes:
        coordinates: Names of the covariance's coordinates, in its order, for each name
            of `readout` that they belong to.
        ends: The ends that it has, -1 and 1 along its axis.
        center: Center.
        radius: Radius, at the center.
    """

    coordinates: ClassVar[dict[str, tuple[str, ...]]]
    ends: ClassVar[tuple[int, ...]]
    center: eqx.AbstractVar[Float[Array, "*batch 3"]]
    radius: eqx.AbstractVar[Numbers]

    @staticmethod
    @abc.abstractmethod
    def of(shape: Any) -> "AbstractBody":
        """The body of a primitive."""

    @property
    @abc.abstractmethod
    def shape(self) -> AbstractPrimitive:
        """The primitive that it is."""

    @property
    @abc.abstractmethod
    def size(self) -> Numbers:
        """Half the size: what an angle of one radian moves the surface by."""

    @property
    @abc.abstractmethod
    def sign(self) -> Numbers:
        """-1 where the largest component of its axis is negative, otherwise 1."""

    @property
    @abc.abstractmethod
    def numbers(self) -> Float[Array, "*batch p"]:
        """All that is fitted, in the order of the derivatives of `compared`."""

    @abc.abstractmethod
    def passing(
        self, direction: Vec3, chord: float | Float[Array, "*#batch"]
    ) -> Passing:
        """How rays from the origin pass the body.

        Args:
            direction: Of the rays.
            chord: Half-chord below which the square root gives way, as in `Rows`.
        """

    @abc.abstractmethod
    def seen(self, passing: Passing) -> SurfaceSeen:
        """What each ray sees, continued past the outline."""

    @abc.abstractmethod
    def compared(
        self,
        rows: Rows,
        passing: Passing,
        error: Numbers,
        alpha: Numbers,
        beta: Numbers,
    ) -> tuple[Numbers, list[Numbers]]:
        """Error of each row, ends and caps included, and its derivative in `numbers`.

        Args:
            rows: What the image says.
            passing: How the rows' rays pass the body.
            error: Body less image, of rows that say nothing of an end.
            alpha: Its derivative in the nearest approach.
            beta: Its derivative in the squared half-chord.
        """

    @abc.abstractmethod
    def margins(self, seen: SurfaceSeen) -> Float[Array, "k n m"]:
        """Margins of which one passes 0 at the outline, positive outside.

        That of the wall first, then those of the ends that face away and the camera.
        """

    @abc.abstractmethod
    def covers(self, seen: SurfaceSeen) -> Bool[Array, "*batch"]:
        """Which rays from outside the body meets."""

    @abc.abstractmethod
    def moved(
        self, natural: Float[Array, " c"], fixed: tuple[str, ...]
    ) -> "AbstractBody":
        """The body at natural coordinates, which are 0 here.

        Args:
            natural: Natural coordinates.
            fixed: Names of the parameters that do not move.
        """

    @abc.abstractmethod
    def steps(
        self, unit: Float[Array, ""], end_unit: Float[Array, ""]
    ) -> Float[Array, " c"]:
        """Natural coordinates that move the surface, and an end, by a unit each."""

    @abc.abstractmethod
    def free_directions(self, fixed: tuple[str, ...]) -> Float[np.ndarray, "c n"]:
        """Natural coordinates, or combinations of them, that are free to move."""

    @abc.abstractmethod
    def moving(self, fixed: tuple[str, ...]) -> tuple[int, ...]:
        """Places in `numbers` of those that move where some parameters do not."""

    @abc.abstractmethod
    def transformed(self, target_from_source: RigidTransform) -> "AbstractBody":
        """Express the same body in another frame."""

    @abc.abstractmethod
    def readout(self, near: Any, ends_seen: Bool[Array, " e"]) -> Readout:
        """What a user reads of a body of the world, in meters and radians.

        Of the axis, turned to that of a body nearby, it is what lies across that and
        along it, in the vectors of its `tangent_basis`.

        Args:
            near: A body of the same kind, with which this one is compared.
            ends_seen: Whether each of its `ends` is seen. Of one that is not, a radius
                is that of the wall beside the end of `near`.
        """

    @abc.abstractmethod
    def reversed(self, sign: Float[Array, ""]) -> "AbstractBody":
        """The same body with its axis turned round where the sign is -1."""

    @abc.abstractmethod
    def drawn_in(
        self, ends_seen: Bool[Array, " e"], reach: Float[Array, " e"]
    ) -> "AbstractBody":
        """The same wall, up to where it reaches at an end that is not seen.

        Args:
            ends_seen: Whether each of its `ends` is seen.
            reach: How far the wall is seen towards each, from the center; `-inf` where
                it is not.
        """

    @abc.abstractmethod
    def mirrored(self) -> "AbstractBody":
        """Tilt the other way, which looks the same from afar but for its depth."""

    @abc.abstractmethod
    def distance(self, others: Any) -> Float[Array, " k"]:
        """How far the wall of each lies from this one's, in meters.

        Args:
            others: A batch (k,) of the same kind.
        """


def coordinates_of(body: AbstractBody | type[AbstractBody]) -> tuple[str, ...]:
    """Coordinates of the covariance, in radians and meters."""
    return tuple(name for names in body.coordinates.values() for name in names)
