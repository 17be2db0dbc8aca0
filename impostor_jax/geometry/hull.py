"""How far shapes reach, in space and in an image: convex hulls of discs, and balls.

The hull of two discs holds a cylinder or a frustum, that of a box's corners, discs of
radius 0, the box. A camera in front of them keeps hulls, and each has an explicit
support function: how far it, or its image, reaches in a direction.
"""

__all__ = [
    "AbstractHull",
    "BallHull",
    "DiscHull",
    "JoinedHull",
    "OverlapHull",
    "Reach",
]

import abc
import functools
import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from impostor_jax.geometry.vec3 import Vec3, unit
from impostor_jax.numerics import Numbers, eps, safe_divide, safe_sqrt

Corner = Float[Array, "*batch 3"]

Reach = tuple[Float[Array, "*batch 4"], Numbers, Numbers]
"""How far an image reaches to -x, -y, x and y; smallest and largest depth."""


class AbstractHull(eqx.Module):
    """Convex set that holds a shape, or as many as a batch has; lengths in meters."""

    @abc.abstractmethod
    def box(self) -> tuple[Corner, Corner]:
        """Low and high corner of the box around it, along the axes of the frame.

        Wider by 16 eps of the largest coordinate, which holds the hit of every ray that
        starts no farther away than that: a hit is rounded as its ray is.
        """

    @abc.abstractmethod
    def ball(self) -> tuple[Corner, Numbers]:
        """Center and radius of a ball that holds it, wider as the box is."""

    @abc.abstractmethod
    def reach(self) -> Reach:
        """How far its image in the plane z = 1 reaches, seen from the origin.

        Not widened. Only a hull wholly in front has one: 0 where the smallest depth is
        not positive.
        """

    @abc.abstractmethod
    def moved(
        self, rotation: Float[Array, "*batch 3 3"], translation: Corner
    ) -> "AbstractHull":
        """The same hull in another frame: turned, then moved."""


class DiscHull(AbstractHull):
    """Convex hull of k discs; one of radius 0 is a point.

    Attributes:
        centers: Of the discs.
        axes: Unit vectors across them; zero for a point.
        radii: Of the discs.
    """

    centers: Float[Array, "*batch k 3"]
    axes: Float[Array, "*batch k 3"]
    radii: Float[Array, "*batch k"]

    @staticmethod
    def of_ends(
        first: Corner, second: Corner, axis: Corner, radius1: Numbers, radius2: Numbers
    ) -> "DiscHull":
        """Hull of two discs across one unit vector."""
        return DiscHull(
            jnp.stack([first, second], axis=-2),
            jnp.stack([axis, axis], axis=-2),
            jnp.stack([radius1, radius2], axis=-1),
        )

    @staticmethod
    def of_cylinder(
        center: Corner, axis: Corner, radius: Numbers, half_height: Numbers
    ) -> "DiscHull":
        """The cylinder around a center; `axis` as `unit` takes it."""
        a = unit(axis)
        way = a * half_height[..., None]
        return DiscHull.of_ends(center - way, center + way, a, radius, radius)

    @staticmethod
    def of_points(points: Float[Array, "*batch k 3"]) -> "DiscHull":
        """Hull of points."""
        return DiscHull(points, jnp.zeros_like(points), jnp.zeros_like(points[..., 0]))

    @staticmethod
    def of_cuboid(
        low: Corner,
        high: Corner,
        rotation: Float[Array, "*batch 3 3"],
        translation: Corner,
    ) -> "DiscHull":
        """Points p with low <= rotation^T (p - translation) <= high.

        The matrix need not be a rotation: corners are found by its inverse.
        """
        x, y, z = (Vec3.from_array(rotation[..., k]) for k in range(3))
        volume = x.dot(y.cross(z))
        scale = safe_divide(jnp.ones_like(volume), volume)
        edges = [v * scale for v in (y.cross(z), z.cross(x), x.cross(y))]
        is_high = np.array(list(itertools.product((False, True), repeat=3)))
        corners = jnp.where(is_high, high[..., None, :], low[..., None, :])
        points = translation[..., None, :]
        for k, edge in enumerate(edges):
            points = points + corners[..., k, None] * edge.stack()[..., None, :]
        return DiscHull.of_points(points)

    @override
    def box(self) -> tuple[Corner, Corner]:
        low, high = self._ends()
        return _widened(_smallest(low, -2), _largest(high, -2))

    @override
    def ball(self) -> tuple[Corner, Numbers]:
        center = jnp.mean(self.centers, axis=-2)
        q = Vec3.from_array(self.centers - center[..., None, :])
        a = Vec3.from_array(self.axes)
        along = q.dot(a)
        farthest = (q - a * along).norm() + self.radii
        distance = safe_sqrt(farthest * farthest + along * along)
        return _widened_ball(center, _largest(distance, -1))

    @override
    def reach(self) -> Reach:
        low, high = (ends[..., 2] for ends in self._ends())
        nearest, farthest = _smallest(low, -1), _largest(high, -1)
        sides = _disc_reach(
            Vec3.from_array(self.centers),
            Vec3.from_array(self.axes),
            self.radii,
            (low, high),
            (nearest > 0)[..., None],
        )
        return _largest(sides, -2), nearest, farthest

    @override
    def moved(
        self, rotation: Float[Array, "*batch 3 3"], translation: Corner
    ) -> "DiscHull":
        rotation = rotation[..., None, :, :]
        return DiscHull(
            _turned(rotation, self.centers) + translation[..., None, :],
            _turned(rotation, self.axes),
            self.radii,
        )

    def _ends(self) -> tuple[Float[Array, "*batch k 3"], Float[Array, "*batch k 3"]]:
        """Smallest and largest coordinates of each disc."""
        # Not sqrt(1 - a^2), which loses half the digits where the axis is along one of
        # the frame's.
        first, second = (jnp.roll(self.axes, shift, axis=-1) for shift in (1, 2))
        sine = safe_sqrt(first * first + second * second)
        reach = self.radii[..., None] * sine
        return self.centers - reach, self.centers + reach


