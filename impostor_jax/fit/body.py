"""What a fit needs of a shape: how rays pass it, how that changes, and how it moves.

The wall of each shape is a quadric. Along a ray it is A t^2 - 2 B t + C, so the ray
passes it nearest at n = B / A, and cuts it half a chord before and behind, whose square
is q = n^2 - C / A. Both are smooth where the ray grazes the wall and beyond. All that
is compared with the wall changes with a motion of the body by alpha dn + beta dq.
"""

__all__ = [
    "AbstractAxislessBody",
    "AbstractBody",
    "Chord",
    "FreeDirections",
    "Margins",
    "Passing",
    "Rays",
    "Readout",
    "blunted_root",
    "change_of",
    "coordinates_of",
    "grown",
    "local_ray",
    "shift_to",
]

import abc
from collections import OrderedDict
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.geometry.frames import RigidTransform, moved_by
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, product, safe_sqrt
from impostor_jax.primitives.base import AbstractPrimitive

Readout = OrderedDict[str, Array]
"""What a user reads of a shape, by name, in an order that JAX keeps."""

FreeDirections = Float[Array, "c c"] | Float[np.ndarray, "c c"]
"""As `AbstractBody.free_directions` returns them; a trace may know their values."""

Chord = float | Float[Array, "*#batch"]
"""Length of a part of a ray, in its parameter."""

AHEAD = 0.1
"""Cosine of the angle from the camera's z axis to a center up to which the plane of
that center, where rays begin, is not far from it."""


class Rays(NamedTuple):
    """Rays that a camera sees a body by.

    Attributes:
        direction: Of each, with z = 1.
        start: Where they begin; None for the origin.
    """

    direction: Vec3
    start: Vec3 | None = None


class Passing(eqx.Module):
    """How rays from the camera pass a body, continued past its outline.

    A body without ends has 0 for all that is said of them.

    Attributes:
        local: The ray from the plane of the body's center on, in the body's own frame.
        foot: Depth of that plane, from where a ray begins.
        inverse: 1 / A; 0 for a ray that never crosses the wall.
        nearest: Ray parameter of the nearest approach, from the foot.
        square: Squared half-chord in the infinite wall, negative on a miss.
        half: Half-chord, blunted; negative on a miss, and where A is negative: a ray
            within a cone enters it where it passes nearer to the axis of the other
            nappe.
        half_slope: Derivative of the half-chord in its square.
        outside: Whether the ray starts outside the solid, and sees what it enters.
        within: Whether the wall that it sees is that of a bore, which it leaves.
        cos_incidence: Cosine between the normal of the surface that it sees and it.
        cap: Ray parameter of the cap that it would see.
        on_cap: Whether it sees that, or would if that went on past its rim.
        rim: Distance from the axis of the point in that cap's plane.
        cap_radius: Radius of that cap.
        overshoot: How far past the rim that is. The depth grows by it there, so that
            the object's pixels draw the rim out.
        plane_weight: Weight of the plane's depth, 1 on the cap. Far past the rim the
            depth goes back to the wall's, since a ray along the plane meets it
            anywhere.
        along: Coordinate along the axis, from the center, of the wall's point.
        enter_along: Of the point where the ray enters the wall.
        leave_along: Of the point where it leaves it.
    """

    local: Ray
    foot: Float[Array, "*#batch"]
    inverse: Numbers
    nearest: Numbers
    square: Numbers
    half: Numbers
    half_slope: Numbers
    outside: Bool[Array, "*batch"]
    within: Bool[Array, "*batch"]
    cos_incidence: Numbers
    cap: Numbers
    on_cap: Bool[Array, "*batch"]
    rim: Numbers
    cap_radius: Numbers
    overshoot: Numbers
    plane_weight: Numbers
    along: Numbers
    enter_along: Numbers
    leave_along: Numbers

    @property
    def sign(self) -> Numbers:
        """-1 where the ray sees the wall that it enters, 1 where it leaves it."""
        enters = self.outside & ~self.within
        return jnp.where(enters, -1.0, 1.0).astype(self.half.dtype)

    @property
    def depth(self) -> Numbers:
        """Depth of the surface, continued past its outline; finite for every ray."""
        wall = self.nearest + self.sign * self.half
        on_plane = wall + (self.cap + self.overshoot - wall) * self.plane_weight
        return jnp.where(self.on_cap, on_plane, wall) + self.foot

    def with_chord(self, chord: Numbers) -> "Passing":
        """The same blunted elsewhere."""
        half, slope = blunted_root(self.square, chord)
        within = jnp.sign(self.inverse)
        halves = half * within, slope * within
        return eqx.tree_at(lambda p: (p.half, p.half_slope), self, halves)

    def square_at(self, distance: Numbers, radius: Float[Array, "*#batch"]) -> Numbers:
        """Squared half-chord of a ray so far within the outline of the wall.

        Half-chords are along rays, and longer than across the axis.

        Args:
            distance: In meters; negative outside of the outline.
            radius: Of the wall.
        """
        return (2 * radius - distance) * distance * jnp.abs(self.inverse)

    @property
    def is_past_rim(self) -> Bool[Array, "*batch"]:
        """Whether it sees the plane of a cap beyond that cap."""
        return self.on_cap & (self.rim > 1.05 * self.cap_radius)

    def is_beside_rim(self, distance: Float[Array, "*#batch"]) -> Bool[Array, "*batch"]:
        """Whether it passes the rim of the cap ahead by less than a distance.

        Args:
            distance: In meters, in the plane of that cap.
        """
        is_near = jnp.abs(self.rim - self.cap_radius) < distance
        return is_near & (self.cap_radius > 0)

    @property
    def is_missed(self) -> Bool[Array, "*batch"]:
        """Whether the ray passes the body by, at its wall or past the rim of a cap."""
        return self.is_past_rim | (~self.on_cap & (self.square < 0))


