"""Bodies about an axis: the cylinder and the frustum, which is one with a slope."""

__all__ = ["CylinderBody", "FrustumBody", "RoundBody"]

import abc
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.fit.body import (
    AbstractBody,
    Passing,
    Readout,
    SurfaceSeen,
    blunted_root,
)
from impostor_jax.fit.rows import Kind, Rows
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Ray, slab_interval
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.geometry.vec3 import Vec3, unit
from impostor_jax.numerics import safe_norm, smallest_slope
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum

Numbers = Float[Array, "*batch"]

PARALLEL = 1e-4
"""A of the wall's quadric, over |d|^2, below which a ray runs along a cone's wall. A is
taken for this much: the wall would be the difference of two numbers too large."""

FARTHEST = 1e3
"""Sizes of the body within which a point is placed along its axis."""

LEAST_END = 1e-4
"""Radius of a frustum's end, in radii at its center, below which none can be told."""


AXIAL = {
    "axis": ("axis_first", "axis_second"),
    "across_axis": ("center_first", "center_second"),
    "along_axis": ("center_along",),
}
"""Coordinates of an axis; first and second are along the two vectors of
`tangent_basis(axis)`."""


class Wall(NamedTuple):
    """How a ray passes a wall without ends; the first five as in `Passing`."""

    inverse: Numbers
    nearest: Numbers
    square: Numbers
    half: Numbers
    bend: Numbers
    enter: Numbers
    leave: Numbers


