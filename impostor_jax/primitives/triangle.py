"""Triangle: an open sheet; a batch of them is a mesh.

From the ray's origin a corner is seen in some direction, of which q is the part across
the ray. The ray meets the triangle where the three q turn around it one way,

    d . (q_a x q_b),  d . (q_b x q_c),  d . (q_c x q_a)  all >= 0, or all <= 0,

and where 0 lies between the q along each axis, which keeps to their ends the tips that
are all but a line. The derivative follows from the equation of the plane
(`impostor_jax.primitives.surface`): with n the unit normal, of the corner a,

    n . (p - a) = 0

Watertight. Each comparison allows for the rounding of what it compares, always in favor
of the triangle, as if each corner were 8 eps of its distance wide. So a ray that meets
a triangle, in exact numbers, is never a miss, unless it starts within 8 eps /
sin(gamma) of the plane, and what a mesh closes stays closed at its edges and corners:
in any order of the corners, in any program, and however a compiler fuses
multiplications with additions. To compute an edge alike for both its sides (Woop et
al.) would not be enough here, since XLA rounds one formula in several ways, and a
camera's pose the corner that two triangles share. Of 10^6 rays at edges and corners
131110 are lost without a width, 74 with 1 eps, and none with 2.

Rounding. The corner with the largest part in the point that is hit stands for the
plane: it is no farther from that point than twice the corners' distances from the
origin of the world, each counted with its part, add up to. The move of the ray to it,
three products and two sums of n . (a - o), and those of n . d make 4 eps at most of
these and of the origin's and the direction's lengths. n is the cross product of the two
shorter edges, with the largest angle gamma between them; 1.5 eps of their lengths is 3
eps / sin(gamma) of depth. Altogether, with w_i the parts of the corners v_i,

    kappa = (sum w_i |v_i| + |o| + t |d|) / (t |n . d|)  >= 1,

depth errs by at most 8 eps kappa / sin(gamma). A ray that misses counts as a hit only
where a change of corners, origin and direction by 16 eps of their lengths makes it one.
Over all extremes (16000 rays) it is 0.89 and 7.8 eps. A ray in the triangle's plane, to
rounding, may be a hit, too, and then no nearer or farther than all corners.

Range. That of the plane: first derivatives are 0 where |n . d| is at most 3e-10
(1.2e-77 in double precision), second ones where they are more than a thousandth of the
largest number. A triangle counts where the squares of its edges and of its distance are
normal numbers. One whose height is 4 eps of its longest edge, or less, is refused; if
it is traced it is seen as long as it has any height.

References:
    Woop, Benthin and Wald (2013), Watertight ray/triangle intersection, JCGT 2(1).
"""

__all__ = ["Triangle", "is_thin"]

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from impostor_jax.arguments import float_array, is_concrete, place_of
from impostor_jax.compiling import computed_apart
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.hull import DiscHull
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, eps, first_largest, one_of_three, safe_divide
from impostor_jax.primitives.base import AbstractOnePiece
from impostor_jax.primitives.surface import facing, implicit_hit

WIDTH = 8
"""How wide a corner is taken to be, in eps of its distance. The unit vectors to it and
along the ray are rounded by 2 eps together and the part across the ray by 4.5, so that
6.5 are enough of each axis; of the products, to which no error along the ray matters, 5
of the parts' lengths."""

THIN = 4
"""Height of a triangle that has none to rounding, in eps of its longest edge."""

Corners = tuple[Vec3, Vec3, Vec3]


