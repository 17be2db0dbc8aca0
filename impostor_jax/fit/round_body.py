"""Bodies about an axis: the frustum, and the cylinder, which is one without growth."""

__all__ = ["RoundBody"]

from collections import OrderedDict

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.compiling import computed_once
from impostor_jax.fit.axial_body import AbstractAxialBody, in_frame
from impostor_jax.fit.body import (
    Chord,
    FreeDirections,
    Margins,
    Passing,
    Rays,
    Readout,
    blunted_root,
    grown,
    local_ray,
)
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.geometry.vec3 import Vec3, unit
from impostor_jax.numerics import (
    Numbers,
    product,
    safe_norm,
    safe_sqrt,
    smallest_slope,
)
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum

PARALLEL = 1e-4
"""A of the wall's quadric, over |d|^2, below which a ray runs along a cone's wall. A is
taken for this much: the wall would be the difference of two numbers too large."""

FARTHEST = 1e3
"""Sizes of the body within which a point is placed along its axis."""

LEAST_END = 1e-4
"""Radius of a frustum's end, in radii at its center, below which none can be told."""

CENTRAL = 0.2
"""Squared half-chord, in squared radii, from which a ray passes the wall so far within
its outline that an end has a place along the axis there."""

END_ON = 0.1
"""Sine of the angle to the line of sight from which an axis has a direction across."""