class RoundBody(AbstractBody):
    """A body about an axis, whose radius may change linearly along it.

    Attributes:
        center: Midpoint of the axis between the ends.
        axis: Unit vector.
        radius: At the center.
        height: Distance of the ends.
    """

    ends: ClassVar[tuple[int, ...]] = (-1, 1)
    axis: eqx.AbstractVar[Float[Array, "*batch 3"]]
    height: eqx.AbstractVar[Numbers]

    @property
    @abc.abstractmethod
    def slope(self) -> float | Numbers:
        """Change of the radius per length along the axis."""

    @property
    @abc.abstractmethod
    def num_numbers(self) -> int:
        """How many of center, axis, radius, height and slope are fitted."""

    @property
    def names_of_radii(self) -> tuple[str, ...]:
        """Names of the radii that are fitted."""
        return tuple(name for name in self.coordinates if name.startswith("radius"))

    @abc.abstractmethod
    def wall(self, ray: Ray, m: Vec3, chord: float | Float[Array, "*#batch"]) -> Wall:
        """How a ray, relative to the center, passes the wall if that had no ends.

        Args:
            ray: From near the body.
            m: Direction across ray and axis, d x a.
            chord: As in `Rows`.
        """

    @abc.abstractmethod
    def end_radius(self, end: Numbers) -> Numbers:
        """Radius of the ends, -1 and 1, of some rows."""

    @override
    @abc.abstractmethod
    def reversed(self, sign: Float[Array, ""]) -> "RoundBody":
        """The same body with its axis turned round where the sign is -1."""

    @abc.abstractmethod
    def between(self, low: Float[Array, ""], high: Float[Array, ""]) -> "RoundBody":
        """The same wall between other ends, along the axis from the center."""

    @abc.abstractmethod
    def radii_beside(
        self, ends: Float[Array, "2"], ends_seen: Bool[Array, "2"]
    ) -> dict[str, Numbers]:
        """The radii that are fitted; of an end that is not seen, the wall's at a place.

        Args:
            ends: These places, along the axis from the center.
            ends_seen: Whether the ends are seen.
        """

    @abc.abstractmethod
    def places(self) -> dict[str, Float[Array, "3"]]:
        """The points of the axis that a user reads."""

    @override
    def readout(self, near: "RoundBody", ends_seen: Bool[Array, " e"]) -> Readout:
        way = jnp.sum(self.axis * near.axis)
        body = self.reversed(jnp.where(way < 0, -1, 1).astype(way.dtype))
        basis = tangent_basis(near.axis)
        away = body.center - near.center
        along, half = jnp.sum(body.axis * away), near.height / 2
        # To the point of this axis that lies beside the other's center.
        beside = away - body.axis * along
        # Where the other's ends are along this axis.
        ends = jnp.stack([-half, half]) - along
        return OrderedDict(
            **body.places(),
            across_axis=jnp.matmul(basis, beside, precision="highest"),
            along_axis=jnp.sum(near.axis * away),
            axis=jnp.matmul(basis, body.axis, precision="highest"),
            **body.radii_beside(ends, ends_seen),
            height=body.height,
        )

    @override
    def drawn_in(
        self, ends_seen: Bool[Array, " e"], reach: Float[Array, " e"]
    ) -> "RoundBody":
        half = self.height / 2
        reach = jnp.where(ends_seen, half, reach)
        # Without a wall there is no extent to draw in to.
        height = jnp.sum(reach)
        reach = jnp.where(jnp.isfinite(height) & (height > 0), reach, half)
        return self.between(-reach[0], reach[1])

    @property
    @override
    def sign(self) -> Numbers:
        largest = self.axis[jnp.argmax(jnp.abs(self.axis))]
        return jnp.where(largest < 0, -1, 1).astype(largest.dtype)

    @property
    @override
    def size(self) -> Numbers:
        return (self.height + self.radius) / 2

    @override
    def passing(
        self, direction: Vec3, chord: float | Float[Array, "*#batch"]
    ) -> Passing:
        center, a = Vec3.from_array(self.center), Vec3.from_array(self.axis)
        zero = jnp.zeros_like(direction.x)
        ray = Ray(Vec3(zero, zero, zero), direction)
        local, foot = ray.brought_near(center, center, self.radius)
        o, d = local.origin, local.direction
        m = d.cross(a)
        wall = self.wall(local, m, chord)
        slab = slab_interval(local, a, self.height / 2)
        cap_in = jnp.where(jnp.isfinite(slab.lower), slab.lower, -jnp.inf)
        cap_out = jnp.where(jnp.isfinite(slab.upper), slab.upper, jnp.inf)
        outside = jnp.maximum(wall.enter, cap_in) + foot > 0
        cap = jnp.where(outside, cap_in, cap_out)
        cap = jnp.where(jnp.isfinite(cap), cap, 0)
        rim = (o + d * cap).cross(a).norm()
        wide = self.end_radius(_end_ahead(outside, d.dot(a)))
        past = jnp.maximum(rim / wide - 1, 0)
        return Passing(
            local=local,
            foot=foot,
            inverse=wall.inverse,
            m=m,
            nearest=wall.nearest,
            square=wall.square,
            half=wall.half,
            bend=wall.bend,
            outside=outside,
            cap=cap,
            on_cap=jnp.where(outside, cap_in > wall.enter, cap_out < wall.leave),
            rim=rim,
            wide=wide,
            falls=past * wide,
            keep=1 / (1 + past * past),
        )

    @override
    def seen(self, passing: Passing) -> SurfaceSeen:
        a, k, half = Vec3.from_array(self.axis), self.slope, passing.half
        o, d = passing.local.origin, passing.local.direction
        slope, level = d.dot(a), o.dot(a)
        along = level + passing.wall * slope
        enter, leave = passing.nearest - half, passing.nearest + half
        # Unit normals: of the wall |n.d| = |A| h / (R sqrt(1 + k^2)), of a cap |a.d|.
        opening = passing.m.dot(passing.m) - (k * slope) ** 2
        across = opening * half / (self.radius + k * along)
        facing = jnp.where(
            passing.on_cap,
            jnp.abs(slope),
            jnp.maximum(across, 0) * jax.lax.rsqrt(1 + jnp.asarray(k * k, half.dtype)),
        )
        return SurfaceSeen(
            depth=passing.depth,
            cos_incidence=jnp.minimum(facing * jax.lax.rsqrt(d.dot(d)), 1),
            outside=passing.outside,
            on_cap=passing.on_cap,
            nearest=passing.nearest + passing.foot,
            square=passing.square,
            along=along,
            enter_along=self._within_nappe(level + enter * slope, opening, -k * slope),
            leave_along=self._within_nappe(level + leave * slope, opening, k * slope),
            slope=slope,
            cap_distance=passing.rim / passing.wide,
        )

    def _within_nappe(
        self, along: Numbers, opening: Numbers, widening: Numbers
    ) -> Numbers:
        """Coordinate of a crossing of the wall; far away where there is none.

        A ray within the cone of directions leaves the nappe, or enters it, at infinity:
        on the side to which the body grows wider.
        """
        far = FARTHEST * self.size * jnp.sign(jnp.asarray(self.slope, along.dtype))
        return jnp.where((opening < 0) & (widening > 0), far, along)

    @override
    def compared(
        self,
        rows: Rows,
        passing: Passing,
        error: Numbers,
        alpha: Numbers,
        beta: Numbers,
    ) -> tuple[Numbers, list[Numbers]]:
        """Error of each row, ends and caps included, and its derivative.

        With x the point of the nearest approach, l its coordinate along the axis,
        R = r + k l the wall's radius beside it, and e the ray's direction d across the
        axis, the wall's quadric has there half the gradient N = x - l a - k R a, which
        is across the ray. A motion of the body changes, by its nearest approach n and
        squared half-chord q,

            A dn = (e - k^2 (d.a) a).dc + ((1 + k^2) (d.a) x + (l + k R) e).da
                   + k (d.a) dr + (R + k l) (d.a) dk,
            A dq = 2 N.dc + 2 ((l + k R) x + q (1 + k^2) (d.a) e).da
                   + 2 R dr + (2 R l + 2 q k (d.a)^2) dk.
        """
        a, r, k = Vec3.from_array(self.axis), self.radius, self.slope
        o, d = passing.local.origin, passing.local.direction
        inverse = passing.inverse
        d_a = d.dot(a)
        is_end = rows.kind == Kind.END
        edge = passing.nearest + rows.side * passing.half
        end = o.dot(a) + edge * d_a - rows.end * self.height / 2
        error = jnp.where(is_end, end, error)
        alpha = jnp.where(is_end, d_a, alpha) * inverse
        beta = jnp.where(is_end, rows.side * d_a * passing.bend, beta) * (2 * inverse)
        along = o.dot(a) + passing.nearest * d_a
        beside = r + k * along
        e = a.cross(passing.m)
        x = a.cross((o + d * passing.nearest).cross(a))
        lever = along + k * beside
        tilt = (1 + k * k) * d_a
        in_center = e * alpha + x * beta - a * (k * (k * d_a * alpha + beside * beta))
        in_axis = x * (tilt * alpha + lever * beta)
        in_axis = in_axis + e * (lever * alpha + passing.square * tilt * beta)
        in_radius = k * d_a * alpha + beside * beta
        in_slope = (beside + k * along) * d_a * alpha
        in_slope = in_slope + (beside * along + passing.square * k * d_a**2) * beta
        in_center = (in_center - a).where(is_end, in_center)
        in_axis = (in_axis + o + d * edge).where(is_end, in_axis)
        in_height = -rows.end / 2

        # A cap's point stays in its plane; past the rim its distance from there counts.
        on_cap = passing.on_cap & (rows.kind == Kind.DEPTH)
        parallel = jnp.abs(d_a) < smallest_slope(d_a.dtype)
        per_step = jnp.where(parallel, 0, 1 / jnp.where(parallel, 1, d_a))
        point = o + d * passing.cap
        level, rim, wide = point.dot(a), passing.rim, passing.wide
        away = passing.cap + passing.falls - passing.wall
        per_falls = jnp.where(passing.falls > 0, passing.keep, 0)
        per_past = -2 * passing.falls * passing.keep**2 * away / (wide * wide)
        outward = (point - a * level) * (
            (per_past + per_falls) / jnp.maximum(rim, wide)
        )
        follow = per_step * (passing.keep + outward.dot(d))
        in_center = (in_center + a * follow - outward).where(on_cap, in_center)
        in_axis = (in_axis - point * follow - outward * level).where(on_cap, in_axis)
        of_rim = jnp.where(on_cap, per_past * rim / wide + per_falls, 0)
        ahead = _end_ahead(passing.outside, d_a) / 2
        in_radius = in_radius - of_rim
        in_slope = in_slope - of_rim * ahead * self.height
        in_height = jnp.where(on_cap, ahead * (follow - k * of_rim), in_height)
        return error, [
            *(in_center.x, in_center.y, in_center.z),
            *(in_axis.x, in_axis.y, in_axis.z),
            *(in_radius, in_height, in_slope),
        ][: self.num_numbers]

    @override
    def margins(self, seen: SurfaceSeen) -> Float[Array, "k n m"]:
        near, half = -jnp.sign(seen.slope[0]), self.height / 2
        return jnp.stack(
            [
                -seen.square,
                # The end that faces away is met where rays enter the wall.
                -near[None] * seen.enter_along - half,
                near[None] * seen.leave_along - half,
            ]
        )

    @override
    def covers(self, seen: SurfaceSeen) -> Bool[Array, "*batch"]:
        half = self.height / 2
        enters = jnp.minimum(seen.enter_along, seen.leave_along) < half
        leaves = jnp.maximum(seen.enter_along, seen.leave_along) > -half
        return (seen.square > 0) & seen.outside & enters & leaves

    @override
    def free_directions(self, fixed: tuple[str, ...]) -> Float[np.ndarray, "c n"]:
        first, second, across1, across2, *radii, lower, upper = np.eye(
            6 + len(self.names_of_radii)
        )
        free = []
        if "axis" not in fixed:
            free += [first, second]
        if "center" not in fixed:
            free += [across1, across2]
        free += [
            radius
            for name, radius in zip(self.names_of_radii, radii, strict=True)
            if name not in fixed
        ]
        # A held height moves both ends together, a held center moves them apart.
        if "center" not in fixed and "height" not in fixed:
            free += [lower, upper]
        elif "center" not in fixed:
            free += [lower + upper]
        elif "height" not in fixed:
            free += [upper - lower]
        return np.stack(free, axis=1)

    @override
    def moving(self, fixed: tuple[str, ...]) -> tuple[int, ...]:
        radii = not set(self.names_of_radii) <= set(fixed)
        height = "height" not in fixed
        moves = [*["center" not in fixed] * 3, *["axis" not in fixed] * 3]
        # A slope is a difference of radii over the height.
        moves += [radii, height, radii or height][: self.num_numbers - 6]
        return tuple(place for place, does in enumerate(moves) if does)

    @override
    def mirrored(self) -> "RoundBody":
        axis, center = self.axis, self.center
        along = jnp.sum(axis * center, axis=-1) / jnp.sum(center**2, axis=-1)
        mirrored = axis - 2 * along[..., None] * center
        return eqx.tree_at(lambda b: b.axis, self, mirrored)

    @override
    def distance(self, others: Any) -> Float[Array, " k"]:
        a = self.axis
        turned = jnp.cross(others.axis, a[None]) * self.size
        moved = jnp.cross(others.center - self.center[None], a[None])
        grown = others.radius - self.radius
        tapered = jnp.asarray((others.slope - self.slope) * self.size, grown.dtype)
        return jnp.sqrt(jnp.sum(turned**2 + moved**2, axis=1) + grown**2 + tapered**2)

    @override
    def transformed(self, target_from_source: RigidTransform) -> "RoundBody":
        return eqx.tree_at(
            lambda b: (b.center, b.axis),
            self,
            (
                target_from_source.apply(self.center),
                target_from_source.rotate(self.axis),
            ),
        )