class Margins(NamedTuple):
    """What passes 0 where a body's outline does, one for each of its parts.

    That of the wall first, then those of the ends that face away and the camera. Of a
    body with a bore two more, of the same ends as they are seen in it; beside any other
    place these do not change.

    Attributes:
        value: Positive outside. The largest tells of the outline.
        tells: Whether rays are where that part has a place.
        end: Which of the body's ends each is of; 0 of the wall.
        side: Of each, as `of_end` takes it.
        line: The number of the line in the image that each is on, one for each end, and
            for each in a bore.
        lines: The numbers that there are.
    """

    value: Float[Array, "k n m"]
    tells: Bool[Array, "k n m"]
    end: Float[Array, "k m"]
    side: Float[np.ndarray, " k"]
    line: Float[Array, "k m"]
    lines: tuple[float, ...]


def blunted_root(square: Numbers, chord: Chord) -> tuple[Numbers, Numbers]:
    """Half-chord from its square, and its derivative.

    Below `chord` the square root gives way to a straight line, so that a solver can
    cross the outline: sqrt(q) becomes q / (q^2 + chord^4)^(1/4).
    """
    fourth = jnp.maximum(square**2 + chord**4, np.finfo(square.dtype).tiny)
    blunt = jax.lax.rsqrt(jnp.sqrt(fourth))
    half = square * blunt
    return half, blunt * (1 - (half * blunt) ** 2 / 2)


def local_ray(
    rays: Rays, center: Float[Array, "3"], frame: Float[Array, "3 3"]
) -> tuple[Ray, Numbers]:
    """Rays from the camera, from the plane of a center on; and the depth of that plane.

    Relative to a center in front of the camera, the point in its plane is the depth
    times the difference of two directions, which loses no digits to the distance.

    Args:
        rays: Of the camera.
        center: What they are relative to.
        frame: Unit vectors along which the result's components are.
    """
    direction, start = rays
    if start is not None:
        return _local_ray_from(direction, center, frame, start)
    is_ahead = center[2] > AHEAD * jnp.sqrt(jnp.sum(center**2))
    foot = jnp.where(is_ahead, center[2], 0)
    toward = jnp.where(is_ahead, center[:2] / jnp.where(is_ahead, center[2], 1), 0)
    rest = product(frame, jnp.where(is_ahead, 0, center))
    x, y = direction.x, direction.y
    near_x, near_y = foot * (x - toward[0]), foot * (y - toward[1])
    origin = [near_x * f[0] + near_y * f[1] - r for f, r in zip(frame, rest)]  # noqa: B905
    turned = [x * f[0] + y * f[1] + f[2] for f in frame]
    return Ray(Vec3(*origin), Vec3(*turned)), foot