class Triangle(AbstractOnePiece):
    """Triangle in the world frame, seen from both sides; a batch (n,) is a mesh.

    Args:
        vertices: The three corners in meters, (*batch, 3, 3), one in each row;
            counterclockwise as seen from the side that the normal points to. The signed
            distance is negative on the other side.

    Derivatives:
        The depth of a pixel is smooth in the corners and jumps where the outline
        crosses the pixel. Each corner has the part of it that it has in the point that
        is seen; across an edge of a mesh depth is continuous and its derivative is not.

    Raises:
        ValueError: A triangle is a line to rounding, a value is not finite, or a shape
            does not fit.
    """

    measure: ClassVar = "vertices", 2
    vertices: Float[Array, "*batch 3 3"] | Float[np.ndarray, "*batch 3 3"]

    def __init__(self, vertices: Any):
        rounded = float_array("vertices", vertices, (3, 3), "meters")
        self.vertices = place_of(vertices, rounded)
        if is_concrete(self.vertices):
            thin = is_thin(np.asarray(self.vertices), rounded.dtype)
            if np.any(thin):
                first = np.asarray(self.vertices)[thin][0]
                raise ValueError(
                    "vertices must not lie on a line, in meters, got "
                    f"{first.tolist()} among {thin.size}"
                )

    @property
    @override
    def is_bounded(self) -> bool:
        return True

    @property
    @override
    def hull(self) -> DiscHull:
        return DiscHull.of_points(jnp.asarray(self.vertices))

    @override
    def intersect(self, ray: Ray) -> Hit:
        t, _ = implicit_hit(_trace, _equation, ray, self._corners())
        return Hit.on_one_piece(t)

    @override
    def normal(self, ray: Ray, hit: Hit) -> Vec3:
        return facing(_plane(self._corners()).normal, ray.direction, hit.mask)

    @override
    def stretches(self, ray: Ray) -> None:
        return None

    @override
    def implicit(self, point: Vec3) -> Float[Array, "*batch"]:
        corners = self._corners()
        n = _plane(corners).normal
        height = n.dot(point - corners[0])
        # Of the point from each edge, and whether it is on the triangle's side of it.
        beside, above = [], []
        for start, end in _edges(corners):
            edge, offset = end - start, point - start
            square = edge.dot(edge)
            part = offset.dot(edge * safe_divide(jnp.ones_like(square), square))
            beside.append((offset - edge * jnp.clip(part, 0, 1)).norm())
            above.append(n.dot(edge.cross(offset)) >= 0)
        distance = jnp.minimum(jnp.minimum(beside[0], beside[1]), beside[2])
        distance = jnp.where(height < 0, -distance, distance)
        return jnp.where(above[0] & above[1] & above[2], height, distance)

    @override
    def outline_gap(self, ray: Ray) -> Numbers:
        corners = self._corners()
        near, _ = ray.brought_near(corners[0], corners[0], jnp.zeros_like(corners[0].x))
        d = near.direction
        # The parallelepiped of ray and edge, over the parallelogram of the two.
        beside, total = [], jnp.zeros_like(d.x)
        for start, end in _edges(corners):
            offset, edge = start - corners[0] - near.origin, end - start
            turn = d.dot(offset.cross(edge))
            beside.append(safe_divide(turn, d.cross(edge).norm()))
            total = total + turn
        side = jnp.sign(jax.lax.stop_gradient(total))
        return _ends([side * one for one in beside])[0]

    @override
    def transformed(self, target_from_source: RigidTransform) -> "Triangle":
        vertices = target_from_source.apply(self.vertices)
        return eqx.tree_at(lambda t: t.vertices, self, vertices)

    def _corners(self) -> Corners:
        a, b, c = (Vec3.from_array(self.vertices[..., k, :]) for k in range(3))
        return a, b, c


def is_thin(
    vertices: Float[np.ndarray, "*batch 3 3"], dtype: DTypeLike
) -> Bool[np.ndarray, "*batch"]:
    """Tell which triangles are a line, or a point, to the rounding of a type."""
    # In double precision the corners of single precision lie where they are.
    a, b, c = np.moveaxis(np.asarray(vertices, float), -2, 0)
    edges = np.stack([b - a, c - b, a - c])
    longest = np.max(np.linalg.norm(edges, axis=-1), axis=0)
    # Counted in longest edges, so that no square of a small one is lost.
    unit = edges / np.where(longest > 0, longest, 1)[..., None]
    area = np.linalg.norm(np.cross(unit[0], unit[1]), axis=-1)
    return np.asarray(~(area > eps(dtype, THIN)))


def _edges(corners: Corners) -> tuple[tuple[Vec3, Vec3], ...]:
    """Start and end of the edge after each corner."""
    a, b, c = corners
    return (a, b), (b, c), (c, a)


def _ends(values: Sequence[Numbers]) -> tuple[Numbers, Numbers]:
    """Smallest and largest of three."""
    x, y, z = values
    return jnp.minimum(jnp.minimum(x, y), z), jnp.maximum(jnp.maximum(x, y), z)