def _end_ahead(outside: Bool[Array, "*batch"], slope: Numbers) -> Numbers:
    """End whose plane a ray sees, -1 or 1: it enters there, or leaves from within."""
    return jnp.where(outside, -1, 1).astype(slope.dtype) * jnp.sign(slope)


def _moved_frame(
    body: RoundBody, natural: Float[Array, " c"]
) -> tuple[Float[Array, "3"], Float[Array, "3"], tuple[Array, Array]]:
    """Center and axis at natural coordinates, and how far the ends go along the axis.

    The first four are the axis's tilt and the center's motion along the two vectors of
    `tangent_basis(axis)`, the last two the motions of the ends. The height stays
    positive: the ends move so to first order.
    """
    basis = tangent_basis(body.axis)
    tilt, across = (
        jnp.matmul(part, basis, precision="highest")
        for part in (natural[:2], natural[2:4])
    )
    axis = body.axis + tilt
    shift = (natural[-2] + natural[-1]) / 2
    growth = body.height * jnp.expm1((natural[-1] - natural[-2]) / body.height) / 2
    center = body.center + across + body.axis * shift
    axis = axis * jax.lax.rsqrt(jnp.sum(axis * axis))
    return center, axis, (shift - growth, shift + growth)


def _common_steps(
    body: RoundBody,
    unit: Float[Array, ""],
    end_unit: Float[Array, ""],
    radii: Sequence[Array],
) -> Float[Array, " c"]:
    one = jnp.ones_like(body.radius)
    lever = unit / body.size
    of_radii = [unit / radius for radius in radii]
    return jnp.stack(
        [lever, lever, unit * one, unit * one, *of_radii, *[end_unit * one] * 2]
    )


