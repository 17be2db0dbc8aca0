"""The tube as a fit moves it: a cylinder with a bore.

Outside it is its outer cylinder. A ray that meets the plane of the end it sees within
the inner radius falls into the bore and sees, from inside, the wall of the inner
cylinder, whose nearest approach is that of the outer one: only the half-chord is
another. Past the far end that wall goes on, as the outer one does past the ends, so
that a tube that is too short still meets its readings; what the image shows of the
place where it stops is a crossing.

The rim of the bore is a jump in depth where it is nearer to the camera, and readings
that an estimate has on the wrong side of it are outliers without a pull. Nothing is
lost by that: the wall behind the rim tells the radius by far more readings. Where that
is not seen, the region's edge beside background is the rim, and pulls like an end.
"""

__all__ = ["TubeBody"]

import dataclasses
from collections import OrderedDict

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.fit.axial_body import AbstractAxialBody
from impostor_jax.fit.body import (
    Chord,
    FreeDirections,
    Margins,
    Passing,
    Rays,
    Readout,
    grown,
)
from impostor_jax.fit.round_body import CENTRAL, RoundBody
from impostor_jax.numerics import Numbers, safe_divide, safe_sqrt, smallest_slope
from impostor_jax.primitives.solid import Solid
from impostor_jax.primitives.tube import Tube, as_tube

INNER = 5
"""Place of the inner radius among the tangent coordinates; the outer one is before."""

WIDEST = 0.999
"""Inner radius, in outer ones, that a fit goes to."""

OF_BORE = (2.0, 3.0)
"""Numbers of the lines on which a bore's ends are seen."""