class _Plane(NamedTuple):
    """Of a triangle.

    Attributes:
        normal: Of unit length; zero where all corners are on a line.
        height: Across the longest edge, in meters, without a derivative.
    """

    normal: Vec3
    height: Numbers


def _plane(corners: Corners) -> _Plane:
    edges = [end - start for start, end in _edges(corners)]
    # Counted in the longest, so that no square under- or overflows.
    size = jax.lax.stop_gradient(_ends([edge.length() for edge in edges])[1])
    size = jnp.where(size > 0, size, 1)
    x, y, z = (edge * (1 / size) for edge in edges)
    squares = x.dot(x), y.dot(y), z.dot(z)
    longest = first_largest(squares)
    # The two others, in the order of the corners.
    area = one_of_three(longest, (y, z, x)).cross(one_of_three(longest, (z, x, y)))
    held, square = jax.lax.stop_gradient((area.norm(), one_of_three(longest, squares)))
    height = size * safe_divide(held, jnp.sqrt(square))
    return _Plane(area.normalize(), height)


class _Sight(NamedTuple):
    """A corner, as it is seen from the ray's origin.

    Attributes:
        distance: In meters.
        across: Part across the ray of the unit vector towards the corner.
        reach: Length of that, and the width that the corner is taken to have.
        along: Of the way there, in meters.
    """

    distance: Numbers
    across: Vec3
    reach: Numbers
    along: Numbers


def _sight(origin: Vec3, d: Vec3, corner: Vec3, width: float) -> _Sight:
    offset = corner - origin
    distance = offset.norm()
    v = offset * safe_divide(jnp.ones_like(distance), distance)
    along = v.dot(d)
    across = v - d * along
    return _Sight(distance, across, across.norm() + width, along * distance)


def _is_met(
    seen: list[_Sight], turns: list[Numbers], width: float
) -> Bool[Array, "*batch"]:
    """Whether the corners, each so wide, are all around the ray."""
    a, b, c = seen
    left = right = jnp.array(True)
    for turn, (v, w) in zip(turns, ((b, c), (c, a), (a, b)), strict=True):
        slack = width * (v.reach + w.reach)
        left, right = left & (turn >= -slack), right & (turn <= slack)
    met = left | right
    for axis in ("x", "y", "z"):
        low, high = _ends([getattr(corner.across, axis) for corner in seen])
        met &= (low <= width) & (high >= -width)
    return met


def _trace(ray: Ray, corners: Corners) -> tuple[Numbers, Int[Array, "*batch"]]:
    """Ray parameter of the hit, `+inf` on a miss, and the corner nearest to it."""

    def trace() -> tuple[Numbers, Int[Array, "*batch"]]:
        width = eps(ray.direction.x.dtype, WIDTH)
        speed = ray.direction.norm()
        d = ray.direction * (1 / speed)
        seen = [_sight(ray.origin, d, corner, width) for corner in corners]
        a, b, c = (corner.across for corner in seen)
        # Of the edge opposite to each corner.
        turns = [d.dot(v.cross(w)) for v, w in ((b, c), (c, a), (a, b))]
        parts = [
            safe_divide(jnp.abs(turn), corner.distance)
            for turn, corner in zip(turns, seen, strict=True)
        ]
        nearest = first_largest(parts)
        n, height = _plane(corners)
        n_d = n.dot(ray.direction)
        t = n.dot(one_of_three(nearest, corners) - ray.origin) / jnp.where(
            n_d == 0, 1, n_d
        )
        # Of a ray in the plane, to rounding, that may be anything.
        low, _ = _ends([corner.along - width * corner.distance for corner in seen])
        _, high = _ends([corner.along + width * corner.distance for corner in seen])
        t = jnp.clip(t, low / speed, high / speed)
        met = _is_met(seen, turns, width) & (height > 0) & (t > 0)
        return jnp.where(met, t, jnp.inf), nearest

    return computed_apart(trace, corners[0].x)


def _equation(
    point: Vec3, nearest: Int[Array, "*batch"], corners: Corners
) -> tuple[Numbers, Float[Array, "*#batch"]]:
    """Of the plane, by the corner nearest to the point."""
    n, height = _plane(corners)
    above = n.dot(point - one_of_three(nearest, corners))
    # A corner that moves turns the plane the more, the closer it is to an edge.
    return above, jnp.minimum(height * height, 1)