class CylinderBody(RoundBody):
    """Capped cylinder. It moves by the logarithm of its radius.

    The ends, not center and height, are coordinates: where an end is not seen, exactly
    one coordinate has no effect on the residuals.
    """

    coordinates: ClassVar[dict[str, tuple[str, ...]]] = {
        **AXIAL, "radius": ("radius",), "height": ("height",),
    }  # fmt: skip
    center: Float[Array, "*batch 3"]
    axis: Float[Array, "*batch 3"]
    radius: Numbers
    height: Numbers

    @property
    @override
    def slope(self) -> float:
        return 0.0

    @property
    @override
    def num_numbers(self) -> int:
        return 8

    @staticmethod
    @override
    def of(shape: Cylinder) -> "CylinderBody":
        return CylinderBody(
            center=shape.center,
            axis=unit(shape.axis),
            radius=shape.radius,
            height=shape.height,
        )

    @property
    @override
    def shape(self) -> Cylinder:
        return eqx.tree_at(
            lambda c: (c.center, c.axis, c.radius, c.height),
            Cylinder((0, 0, 0), (0, 0, 1), 1, 1),
            (self.center, self.axis, self.radius, self.height),
        )

    @property
    @override
    def numbers(self) -> Float[Array, "8"]:
        sizes = jnp.stack([self.radius, self.height])
        return jnp.concatenate([self.center, self.axis, sizes])

    @override
    def wall(self, ray: Ray, m: Vec3, chord: float | Float[Array, "*#batch"]) -> Wall:
        o, r = ray.origin, self.radius
        m_m, m_o = m.dot(m), m.dot(o)
        parallel = m_m < smallest_slope(m_m.dtype) ** 2
        # XLA writes each quotient and root to a buffer of its own: there is one of a
        # kind.
        inverse = jnp.where(parallel, 0, 1 / jnp.where(parallel, 1, m_m))
        square = (r * r - m_o * m_o * inverse) * inverse
        nearest = -m.dot(o.cross(Vec3.from_array(self.axis))) * inverse
        half, bend = blunted_root(square, chord)
        enter = jnp.where(parallel, -jnp.inf, nearest - half)
        leave = jnp.where(parallel, jnp.inf, nearest + half)
        return Wall(inverse, nearest, square, half, bend, enter, leave)

    @override
    def end_radius(self, end: Numbers) -> Numbers:
        return jnp.broadcast_to(self.radius, end.shape)

    @override
    def moved(
        self, natural: Float[Array, "7"], fixed: tuple[str, ...]
    ) -> "CylinderBody":
        center, axis, (lower, upper) = _moved_frame(self, natural)
        return CylinderBody(
            center=center,
            axis=axis,
            radius=self.radius * jnp.exp(natural[4]),
            height=self.height + upper - lower,
        )

    @override
    def steps(
        self, unit: Float[Array, ""], end_unit: Float[Array, ""]
    ) -> Float[Array, "7"]:
        return _common_steps(self, unit, end_unit, [self.radius])

    @override
    def radii_beside(
        self, ends: Float[Array, "2"], ends_seen: Bool[Array, "2"]
    ) -> dict[str, Numbers]:
        return {"radius": self.radius}

    @override
    def places(self) -> dict[str, Float[Array, "3"]]:
        return {"center": self.center}

    @override
    def reversed(self, sign: Float[Array, ""]) -> "CylinderBody":
        return eqx.tree_at(lambda b: b.axis, self, self.axis * sign)

    @override
    def between(self, low: Float[Array, ""], high: Float[Array, ""]) -> "CylinderBody":
        center = self.center + self.axis * ((low + high) / 2)
        return CylinderBody(
            center=center, axis=self.axis, radius=self.radius, height=high - low
        )