class BallHull(AbstractHull):
    """Ball.

    Attributes:
        center: In meters.
        radius: In meters.
    """

    center: Corner
    radius: Numbers

    @override
    def box(self) -> tuple[Corner, Corner]:
        reach = self.radius[..., None]
        return _widened(self.center - reach, self.center + reach)

    @override
    def ball(self) -> tuple[Corner, Numbers]:
        return _widened_ball(self.center, self.radius)

    @override
    def reach(self) -> Reach:
        (x, y, z), r = jnp.moveaxis(self.center, -1, 0), self.radius
        nearest, farthest = z - r, z + r
        # The plane through the camera and the line n.x = s is r away from the center:
        # (n.c - s z)^2 = r^2 (1 + s^2).
        ahead = nearest > 0
        inverse = 1 / jnp.where(ahead, z, 1)
        x, y, size = (jnp.where(ahead, v, 0) * inverse for v in (x, y, r))
        square = jnp.where(ahead, (nearest * inverse) * (farthest * inverse), 1)
        middle, size, square = _sides(x, y), size[..., None], square[..., None]
        sides = (middle + size * safe_sqrt(middle * middle + square)) / square
        return sides, nearest, farthest

    @override
    def moved(
        self, rotation: Float[Array, "*batch 3 3"], translation: Corner
    ) -> "BallHull":
        return BallHull(_turned(rotation, self.center) + translation, self.radius)


class JoinedHull(AbstractHull):
    """What holds all of some hulls.

    Attributes:
        hulls: One or more.
    """

    hulls: tuple[AbstractHull, ...]

    @override
    def box(self) -> tuple[Corner, Corner]:
        low, high = zip(*(hull.box() for hull in self.hulls), strict=True)
        return functools.reduce(jnp.minimum, low), functools.reduce(jnp.maximum, high)

    @override
    def ball(self) -> tuple[Corner, Numbers]:
        # Around the middle of the box, as large as the farthest of their balls needs.
        low, high = self.box()
        middle = (low + high) / 2
        reach = []
        for hull in self.hulls:
            center, radius = hull.ball()
            reach.append(Vec3.from_array(center - middle).norm() + radius)
        return _widened_ball(middle, functools.reduce(jnp.maximum, reach))

    @override
    def reach(self) -> Reach:
        sides, nearest, farthest = zip(
            *(hull.reach() for hull in self.hulls), strict=True
        )
        return (
            functools.reduce(jnp.maximum, sides),
            functools.reduce(jnp.minimum, nearest),
            functools.reduce(jnp.maximum, farthest),
        )

    @override
    def moved(
        self, rotation: Float[Array, "*batch 3 3"], translation: Corner
    ) -> "JoinedHull":
        return JoinedHull(
            tuple(hull.moved(rotation, translation) for hull in self.hulls)
        )