def _local_ray_from(
    direction: Vec3, center: Float[Array, "3"], frame: Float[Array, "3 3"], start: Vec3
) -> tuple[Ray, Numbers]:
    """As `local_ray`, of rays that each begin elsewhere: the depth is from there."""
    foot = center[2] - start.z
    x = start.x - center[0] + direction.x * foot
    y = start.y - center[1] + direction.y * foot
    origin = [x * f[0] + y * f[1] for f in frame]
    turned = [direction.x * f[0] + direction.y * f[1] + f[2] for f in frame]
    return Ray(Vec3(*origin), Vec3(*turned)), foot


class AbstractBody(eqx.Module):
    """A shape as a fit moves it, in meters, in the camera's frame or the world's.

    It moves in tangent coordinates, in radians, meters and logarithms of lengths, that
    differ from shape to shape and are 0 where it is.

    Attributes:
        center: Center.
        radius: Radius, at the center.
    """

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
    def coordinates(self) -> dict[str, tuple[str, ...]]:
        """Names of the covariance's coordinates, for each name of `readout`."""

    @property
    @abc.abstractmethod
    def ends(self) -> tuple[int, ...]:
        """The ends that it has, -1 and 1 along its axis."""

    @property
    @abc.abstractmethod
    def end_axes(self) -> Float[Array, "e 3"]:
        """Unit vectors outward across each of `ends`."""

    @property
    def of_ends(self) -> tuple[str, ...]:
        """What is known where each of `ends` is seen, by its name in `readout`."""
        return ()

    @property
    @abc.abstractmethod
    def sign(self) -> Numbers:
        """-1 where the largest component of its axis is negative, otherwise 1."""

    @property
    @abc.abstractmethod
    def is_long(self) -> Bool[Array, "*batch"]:
        """Whether its outline tells its tilt where its depth does not."""

    @property
    @abc.abstractmethod
    def is_square(self) -> Bool[Array, "*batch"]:
        """Whether its outline may be that of one whose axis is across its own."""

    @abc.abstractmethod
    def passing(self, rays: Rays, chord: Chord = 0.0, apart: bool = False) -> Passing:
        """How rays pass the body.

        Args:
            rays: Of the camera.
            chord: Half-chord below which the square root gives way, as in
                `blunted_root`.
            apart: Whether what all else follows from is computed once. Of 2560 rays of
                which much is asked that takes 55 us for 75, of more readings longer.
        """

    @abc.abstractmethod
    def covers(self, passing: Passing) -> Bool[Array, "*batch"]:
        """Which rays from outside the body meets."""

    @abc.abstractmethod
    def end_shown(self, passing: Passing, depth: Numbers, slack: Numbers) -> Numbers:
        """Which of the `ends` readings show, as they could not be the wall's; or 0.

        Args:
            passing: How their rays pass the body.
            depth: That was read.
            slack: By how much a reading of the wall may be off.
        """

    @abc.abstractmethod
    def width_of_ends(self, beside: Float[Array, ""]) -> Float[Array, " e"]:
        """Readings across the cap at each end; 0 where there is none, or none tell.

        Args:
            beside: Readings of what is between the ends.
        """

    @abc.abstractmethod
    def outward(self, passing: Passing) -> Float[Array, "e n"]:
        """How far towards each end rays see the body, from its center; or -inf."""

    @abc.abstractmethod
    def far_side(self, passing: Passing) -> Numbers:
        """Ray parameter up to which a ray that meets the body sees nothing behind."""

    @abc.abstractmethod
    def of_reading(
        self, passing: Passing, alpha: Numbers, beta: Numbers, on_cap: Bool[Array, "*b"]
    ) -> list[Numbers]:
        """Derivative of what is compared, in tangent coordinates.

        Args:
            passing: How the rays pass the body.
            alpha: Derivative in the nearest approach.
            beta: Derivative in the squared half-chord.
            on_cap: Rows that compare the depth of a cap's plane, too.
        """

    def swelling(self, gradient: Float[Array, "c n"]) -> Float[Array, " n"] | None:
        """Derivative in the logarithm of the radius of its wall, alike all along.

        None of a body whose first coordinates do not tilt an axis, and move it across
        itself, or that has more walls than one.

        Args:
            gradient: In tangent coordinates, a reading a column.
        """
        del gradient
        return None

    @property
    @abc.abstractmethod
    def bends(self) -> int:
        """Dimensions of space in which the wall bends: 3 of a ball, 2 of a cylinder."""

    @abc.abstractmethod
    def wall_square(self, passing: Passing) -> Numbers:
        """Squared radius of the wall where rays see it."""

    @abc.abstractmethod
    def moved_across(
        self, passing: Passing, square: Numbers, slide: Numbers
    ) -> Passing:
        """The same of rays moved across themselves, by the least that does it.

        Args:
            passing: How the rays pass the body.
            square: Squared half-chord of the moved ones. It is at most that of a ray
                through the axis, or the center.
            slide: How far they are moved along the axis, too, in steps of what the ray
                goes along it for one of its parameter.
        """

    @abc.abstractmethod
    def margins(self, passing: Passing) -> Margins:
        """What passes 0 at the outline.

        Args:
            passing: How rays pass the body: the first along the first axis through a
                pixel of the object, the others through its neighbors.
        """

    @abc.abstractmethod
    def of_end(
        self, passing: Passing, end: Numbers, side: Numbers
    ) -> tuple[Numbers, list[Numbers]]:
        """How far beyond an end's plane rays meet the wall, and its derivative.

        Args:
            passing: How the rays pass the body.
            end: -1 at the end `center - axis * height / 2`, 1 at the other.
            side: -1 where a ray enters the wall (an end that faces away), 1 where it
                leaves it. In a bore the other way round: 1 at the end that faces away,
                -1 at the rim of the one that faces the camera.
        """

    @abc.abstractmethod
    def retracted(
        self, tangent: Float[Array, " c"], free: FreeDirections
    ) -> "AbstractBody":
        """The retraction: the body at tangent coordinates.

        Args:
            tangent: Tangent coordinates.
            free: As `free_directions` returns them.
        """

    @abc.abstractmethod
    def free_basis(
        self,
        free: FreeDirections,
        unit: Float[Array, ""],
        end_unit: Float[Array, ""],
    ) -> Float[Array, "c c"]:
        """Tangent coordinates that one unit of each free coordinate moves, as columns.

        Levenberg-Marquardt damps with the identity, so all move the surface alike.

        Args:
            free: As `free_directions` returns them.
            unit: By how much, in meters.
            end_unit: The same of the ends, which a pixel's size may blur more than the
                noise does the wall.
        """

    @abc.abstractmethod
    def free_directions(self, fixed: tuple[str, ...]) -> Float[np.ndarray, "c c"]:
        """Tangent coordinates, or combinations of them, that are free to move.

        They are the columns; those of what is held are 0.
        """

    @abc.abstractmethod
    def transformed(self, target_from_source: RigidTransform) -> "AbstractBody":
        """Express the same body in another frame."""

    @abc.abstractmethod
    def carried(self, target_from_source: RigidTransform) -> Float[Array, "c c"]:
        """Tangent coordinates there that each of its own moves the body by, one a row.

        Args:
            target_from_source: To the frame that the body is `transformed` to.
        """

    def rigid_moves(self) -> Float[Array, "6 c"]:
        """Tangent coordinates by which a turn and a shift of all that is seen move it.

        One a row: of turns about the axes of its frame, in radians, and of shifts along
        these, in meters.
        """
        free = self.free_directions(())
        dtype = self.center.dtype

        def leaves(body: AbstractBody) -> Float[Array, " m"]:
            return jnp.concatenate([jnp.ravel(x) for x in jax.tree.leaves(body)])

        def moved(by: Float[Array, "6"]) -> Float[Array, " m"]:
            return leaves(self.transformed(moved_by(by)))

        def retracted(tangent: Float[Array, " c"]) -> Float[Array, " m"]:
            return leaves(self.retracted(tangent, free))

        by_tangent = jax.jacfwd(retracted)(jnp.zeros(len(free), dtype))
        by_motion = jax.jacfwd(moved)(jnp.zeros(6, dtype))
        own = product(by_tangent.T, by_tangent)
        # A tip has no radius to change.
        own += jnp.diag(jnp.where(jnp.diagonal(own) > 0, 0, 1).astype(dtype))
        return jax.scipy.linalg.solve(
            own, product(by_tangent.T, by_motion), assume_a="pos"
        ).T

    @abc.abstractmethod
    def magnified(self, change: Numbers) -> "AbstractBody":
        """What looks the same from the origin, larger and farther away.

        Args:
            change: Of the logarithm of its size, to first order.
        """

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
    ) -> tuple["AbstractBody", Float[Array, "c c"]]:
        """The same wall, up to where it reaches at an end that is not seen.

        Args:
            ends_seen: Whether each of its `ends` is seen.
            reach: How far the wall is seen towards each, from the center; `-inf` where
                it is not.

        Returns:
            The body, and what of this one's tangent coordinates moves the wall as one
            of the other's does.
        """

    @abc.abstractmethod
    def mirrored(self) -> "AbstractBody":
        """Tilt the other way, which looks the same from afar but for its depth."""

    @abc.abstractmethod
    def turned(self) -> "AbstractBody":
        """Turn the axis by a quarter in the image; length and width change places.

        That looks much the same from afar but for its depth, where `is_square`.
        """