class FrustumBody(RoundBody):
    """Capped frustum. It moves by the logarithms of its end radii.

    An end moves along the wall that is there: where it is not seen, exactly one
    coordinate has no effect on the residuals, as with the cylinder.

    Attributes:
        growth: Half the difference of the end radii.
    """

    coordinates: ClassVar[dict[str, tuple[str, ...]]] = {
        **AXIAL,
        "radius1": ("radius1",),
        "radius2": ("radius2",),
        "height": ("height",),
    }
    center: Float[Array, "*batch 3"]
    axis: Float[Array, "*batch 3"]
    radius: Numbers
    height: Numbers
    growth: Numbers

    @staticmethod
    @override
    def of(shape: Frustum) -> "FrustumBody":
        return FrustumBody(
            center=(shape.p1 + shape.p2) / 2,
            axis=shape.axis,
            radius=(shape.radius1 + shape.radius2) / 2,
            height=safe_norm(shape.p2 - shape.p1),
            growth=(shape.radius2 - shape.radius1) / 2,
        )

    @property
    @override
    def shape(self) -> Frustum:
        half = self.axis * (self.height[..., None] / 2)
        return eqx.tree_at(
            lambda f: (f.p1, f.p2, f.radius1, f.radius2),
            Frustum((0, 0, 0), (0, 0, 1), 1, 1),
            (self.center - half, self.center + half, self.radius1, self.radius2),
        )

    @property
    def radius1(self) -> Numbers:
        """At the end that the axis leaves."""
        return self.radius - self.growth

    @property
    def radius2(self) -> Numbers:
        """At the end to which the axis goes."""
        return self.radius + self.growth

    @property
    @override
    def slope(self) -> Numbers:
        return 2 * self.growth / self.height

    @property
    @override
    def num_numbers(self) -> int:
        return 9

    @property
    @override
    def numbers(self) -> Float[Array, "9"]:
        sizes = jnp.stack([self.radius, self.height, self.slope])
        return jnp.concatenate([self.center, self.axis, sizes])

    @override
    def wall(self, ray: Ray, m: Vec3, chord: float | Float[Array, "*#batch"]) -> Wall:
        """How a ray passes the wall: the quadric of `cone_interval`."""
        a, o, d = Vec3.from_array(self.axis), ray.origin, ray.direction
        k = self.slope * d.dot(a)
        p, rho = o.cross(a), self.radius + self.slope * o.dot(a)
        m_o = m.dot(o)
        opening, least = m.dot(m) - k * k, PARALLEL * d.dot(d)
        within = jnp.where(opening < 0, -1, 1).astype(k.dtype)
        inverse = within / jnp.maximum(jnp.abs(opening), least)
        w = m * rho - p * k
        square = (w.dot(w) - m_o * m_o) * inverse * inverse
        nearest = (rho * k - m.dot(p)) * inverse
        half, bend = blunted_root(square, chord)
        half, bend = half * within, bend * within
        once = within < 0
        return Wall(
            inverse=inverse,
            nearest=nearest,
            square=square,
            half=half,
            bend=bend,
            enter=jnp.where(once & (k < 0), -jnp.inf, nearest - half),
            leave=jnp.where(once & (k > 0), jnp.inf, nearest + half),
        )

    @override
    def end_radius(self, end: Numbers) -> Numbers:
        return jnp.where(end < 0, self.radius1, self.radius2)

    @override
    def moved(
        self, natural: Float[Array, "8"], fixed: tuple[str, ...]
    ) -> "FrustumBody":
        center, axis, ends = _moved_frame(self, natural)
        radii = [self.radius1, self.radius2]
        for index, name in enumerate(self.names_of_radii):
            if name not in fixed:
                grown = radii[index] * jnp.exp(natural[4 + index])
                moved = grown + self.slope * ends[index]
                radii[index] = jnp.maximum(moved, LEAST_END * self.radius)
        return FrustumBody(
            center=center,
            axis=axis,
            radius=(radii[0] + radii[1]) / 2,
            height=self.height + ends[1] - ends[0],
            growth=(radii[1] - radii[0]) / 2,
        )

    @override
    def steps(
        self, unit: Float[Array, ""], end_unit: Float[Array, ""]
    ) -> Float[Array, "8"]:
        least = LEAST_END * self.radius
        radii = [jnp.maximum(end, least) for end in (self.radius1, self.radius2)]
        return _common_steps(self, unit, end_unit, radii)

    @override
    def radii_beside(
        self, ends: Float[Array, "2"], ends_seen: Bool[Array, "2"]
    ) -> dict[str, Numbers]:
        own = jnp.stack([self.radius1, self.radius2])
        radii = jnp.where(ends_seen, own, self.radius + self.slope * ends)
        return dict(zip(self.names_of_radii, radii, strict=True))

    @override
    def places(self) -> dict[str, Float[Array, "3"]]:
        half = self.axis * (self.height / 2)
        return {"p1": self.center - half, "p2": self.center + half}

    @override
    def reversed(self, sign: Float[Array, ""]) -> "FrustumBody":
        return eqx.tree_at(
            lambda b: (b.axis, b.growth), self, (self.axis * sign, self.growth * sign)
        )

    @override
    def between(self, low: Float[Array, ""], high: Float[Array, ""]) -> "FrustumBody":
        middle = (low + high) / 2
        return FrustumBody(
            center=self.center + self.axis * middle,
            axis=self.axis,
            radius=self.radius + self.slope * middle,
            height=high - low,
            growth=self.slope * (high - low) / 2,
        )