class OverlapHull(AbstractHull):
    """What some hulls have in common, or more.

    Attributes:
        hulls: One or more.
    """

    hulls: tuple[AbstractHull, ...]

    @override
    def box(self) -> tuple[Corner, Corner]:
        low, high = zip(*(hull.box() for hull in self.hulls), strict=True)
        low = functools.reduce(jnp.maximum, low)
        # Of hulls that have nothing in common a point is left.
        return low, jnp.maximum(functools.reduce(jnp.minimum, high), low)

    @override
    def ball(self) -> tuple[Corner, Numbers]:
        # The smallest of theirs.
        center, radius = self.hulls[0].ball()
        for hull in self.hulls[1:]:
            other, size = hull.ball()
            center = jnp.where((size < radius)[..., None], other, center)
            radius = jnp.minimum(size, radius)
        return center, radius

    @override
    def reach(self) -> Reach:
        sides, nearest, farthest = zip(
            *(hull.reach() for hull in self.hulls), strict=True
        )
        # What is wholly in front of one of them is in front of the camera; the image of
        # one that is not tells nothing.
        known = [
            jnp.where((near > 0)[..., None], side, jnp.inf)
            for side, near in zip(sides, nearest, strict=True)
        ]
        near = functools.reduce(jnp.maximum, nearest)
        side = functools.reduce(jnp.minimum, known)
        far = jnp.maximum(functools.reduce(jnp.minimum, farthest), near)
        return jnp.where((near > 0)[..., None], side, 0), near, far

    @override
    def moved(
        self, rotation: Float[Array, "*batch 3 3"], translation: Corner
    ) -> "OverlapHull":
        hulls = (hull.moved(rotation, translation) for hull in self.hulls)
        return OverlapHull(tuple(hulls))


def _turned(
    rotation: Float[Array, "*#batch 3 3"], vectors: Float[Array, "*batch 3"]
) -> Float[Array, "*batch 3"]:
    # Not by a product of matrices, whose precision is another on a GPU.
    return jnp.sum(rotation * vectors[..., None, :], axis=-1)


def _disc_reach(
    c: Vec3,
    a: Vec3,
    r: Numbers,
    depths: tuple[Numbers, Numbers],
    ahead: Array,
) -> Float[Array, "*batch 4"]:
    """How far the image of a disc reaches to the four sides.

    The disc with center c, unit normal a and radius r has the dual conic
    r^2 (I - a a^T) - c c^T: the line n.x = s of the plane z = 1 touches its image where
    (n, -s) makes that form zero, a quadratic in s. Its discriminant is multiplied out:
    as it stands it cancels where the disc is small for its distance, or seen edge on.

    Args:
        c: Center.
        a: Normal; zero for a point.
        r: Radius.
        depths: Smallest and largest.
        ahead: Whether the smallest is positive; elsewhere the reach is 0.

    References:
        Hartley and Zisserman (2004), section 2.2.3, for the dual conic.
    """
    # In units of the center's depth, so that no power of it leaves the range.
    inverse = 1 / jnp.where(ahead, c.z, 1)
    x, y, r = (jnp.where(ahead, v, 0) * inverse for v in (c.x, c.y, r))
    low, high = (jnp.where(ahead, depth * inverse, 1) for depth in depths)
    middle, r = _sides(x, y), r[..., None]
    along, across, forward = _sides(a.x, a.y), _sides(a.y, a.x), a.z[..., None]
    # Of a disc whose normal is along the image's other axis, and of one seen head on;
    # any other has some of both.
    beside = r * middle
    edge_on = (beside * beside + r * r * (1 - r) * (1 + r)) * across * across
    head_on = r * forward + beside * along
    root = safe_sqrt(edge_on + head_on * head_on)
    return (middle + r * r * along * forward + root) / (low * high)[..., None]


def _sides(x: Numbers, y: Numbers) -> Float[Array, "*batch 4"]:
    """Components along the directions in which a box in the image ends."""
    return jnp.stack([-x, -y, x, y], axis=-1)


def _widened(low: Corner, high: Corner) -> tuple[Corner, Corner]:
    largest = _largest(jnp.maximum(jnp.abs(low), jnp.abs(high)), -1)
    room = (eps(low.dtype, 16) * largest)[..., None]
    return low - room, high + room


def _widened_ball(center: Corner, radius: Numbers) -> tuple[Corner, Numbers]:
    largest = radius + _largest(jnp.abs(center), -1)
    return center, radius + eps(radius.dtype, 16) * largest


def _largest(values: Array, axis: int) -> Array:
    """Largest along a short axis.

    By comparing two at a time: the derivative of `jnp.max` asks which values equal it,
    and is 0 / 0 where these, computed once more, are rounded otherwise and none does.
    """
    return functools.reduce(jnp.maximum, jnp.unstack(values, axis=axis))


def _smallest(values: Array, axis: int) -> Array:
    return functools.reduce(jnp.minimum, jnp.unstack(values, axis=axis))
