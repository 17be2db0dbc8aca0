"""Frustum of a right circular cone; a cone where one radius is 0.

It is counted from that end of the axis which is nearer to the ray's origin, with the
radius of that end (`impostor_jax.primitives.tapered`). No apex is computed, so that a
cylinder is no special case but the smooth limit of equal radii.
"""

__all__ = ["Frustum"]

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from impostor_jax.arguments import float_arrays, is_concrete, place_of
from impostor_jax.geometry.frames import Points, RigidTransform
from impostor_jax.geometry.hull import DiscHull
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, safe_divide, safe_normalize
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.sector import sector, sector_fields, with_zero_turned
from impostor_jax.primitives.stretch import Stretch
from impostor_jax.primitives.tapered import (
    HIGH_CAP,
    NUM_PARTS,
    Tapered,
    tapered_distance,
    tapered_hit,
    tapered_normal,
    tapered_outline_gap,
    tapered_rim_gap,
    tapered_stretches,
)


class Frustum(AbstractPrimitive):
    """Frustum of a right circular cone, in the world frame.

    Args:
        p1: Center of the first end, (*batch, 3), in meters.
        p2: Center of the second end, (*batch, 3), in meters.
        radius1: At p1, in meters, not negative, (*batch,).
        radius2: At p2; one of the two is positive.
        start_angle: Where the sector begins, in radians, (*batch,); counted about the
            axis from p1 to p2, counterclockwise as one sees it who looks back from p2.
            None for the whole turn.
        end_angle: Where it ends; the sweep from start to end is taken modulo a turn.
        zero: Direction of the angle 0, (*batch, 3); its part along the axis does not
            count. None for a vector across the axis that `tangent_basis` chooses.
        caps: Whether the ends are closed. Through an open one the wall is seen from
            inside.
        cut_faces: Whether the two flat faces of a sector are closed; as `caps` if None.

    Derivatives:
        The depth of a pixel is smooth in every field while the same surface is seen and
        jumps where an outline, a rim or a cut crosses the pixel. It grows without bound
        as a ray grazes the wall; on a ray that grazes to rounding it is 0.

    Raises:
        ValueError: A concrete value is out of range, or a shape does not fit.
    """

    measure: ClassVar = "radius1", 0
    p1: Points
    p2: Points
    radius1: Float[Array, "*batch"]
    radius2: Float[Array, "*batch"]
    start_angle: Float[Array, "*batch"] | None
    end_angle: Float[Array, "*batch"] | None
    zero: Float[Array, "*batch 3"] | None
    caps: bool = eqx.field(static=True)
    cut_faces: bool = eqx.field(static=True)

    def __init__(
        self,
        p1: Any,
        p2: Any,
        radius1: Any,
        radius2: Any,
        start_angle: Any = None,
        end_angle: Any = None,
        zero: Any = None,
        caps: bool = True,
        cut_faces: bool | None = None,
    ):
        *ends, self.radius1, self.radius2 = float_arrays(
            p1=(p1, (3,), "meters"),
            p2=(p2, (3,), "meters"),
            radius1=(radius1, (), "meters"),
            radius2=(radius2, (), "meters"),
        )
        self.p1, self.p2 = map(place_of, (p1, p2), ends)
        points, radii = (self.p1, self.p2), (self.radius1, self.radius2)
        if is_concrete(radii):
            both = np.stack(radii)
            if np.any(both < 0) or not np.all(np.any(both > 0, axis=0)):
                raise ValueError(
                    "radius1 and radius2 must not be negative, in meters, and one of "
                    f"them positive, got {radii[0]} and {radii[1]}"
                )
        if is_concrete(points) and np.any(np.all(np.equal(*points), axis=-1)):
            raise ValueError(f"p1 and p2 must be two points, got {points[0]} twice")
        self.start_angle, self.end_angle, self.zero = sector_fields(
            self.axis, start_angle, end_angle, zero
        )
        self.caps = caps
        self.cut_faces = caps if cut_faces is None else cut_faces

    @property
    def axis(self) -> Float[Array, "*batch 3"]:
        """Unit vector from p1 to p2."""
        return safe_normalize(jnp.asarray(self.p2 - self.p1))

    @property
    def _is_whole(self) -> bool:
        """Whether it is closed and goes all the way round."""
        return self.caps and self.start_angle is None

    @property
    @override
    def num_parts(self) -> int:
        return NUM_PARTS

    @property
    @override
    def is_bounded(self) -> bool:
        return True

    @property
    @override
    def hull(self) -> DiscHull:
        ends = jnp.asarray(self.p1), jnp.asarray(self.p2)
        return DiscHull.of_ends(*ends, self.axis, self.radius1, self.radius2)

    @override
    def intersect(self, ray: Ray) -> Hit:
        return tapered_hit(ray, self._seen_from(ray.origin))

    @override
    def normal(self, ray: Ray, hit: Hit) -> Vec3:
        return tapered_normal(ray, hit, self._seen_from(ray.origin))

    @override
    def stretches(self, ray: Ray) -> tuple[Stretch, ...] | None:
        return tapered_stretches(ray, self._seen_from(ray.origin))

    @override
    def implicit(self, point: Vec3) -> Float[Array, "*batch"]:
        return tapered_distance(point, self._seen_from(point))

    @override
    def outline_gap(self, ray: Ray) -> Numbers | None:
        if not self._is_whole:
            return None
        return tapered_outline_gap(ray, self._seen_from(ray.origin))

    @override
    def crease_gap(
        self, ray: Ray, part: Int[Array, "..."], other: Int[Array, "..."]
    ) -> Numbers | None:
        if not self._is_whole:
            return None
        is_high = (part == HIGH_CAP) | (other == HIGH_CAP)
        return tapered_rim_gap(ray, is_high, self._seen_from(ray.origin))

    @override
    def transformed(self, target_from_source: RigidTransform) -> "Frustum":
        p1, p2 = (target_from_source.apply(p) for p in (self.p1, self.p2))
        moved = eqx.tree_at(lambda f: (f.p1, f.p2), self, (p1, p2))
        return with_zero_turned(moved, target_from_source)

    def _seen_from(self, place: Vec3) -> Tapered:
        """The body relative to the end that is nearer to a place."""
        a = Vec3.from_array(self.axis)
        p1, p2 = Vec3.from_array(self.p1), Vec3.from_array(self.p2)
        length = (p2 - p1).dot(a)
        second = (place - p1).dot(a) > length / 2
        zero = jnp.zeros_like(length)
        return Tapered(
            anchor=p2.where(second, p1),
            axis=a,
            low=jnp.where(second, -length, zero),
            high=jnp.where(second, zero, length),
            radius=jnp.where(second, self.radius2, self.radius1),
            slope=safe_divide(self.radius2 - self.radius1, length),
            sector=sector(a, self.start_angle, self.end_angle, self.zero),
            caps=self.caps,
            cut_faces=self.cut_faces,
        )