class TubeBody(AbstractAxialBody):
    """A cylinder with a bore, from end to end.

    Its tangent coordinates are those of `RoundBody` with the logarithm of the inner
    radius after that of the outer one.

    Attributes:
        center: Midpoint of the axis between the ends.
        axis: Unit vector.
        radius: Of the outer wall.
        inner_radius: Of the bore.
        height: Distance of the ends.
    """

    center: Float[Array, "*batch 3"]
    axis: Float[Array, "*batch 3"]
    radius: Numbers
    inner_radius: Numbers
    height: Numbers

    @staticmethod
    @override
    def of(shape: Solid) -> "TubeBody":
        tube = as_tube(shape)
        return TubeBody(jnp.asarray(tube.center), *tube[1:])

    @property
    @override
    def shape(self) -> Solid:
        return Tube(
            self.center, self.axis, self.radius, self.inner_radius, self.height
        ).solid

    @property
    def outer(self) -> RoundBody:
        """The outer cylinder."""
        return RoundBody(self.center, self.axis, self.radius, self.height)

    @property
    def bore(self) -> RoundBody:
        """The inner cylinder."""
        return RoundBody(self.center, self.axis, self.inner_radius, self.height)

    @property
    def outer_radius(self) -> Numbers:
        """The name that a caller knows the radius by."""
        return self.radius

    @property
    @override
    def names_of_radii(self) -> tuple[str, ...]:
        return "outer_radius", "inner_radius"

    def _with_outer(self, outer: RoundBody, inner_radius: Numbers) -> "TubeBody":
        return TubeBody(
            outer.center, outer.axis, outer.radius, inner_radius, outer.height
        )

    @override
    def passing(self, rays: Rays, chord: Chord = 0.0, apart: bool = False) -> Passing:
        outer, bore = (
            body.passing(rays, chord, apart) for body in (self.outer, self.bore)
        )
        # From between the ends and within the outer wall a camera sees the bore's.
        within = ~outer.outside | (outer.on_cap & (outer.rim < self.inner_radius))
        d = outer.local.direction
        across = d.x * d.x + d.y * d.y
        facing = across * jnp.maximum(bore.half, 0) / self.inner_radius
        facing = facing * jax.lax.rsqrt(across + d.z * d.z)
        ahead = d.z * (bore.nearest + bore.half) + outer.local.origin.z

        def of_wall(own: Numbers, other: Numbers) -> Numbers:
            return jnp.where(within, own, other)

        return Passing(
            local=outer.local,
            foot=outer.foot,
            inverse=outer.inverse,
            nearest=outer.nearest,
            square=of_wall(bore.square, outer.square),
            half=of_wall(bore.half, outer.half),
            half_slope=of_wall(bore.half_slope, outer.half_slope),
            outside=outer.outside,
            within=within,
            cos_incidence=of_wall(jnp.minimum(facing, 1), outer.cos_incidence),
            cap=outer.cap,
            on_cap=outer.on_cap & ~within,
            rim=outer.rim,
            cap_radius=of_wall(bore.cap_radius, outer.cap_radius),
            overshoot=of_wall(jnp.zeros_like(ahead), outer.overshoot),
            plane_weight=outer.plane_weight,
            along=of_wall(ahead, outer.along),
            enter_along=outer.enter_along,
            leave_along=outer.leave_along,
        )

    @override
    def wall_square(self, passing: Passing) -> Numbers:
        r = jnp.where(passing.within, self.inner_radius, self.radius)
        return r * r

    def _is_through(self, passing: Passing) -> Bool[Array, "*batch"]:
        """Rays that fall through the bore and see nothing of it."""
        beyond = passing.along * jnp.sign(passing.local.direction.z)
        # One along the axis has no nearest approach to its wall.
        is_along = passing.inverse == 0
        return passing.within & ((beyond > self.height / 2) | is_along)

    @override
    def width_of_ends(self, beside: Float[Array, ""]) -> Float[Array, " e"]:
        return jnp.zeros(len(self.ends), beside.dtype)

    @override
    def covers(self, passing: Passing) -> Bool[Array, "*batch"]:
        is_wall = passing.within & passing.outside & ~self._is_through(passing)
        return is_wall | (self.outer.covers(passing) & ~passing.within)

    @override
    def of_reading(
        self, passing: Passing, alpha: Numbers, beta: Numbers, on_cap: Bool[Array, "*b"]
    ) -> list[Numbers]:
        """Derivative of what is compared: of the wall that is seen, by its own radius.

        That of the logarithm of a radius is as its square.
        """
        told = self.outer.of_reading(passing, alpha, beta, on_cap)
        return self._by_own_radius(told, passing.within)

    def _by_own_radius(
        self, of_outer: list[Numbers], is_bore: Bool[Array, "*batch"]
    ) -> list[Numbers]:
        """Derivatives of the outer cylinder, with that in the radius of the wall."""
        *moves, in_radius, lower, upper = of_outer
        ratio = self.inner_radius / self.radius
        return [
            *moves,
            jnp.where(is_bore, 0, in_radius),
            jnp.where(is_bore, in_radius * ratio * ratio, 0),
            lower,
            upper,
        ]

    @override
    def margins(self, passing: Passing) -> Margins:
        within, d = passing.within, passing.local.direction
        near = -jnp.sign(d.z[0])
        # Through the far end of the bore, where its wall is seen beside.
        beyond = -near[None] * passing.along - self.height / 2
        least = CENTRAL * self.inner_radius**2 * jnp.abs(passing.inverse)
        central = within & passing.outside & (passing.square > least)
        # Or past the rim of the near end, where that end is.
        on_end = passing.outside & (passing.on_cap | within)
        on_end &= passing.rim < self.radius
        into = self.inner_radius - passing.rim
        pairs = (
            (beyond, central & central[:1]),
            (into, on_end & on_end[:1] & ~within[:1]),
        )
        of_bore = []
        for margin, is_told in pairs:
            own = jnp.where(jnp.any(is_told[1:], axis=0), margin[0], -1)
            of_bore.append(jnp.where(is_told, margin, own[None]))
        outer = self.outer.margins(passing)
        ends = jnp.stack([-near, near])
        told = jnp.ones((2, *within.shape), bool)
        lines = jnp.stack([jnp.full_like(near, line) for line in OF_BORE])
        return Margins(
            value=jnp.concatenate([outer.value, jnp.stack(of_bore)]),
            tells=jnp.concatenate([outer.tells, told]),
            end=jnp.concatenate([outer.end, ends]),
            # In a bore an end is on the other side.
            side=np.concatenate([outer.side, [1.0, -1.0]]),
            line=jnp.concatenate([outer.line, lines]),
            lines=(*outer.lines, *OF_BORE),
        )

    @override
    def of_end(
        self, passing: Passing, end: Numbers, side: Numbers
    ) -> tuple[Numbers, list[Numbers]]:
        """As of the cylinder; but in a bore the ends are seen the other way round.

        The far one is where a ray leaves its wall. The near one is a rim: what passes 0
        is the distance P of the point in its plane from the axis, less the radius. It
        changes as P/|P| does with the point, which slides along the ray as the plane
        moves.
        """
        faces = -jnp.sign(passing.local.direction.z) * end > 0
        within, no = passing.within, jnp.zeros_like(end)
        of_rim, of_wall = faces & (side < 0), ~faces & (side > 0) & within
        # The outer wall's, also where the bore's is seen.
        more = (self.radius - self.inner_radius) * (self.radius + self.inner_radius)
        square = passing.square + more * passing.inverse
        root = safe_sqrt(square)
        slope = safe_divide(jnp.full_like(root, 0.5), root)
        takes_outer = within & ~of_wall
        seen = dataclasses.replace(
            passing,
            square=jnp.where(takes_outer, square, passing.square),
            half=jnp.where(takes_outer, root, passing.half),
            half_slope=jnp.where(takes_outer, slope, passing.half_slope),
        )
        error, gradient = self.outer.of_end(seen, end, side)
        found = self._by_own_radius(gradient, of_wall)
        o, d = passing.local.origin, passing.local.direction
        parallel = jnp.abs(d.z) < smallest_slope(d.z.dtype)
        per_step = jnp.where(parallel, 0, 1 / jnp.where(parallel, 1, d.z))
        place = end * (self.height / 2)
        reach = (place - o.z) * per_step
        x, y = o.x + d.x * reach, o.y + d.y * reach
        rim = safe_sqrt(x * x + y * y)
        u, v = safe_divide(x, rim), safe_divide(y, rim)
        slides = (u * d.x + v * d.y) * per_step
        around = [
            -place * u - x * slides,
            -place * v - y * slides,
            -u,
            -v,
            no,
            no - self.inner_radius,
            jnp.where(end < 0, slides, 0),
            jnp.where(end > 0, slides, 0),
        ]
        error = jnp.where(of_rim, rim - self.inner_radius, error)
        pairs = zip(around, found, strict=True)
        return error, [jnp.where(of_rim, one, other) for one, other in pairs]

    @override
    def retracted(
        self, tangent: Float[Array, " c"], free: FreeDirections
    ) -> "TubeBody":
        others = np.delete(np.arange(len(free)), INNER)
        outer = self.outer.retracted(tangent[others], free[np.ix_(others, others)])
        inner = self.inner_radius * grown(tangent[INNER])
        held = free[INNER, INNER] == 0
        bounded = jnp.minimum(inner, WIDEST * outer.radius)
        return self._with_outer(outer, jnp.where(held, self.inner_radius, bounded))

    @override
    def free_basis(
        self,
        free: FreeDirections,
        unit: Float[Array, ""],
        end_unit: Float[Array, ""],
    ) -> Float[Array, "c c"]:
        radii = [self.radius, self.inner_radius]
        return self.scaled(free, unit, end_unit, radii)

    @override
    def readout(self, near: "TubeBody", ends_seen: Bool[Array, " e"]) -> Readout:
        read = self.outer.readout(near.outer, ends_seen)
        height, outer_radius = read.pop("height"), read.pop("radius")
        return OrderedDict(
            **read,
            outer_radius=outer_radius,
            inner_radius=self.inner_radius,
            height=height,
        )

    @override
    def reversed(self, sign: Float[Array, ""]) -> "TubeBody":
        return self._with_outer(self.outer.reversed(sign), self.inner_radius)

    @override
    def drawn_in(
        self, ends_seen: Bool[Array, " e"], reach: Float[Array, " e"]
    ) -> tuple["TubeBody", Float[Array, "c c"]]:
        outer, of_outer = self.outer.drawn_in(ends_seen, reach)
        return self._with_outer(outer, self.inner_radius), _with_inner(of_outer)

    @override
    def magnified(self, change: Numbers) -> "TubeBody":
        inner = self.inner_radius * grown(change)
        return self._with_outer(self.outer.magnified(change), inner)

    @override
    def turned(self) -> "TubeBody":
        outer = self.outer.turned()
        inner = self.inner_radius * (outer.radius / self.radius)
        return self._with_outer(outer, inner)


def _with_inner(of_outer: Float[Array, "k k"]) -> Float[Array, "c c"]:
    """What moves the outer cylinder, and an inner radius that nothing else moves."""
    count = len(of_outer) + 1
    others = np.delete(np.arange(count), INNER)
    carried = jnp.eye(count, dtype=of_outer.dtype)
    return carried.at[np.ix_(others, others)].set(of_outer)