class RoundBody(AbstractAxialBody):
    """A body about an axis, whose radius may change linearly along it.

    Its radius, or those of both ends, are coordinates. The ends, not center and height,
    are, too, and an end moves along the wall that is there: where one is not seen,
    exactly one coordinate has no effect on the readings.

    Attributes:
        center: Midpoint of the axis between the ends.
        axis: Unit vector.
        radius: At the center.
        height: Distance of the ends.
        growth: Half the difference of the ends' radii; None of a cylinder.
    """

    center: Float[Array, "*batch 3"]
    axis: Float[Array, "*batch 3"]
    radius: Numbers
    height: Numbers
    growth: Numbers | None = None

    @staticmethod
    @override
    def of(shape: Cylinder | Frustum) -> "RoundBody":
        if isinstance(shape, Cylinder):
            return RoundBody(
                center=jnp.asarray(shape.center),
                axis=unit(shape.axis),
                radius=shape.radius,
                height=shape.height,
            )
        return RoundBody(
            center=jnp.asarray((shape.p1 + shape.p2) / 2),
            axis=shape.axis,
            radius=(shape.radius1 + shape.radius2) / 2,
            height=safe_norm(jnp.asarray(shape.p2 - shape.p1)),
            growth=(shape.radius2 - shape.radius1) / 2,
        )

    @property
    @override
    def shape(self) -> Cylinder | Frustum:
        if self.growth is None:
            return eqx.tree_at(
                lambda c: (c.center, c.axis, c.radius, c.height),
                Cylinder((0, 0, 0), (0, 0, 1), 1, 1),
                (self.center, self.axis, self.radius, self.height),
            )
        half = self.axis * (self.height[..., None] / 2)
        return eqx.tree_at(
            lambda f: (f.p1, f.p2, f.radius1, f.radius2),
            Frustum((0, 0, 0), (0, 0, 1), 1, 1),
            (self.center - half, self.center + half, self.radius1, self.radius2),
        )

    @property
    def radius1(self) -> Numbers:
        """At the end that the axis leaves."""
        return self.radius if self.growth is None else self.radius - self.growth

    @property
    def radius2(self) -> Numbers:
        """At the end to which the axis goes."""
        return self.radius if self.growth is None else self.radius + self.growth

    @property
    def slope(self) -> float | Numbers:
        """Change of the radius per length along the axis."""
        return 0.0 if self.growth is None else 2 * self.growth / self.height

    @property
    @override
    def names_of_radii(self) -> tuple[str, ...]:
        return ("radius",) if self.growth is None else ("radius1", "radius2")

    @property
    @override
    def of_ends(self) -> tuple[str, ...]:
        return () if self.growth is None else self.names_of_radii

    @override
    def passing(self, rays: Rays, chord: Chord = 0.0, apart: bool = False) -> Passing:
        frame = jnp.concatenate([tangent_basis(self.axis), self.axis[None]])
        local, foot = local_ray(rays, self.center, frame)
        if apart:
            local, foot = computed_once(lambda: (local, foot))
        of_wall = self._wall(local.origin, local.direction)
        if apart:
            of_wall = computed_once(lambda: of_wall)
        inverse, nearest, square, within = of_wall
        half, half_slope = blunted_root(square, chord)
        o, d = local.origin, local.direction
        o1, o2, o_a, e1, e2, d_a = o.x, o.y, o.z, d.x, d.y, d.z
        parallel = jnp.abs(d_a) < smallest_slope(d_a.dtype)
        per_step = 1 / jnp.where(parallel, 1, d_a)
        reach = jnp.where(parallel, jnp.inf, self.height / 2 * jnp.abs(per_step))
        middle = -o_a * per_step
        k, widens = self.slope, self.slope * d_a
        if self.growth is None:
            is_along = inverse == 0
            enter = jnp.where(is_along, -jnp.inf, nearest - half)
            leave = jnp.where(is_along, jnp.inf, nearest + half)
        else:
            half, half_slope = half * within, half_slope * within
            enter = jnp.where((within < 0) & (widens < 0), -jnp.inf, nearest - half)
            leave = jnp.where((within < 0) & (widens > 0), jnp.inf, nearest + half)
        outside = jnp.maximum(enter, middle - reach) + foot > 0
        ahead = _end_ahead(outside, d_a)
        cap_radius = jnp.where(ahead < 0, self.radius1, self.radius2)
        # At a tip there is no rim to be past of.
        cap_radius = jnp.maximum(cap_radius, LEAST_END * self.radius)
        on_cap = jnp.where(outside, middle - reach > enter, middle + reach < leave)
        cap = jnp.where(parallel, 0, middle + jnp.where(outside, -reach, reach))
        rim = safe_sqrt((o1 + e1 * cap) ** 2 + (o2 + e2 * cap) ** 2)
        past = jnp.maximum(rim / cap_radius - 1, 0)
        wall = nearest + jnp.where(outside, -half, half)
        # Unit normals: of the wall |n.d| = |A| h / (R sqrt(1 + k^2)), of a cap |a.d|.
        across = e1 * e1 + e2 * e2
        along = o_a + wall * d_a
        enter_along = o_a + (nearest - half) * d_a
        leave_along = o_a + (nearest + half) * d_a
        if self.growth is None:
            facing = across * jnp.maximum(half, 0) / self.radius
        else:
            facing = (across - widens**2) * half / (self.radius + k * along)
            facing = jnp.maximum(facing, 0) * jax.lax.rsqrt(jnp.asarray(1 + k * k))
            # A ray within the cone of directions leaves the nappe, or enters it, at
            # infinity: on the side to which the body grows wider.
            far = FARTHEST * self.size * jnp.sign(self.growth)
            enter_along = jnp.where((within < 0) & (widens < 0), far, enter_along)
            leave_along = jnp.where((within < 0) & (widens > 0), far, leave_along)
        facing = jnp.where(on_cap, jnp.abs(d_a), facing)
        facing = facing * jax.lax.rsqrt(across + d_a * d_a)
        return Passing(
            local=local,
            foot=foot,
            inverse=inverse,
            nearest=nearest,
            square=square,
            half=half,
            half_slope=half_slope,
            outside=outside,
            within=jnp.zeros(outside.shape, bool),
            cos_incidence=jnp.minimum(facing, 1),
            cap=cap,
            on_cap=on_cap,
            rim=rim,
            cap_radius=cap_radius,
            overshoot=past * cap_radius,
            plane_weight=1 / (1 + past * past),
            along=along,
            enter_along=enter_along,
            leave_along=leave_along,
        )

    def _wall(self, o: Vec3, d: Vec3) -> tuple[Numbers, Numbers, Numbers, Numbers]:
        """Inverse, nearest approach and squared half-chord, and the sign of A.

        In the body's frame the wall is |o + t d|^2 = (r + k (o_a + t d_a))^2 in the
        components across the axis.
        """
        across = d.x * d.x + d.y * d.y
        beside = o.x * d.y - o.y * d.x
        ahead = o.x * d.x + o.y * d.y
        if self.growth is None:
            parallel = across < smallest_slope(across.dtype) ** 2
            inverse = jnp.where(parallel, 0, 1 / jnp.where(parallel, 1, across))
            r = self.radius
            square = (r * r - beside * beside * inverse) * inverse
            return inverse, -ahead * inverse, square, jnp.ones_like(inverse)
        k = self.slope * d.z
        rho = self.radius + self.slope * o.z
        opening, least = across - k * k, PARALLEL * d.dot(d)
        within = jnp.where(opening < 0, -1, 1).astype(k.dtype)
        inverse = within / jnp.maximum(jnp.abs(opening), least)
        w1, w2 = d.x * rho - o.x * k, d.y * rho - o.y * k
        square = (w1 * w1 + w2 * w2 - beside * beside) * inverse * inverse
        return inverse, (rho * k - ahead) * inverse, square, within

    @override
    def covers(self, passing: Passing) -> Bool[Array, "*batch"]:
        half = self.height / 2
        enters = jnp.minimum(passing.enter_along, passing.leave_along) < half
        leaves = jnp.maximum(passing.enter_along, passing.leave_along) > -half
        return (passing.square > 0) & passing.outside & enters & leaves

    @override
    def of_reading(
        self, passing: Passing, alpha: Numbers, beta: Numbers, on_cap: Bool[Array, "*b"]
    ) -> list[Numbers]:
        """Derivative of what is compared, in tangent coordinates.

        A cap's point stays in its plane; past the rim its distance from there counts.
        """
        tilts, acrosses, radii = self._of_wall(passing, alpha, beta)
        d_a = passing.local.direction.z
        parallel = jnp.abs(d_a) < smallest_slope(d_a.dtype)
        per_step = jnp.where(on_cap & ~parallel, 1 / jnp.where(parallel, 1, d_a), 0)
        rim, radius = passing.rim, passing.cap_radius
        weight, overshoot = passing.plane_weight, passing.overshoot
        away = passing.cap + overshoot - passing.nearest - passing.sign * passing.half
        direct = jnp.where(overshoot > 0, weight, 0)
        by_weight = -2 * overshoot * weight**2 * away / (radius * radius)
        of_rim = jnp.where(on_cap, by_weight * rim / radius + direct, 0)
        outward = jnp.where(on_cap, by_weight + direct, 0) / jnp.maximum(rim, radius)
        (o1, o2, _), (e1, e2, _) = in_frame(passing)
        point1, point2 = o1 + e1 * passing.cap, o2 + e2 * passing.cap
        follow = per_step * (weight + outward * (point1 * e1 + point2 * e2))
        end = _end_ahead(passing.outside, d_a)
        lean = follow + outward * (end * (self.height / 2))
        of_end = follow - self.slope * of_rim
        lower = jnp.where(end < 0, of_end, 0)
        upper = jnp.where(end < 0, 0, of_end)
        if self.growth is None:
            of_radii = [of_rim * self.radius]
        else:
            first = jnp.where(end < 0, of_rim, 0)
            of_radii = [first * self.radius1, (of_rim - first) * self.radius2]
        return [
            tilts[0] - point1 * lean,
            tilts[1] - point2 * lean,
            acrosses[0] - point1 * outward,
            acrosses[1] - point2 * outward,
            *(wall - own for wall, own in zip(radii, of_radii, strict=True)),
            lower,
            upper,
        ]

    def _of_wall(
        self, passing: Passing, alpha: Numbers, beta: Numbers
    ) -> tuple[list[Numbers], list[Numbers], list[Numbers]]:
        """Alpha dn + beta dq for tilts, motions across the axis, and radii.

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
        (o1, o2, o_a), (e1, e2, d_a) = in_frame(passing)
        alpha, beta = alpha * passing.inverse, beta * (2 * passing.inverse)
        n, q = passing.nearest, passing.square
        x1, x2, along = o1 + n * e1, o2 + n * e2, o_a + n * d_a
        if self.growth is None:
            lever, tilt, r = along, d_a, self.radius
            radii = [r * r * beta]
        else:
            k = self.slope
            beside = self.radius + k * along
            lever, tilt = along + k * beside, (1 + k * k) * d_a
            in_radius = (k * d_a * alpha + beside * beta) / 2
            in_slope = (beside + k * along) * d_a * alpha
            in_slope = in_slope + (beside * along + q * k * d_a * d_a) * beta
            in_slope = in_slope / self.height
            radii = [
                self.radius1 * (in_radius - in_slope),
                self.radius2 * (in_radius + in_slope),
            ]
        by_x, by_e = tilt * alpha + lever * beta, lever * alpha + q * tilt * beta
        tilts = [x1 * by_x + e1 * by_e, x2 * by_x + e2 * by_e]
        return tilts, [e1 * alpha + x1 * beta, e2 * alpha + x2 * beta], radii

    @override
    def swelling(self, gradient: Float[Array, "c n"]) -> Float[Array, " n"]:
        if self.growth is None:
            return gradient[4]
        least = LEAST_END * self.radius
        first, second = (
            self.radius / jnp.maximum(end, least)
            for end in (self.radius1, self.radius2)
        )
        return gradient[4] * first + gradient[5] * second

    @override
    def width_of_ends(self, beside: Float[Array, ""]) -> Float[Array, " e"]:
        # A wall's readings are as many as a rectangle of its mean width and height has.
        radii = jnp.stack([self.radius1, self.radius2])
        across = beside * 2 * radii.mean() / self.height
        return jnp.sqrt(across) * radii / radii.mean()

    @override
    def wall_square(self, passing: Passing) -> Numbers:
        r = self.radius
        if self.growth is None:
            return r * r * jnp.ones_like(passing.square)
        # Beside the point that is seen.
        return (r + self.slope * passing.along) ** 2

    @override
    def margins(self, passing: Passing) -> Margins:
        near, half = -jnp.sign(passing.local.direction.z[0]), self.height / 2
        # Beside the wall's edge its two points have no place along the axis.
        central = (passing.square > CENTRAL * self.radius**2) & passing.outside
        value = [
            -passing.square,
            # The end that faces away is met where rays enter the wall.
            -near[None] * passing.enter_along - half,
            near[None] * passing.leave_along - half,
        ]
        end = jnp.stack([jnp.zeros_like(near), -near, near])
        return Margins(
            value=jnp.stack(value),
            tells=jnp.stack([jnp.ones_like(central), central, central]),
            end=end,
            side=np.array([-1.0, -1.0, 1.0]),
            line=end,
            lines=(-1, 0, 1),
        )

    @override
    def of_end(
        self, passing: Passing, end: Numbers, side: Numbers
    ) -> tuple[Numbers, list[Numbers]]:
        (o1, o2, o_a), (e1, e2, d_a) = in_frame(passing)
        edge = passing.nearest + side * passing.half
        error = o_a + edge * d_a - end * (self.height / 2)
        in_square = side * d_a * passing.half_slope
        tilts, acrosses, radii = self._of_wall(passing, d_a, in_square)
        return error, [
            tilts[0] + o1 + e1 * edge,
            tilts[1] + o2 + e2 * edge,
            *acrosses,
            *radii,
            jnp.where(end < 0, -1.0, 0.0).astype(d_a.dtype),
            jnp.where(end > 0, -1.0, 0.0).astype(d_a.dtype),
        ]

    @override
    def retracted(
        self, tangent: Float[Array, " c"], free: FreeDirections
    ) -> "RoundBody":
        basis = tangent_basis(self.axis)
        tilt, across = (product(part, basis) for part in (tangent[:2], tangent[2:4]))
        axis = self.axis + tilt
        shift = (tangent[-2] + tangent[-1]) / 2
        height = self.height * grown((tangent[-1] - tangent[-2]) / self.height)
        stretch = height - self.height
        center = self.center + across + self.axis * shift
        axis = axis * jax.lax.rsqrt(jnp.sum(axis * axis))
        if self.growth is None:
            return RoundBody(center, axis, self.radius * grown(tangent[4]), height)
        follows = self.slope * jnp.stack([shift - stretch / 2, shift + stretch / 2])
        own = jnp.stack([self.radius1, self.radius2])
        radii = own * grown(tangent[4:6]) + follows
        radii = jnp.maximum(radii, LEAST_END * self.radius)
        radii = jnp.where(jnp.diagonal(free)[4:6] > 0, radii, own)
        radius, growth = (radii[0] + radii[1]) / 2, (radii[1] - radii[0]) / 2
        return RoundBody(center, axis, radius, height, growth)

    @override
    def free_basis(
        self,
        free: FreeDirections,
        unit: Float[Array, ""],
        end_unit: Float[Array, ""],
    ) -> Float[Array, "c c"]:
        radii = [self.radius]
        if self.growth is not None:
            least = LEAST_END * self.radius
            radii = [jnp.maximum(end, least) for end in (self.radius1, self.radius2)]
        basis = self.scaled(free, unit, end_unit, radii)
        if self.growth is None:
            return basis
        # A radius that is held does not follow the wall to where its end goes.
        held = jnp.diagonal(free)[4:6, None] == 0
        back = -self.slope * basis[-2:] / jnp.stack(radii)[:, None]
        return basis.at[4:6].add(jnp.where(held, back, 0))

    @override
    def readout(self, near: "RoundBody", ends_seen: Bool[Array, " e"]) -> Readout:
        basis = tangent_basis(near.axis)
        away = self.center - near.center
        # To the point of this axis that lies beside the other's center.
        along = jnp.sum(self.axis * away)
        half = self.axis * (self.height / 2)
        across = away - self.axis * along
        places = OrderedDict(center=self.center)
        radii = OrderedDict(radius=self.radius)
        if self.growth is not None:
            places = OrderedDict(p1=self.center - half, p2=self.center + half)
            # Where the other's ends are along this axis.
            ends = jnp.stack([-near.height / 2, near.height / 2]) - along
            own = jnp.stack([self.radius1, self.radius2])
            own = jnp.where(ends_seen, own, self.radius + self.slope * ends)
            radii = OrderedDict(zip(self.names_of_radii, own, strict=True))
        return OrderedDict(
            **places,
            across_axis=product(basis, across),
            along_axis=jnp.sum(near.axis * away),
            axis=product(basis, self.axis),
            **radii,
            height=self.height,
        )

    @override
    def reversed(self, sign: Float[Array, ""]) -> "RoundBody":
        growth = None if self.growth is None else self.growth * sign
        return RoundBody(
            self.center, self.axis * sign, self.radius, self.height, growth
        )

    @override
    def drawn_in(
        self, ends_seen: Bool[Array, " e"], reach: Float[Array, " e"]
    ) -> tuple["RoundBody", Float[Array, "c c"]]:
        reach = jnp.where(ends_seen, self.height / 2, reach)
        # Without a wall there is no extent to draw in to.
        height = jnp.sum(reach)
        is_wall = jnp.isfinite(height) & (height > 0)
        lower, upper = jnp.where(is_wall, reach, self.height / 2)
        shift, height = (upper - lower) / 2, upper + lower
        center = self.center + self.axis * shift
        carried = jnp.eye(6 + len(self.names_of_radii), dtype=height.dtype)
        # Tilted about a center, the axis moves at another one.
        carried = carried.at[0, 2].set(-shift).at[1, 3].set(-shift)
        if self.growth is None:
            return RoundBody(center, self.axis, self.radius, height), carried
        radius = self.radius + self.slope * shift
        body = RoundBody(center, self.axis, radius, height, self.slope * height / 2)
        # A radius at one of the other's ends grows the wall in proportion to the
        # distance from its other end.
        low, high = self.height / 2 - lower, upper - self.height / 2
        grown = jnp.array([[height + low, high], [-low, height - high]]) / height
        new, old = (jnp.stack([b.radius1, b.radius2]) for b in (body, self))
        ratio = new[:, None] / jnp.maximum(old, LEAST_END * self.radius)[None]
        return body, carried.at[4:6, 4:6].set(grown * ratio)

    @override
    def magnified(self, change: Numbers) -> "RoundBody":
        factor = grown(change)
        growth = None if self.growth is None else self.growth * factor
        return RoundBody(
            center=self.center * factor,
            axis=self.axis,
            radius=self.radius * factor,
            height=self.height * factor,
            growth=growth,
        )

    @override
    def turned(self) -> "RoundBody":
        sight = unit(self.center)
        across = jnp.cross(sight, self.axis)
        is_seen = jnp.sum(across**2) > END_ON**2
        radius = self.height / 2
        return RoundBody(
            # The front of its wall stays where it is.
            center=self.center + sight * (radius - self.radius),
            axis=unit(jnp.where(is_seen, across, tangent_basis(sight)[0])),
            radius=radius,
            height=2 * self.radius,
            growth=None if self.growth is None else jnp.zeros_like(self.growth),
        )


def _end_ahead(outside: Bool[Array, "*batch"], slope: Numbers) -> Numbers:
    """End whose plane a ray sees, -1 or 1: it enters there, or leaves from within."""
    return jnp.where(outside, -1, 1).astype(slope.dtype) * jnp.sign(slope)