class AbstractAxislessBody(AbstractBody):
    """A body that is round about no axis: there is none to sign, tilt or turn."""

    @property
    @override
    def sign(self) -> Numbers:
        return jnp.ones_like(self.radius)

    @property
    @override
    def is_square(self) -> Bool[Array, "*batch"]:
        return jnp.zeros(self.radius.shape, bool)

    @override
    def wall_square(self, passing: Passing) -> Numbers:
        return self.radius**2 * jnp.ones_like(passing.square)

    @override
    def reversed(self, sign: Float[Array, ""]) -> AbstractBody:
        return self

    @override
    def mirrored(self) -> AbstractBody:
        return self

    @override
    def turned(self) -> AbstractBody:
        return self


def shift_to(passing: Passing, aside: Numbers, square: Numbers) -> Numbers:
    """Part of its distance from the axis or center by which a ray is moved outward.

    Along a ray the wall's quadric is A (t - n)^2 - A q, so what the squared distance of
    the nearest approach gains, A q loses.

    Args:
        passing: How rays pass a body.
        aside: Squared distance of their nearest approaches.
        square: Squared half-chord of the moved ray.
    """
    tiny = jnp.finfo(aside.dtype).tiny
    crosses = (passing.inverse != 0) & (aside > tiny)
    per_inverse = 1 / jnp.where(crosses, passing.inverse, 1)
    wanted = jnp.maximum(aside + (passing.square - square) * per_inverse, 0)
    ratio = wanted / jnp.where(crosses, aside, 1)
    return jnp.where(crosses, safe_sqrt(ratio) - 1, 0)


def grown(change: Numbers) -> Numbers:
    """Factor on a length from a change of its logarithm, to first order.

    It is positive for any change. Nothing damps the steps of a solver, and exponentials
    of long ones would explode, or vanish for ever.
    """
    return (1 + jnp.maximum(change, 0)) / (1 - jnp.minimum(change, 0))


def change_of(factor: Numbers) -> Numbers:
    """Change of a logarithm, to first order, that `grown` makes a factor: its inverse.

    Args:
        factor: Positive.
    """
    return jnp.where(factor > 1, factor - 1, 1 - 1 / factor)


def coordinates_of(body: AbstractBody) -> tuple[str, ...]:
    """Coordinates of the covariance, in radians and meters."""
    return tuple(name for names in body.coordinates.values() for name in names)
