"""The sphere as a fit moves it."""

__all__ = ["SphereBody"]

from collections import OrderedDict

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.fit.body import (
    AbstractAxislessBody,
    Chord,
    FreeDirections,
    Margins,
    Passing,
    Rays,
    Readout,
    blunted_root,
    grown,
    local_ray,
    shift_to,
)
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.numerics import Numbers
from impostor_jax.primitives.sphere import Sphere


class SphereBody(AbstractAxislessBody):
    """Sphere. It moves by its center and the logarithm of its radius."""

    center: Float[Array, "*batch 3"]
    radius: Numbers

    @staticmethod
    @override
    def of(shape: Sphere) -> "SphereBody":
        return SphereBody(jnp.asarray(shape.center), shape.radius)

    @property
    @override
    def shape(self) -> Sphere:
        return eqx.tree_at(
            lambda s: (s.center, s.radius),
            Sphere((0, 0, 0), 1),
            (self.center, self.radius),
        )

    @property
    @override
    def size(self) -> Numbers:
        return self.radius

    @property
    @override
    def coordinates(self) -> dict[str, tuple[str, ...]]:
        return {"center": ("center_x", "center_y", "center_z"), "radius": ("radius",)}

    @property
    @override
    def ends(self) -> tuple[int, ...]:
        return ()

    @property
    @override
    def end_axes(self) -> Float[Array, "e 3"]:
        return jnp.zeros((0, 3), self.radius.dtype)

    @property
    @override
    def is_long(self) -> Bool[Array, "*batch"]:
        return jnp.zeros(self.radius.shape, bool)

    @override
    def passing(self, rays: Rays, chord: Chord = 0.0, apart: bool = False) -> Passing:
        r = self.radius
        frame = jnp.eye(3, dtype=r.dtype)
        local, foot = local_ray(rays, self.center, frame)
        o, d = local.origin, local.direction
        d_d = d.dot(d)
        inverse = 1 / d_d
        aside = o.cross(d)
        square = (r * r - aside.dot(aside) * inverse) * inverse
        nearest = -o.dot(d) * inverse
        half, half_slope = blunted_root(square, chord)
        # |n.d| / |d| = h |d| / r, with the unit normal n.
        facing = jnp.maximum(half, 0) * jnp.sqrt(d_d) / r
        zero = jnp.zeros_like(square)
        return Passing(
            local=local,
            foot=foot,
            inverse=inverse,
            nearest=nearest,
            square=square,
            half=half,
            half_slope=half_slope,
            outside=nearest - half + foot > 0,
            cos_incidence=jnp.minimum(facing, 1),
            within=jnp.zeros(zero.shape, bool),
            on_cap=jnp.zeros(zero.shape, bool),
            **dict.fromkeys(
                ("cap", "rim", "cap_radius", "overshoot", "plane_weight", "along",
                 "enter_along", "leave_along"), zero
            ),
        )  # fmt: skip

    @override
    def covers(self, passing: Passing) -> Bool[Array, "*batch"]:
        return (passing.square > 0) & passing.outside

    @override
    def end_shown(self, passing: Passing, depth: Numbers, slack: Numbers) -> Numbers:
        return jnp.zeros_like(depth)

    @override
    def width_of_ends(self, beside: Float[Array, ""]) -> Float[Array, " e"]:
        return jnp.zeros(len(self.ends), beside.dtype)

    @override
    def outward(self, passing: Passing) -> Float[Array, "e n"]:
        return jnp.zeros((0, *passing.along.shape), passing.along.dtype)

    @override
    def far_side(self, passing: Passing) -> Numbers:
        return passing.nearest + jnp.maximum(passing.half, 0)

    @override
    def of_reading(
        self, passing: Passing, alpha: Numbers, beta: Numbers, on_cap: Bool[Array, "*b"]
    ) -> list[Numbers]:
        """Derivative of what is compared.

        With x the point of the nearest approach, from the center, and d the ray's
        direction, |d|^2 dn = d.dc and |d|^2 dq = 2 x.dc + 2 r dr.
        """
        o, d = passing.local.origin, passing.local.direction
        outward = beta * (2 * passing.inverse)
        by_center = d * (alpha * passing.inverse) + (o + d * passing.nearest) * outward
        return [
            *(by_center.x, by_center.y, by_center.z),
            self.radius * self.radius * outward,
        ]

    @property
    @override
    def bends(self) -> int:
        return 3

    @override
    def moved_across(
        self, passing: Passing, square: Numbers, slide: Numbers
    ) -> Passing:
        o, d = passing.local.origin, passing.local.direction
        aside = o + d * passing.nearest
        more = shift_to(passing, aside.dot(aside), square)
        return eqx.tree_at(
            lambda p: (p.local.origin, p.square), passing, (o + aside * more, square)
        )

    @override
    def margins(self, passing: Passing) -> Margins:
        value = -passing.square[None]
        wall = jnp.zeros_like(value[:, 0])
        return Margins(
            value=value,
            tells=jnp.ones(value.shape, bool),
            end=wall,
            side=np.array([-1.0]),
            line=wall,
            lines=(0,),
        )

    @override
    def of_end(
        self, passing: Passing, end: Numbers, side: Numbers
    ) -> tuple[Numbers, list[Numbers]]:
        zero = jnp.zeros_like(end)
        return zero, [zero] * 4

    @override
    def retracted(
        self, tangent: Float[Array, "4"], free: FreeDirections
    ) -> "SphereBody":
        return SphereBody(self.center + tangent[:3], self.radius * grown(tangent[3]))

    @override
    def free_basis(
        self,
        free: FreeDirections,
        unit: Float[Array, ""],
        end_unit: Float[Array, ""],
    ) -> Float[Array, "4 4"]:
        steps = jnp.stack([unit, unit, unit, unit / self.radius])
        return jnp.asarray(free) * steps[:, None]

    @override
    def free_directions(self, fixed: tuple[str, ...]) -> Float[np.ndarray, "4 4"]:
        is_free = [*["center" not in fixed] * 3, "radius" not in fixed]
        return np.diag(np.array(is_free, float))

    @override
    def transformed(self, target_from_source: RigidTransform) -> "SphereBody":
        center = jnp.asarray(target_from_source.apply(self.center))
        return SphereBody(center, self.radius)

    @override
    def magnified(self, change: Numbers) -> "SphereBody":
        factor = grown(change)
        return SphereBody(self.center * factor, self.radius * factor)

    @override
    def readout(self, near: "SphereBody", ends_seen: Bool[Array, " e"]) -> Readout:
        return OrderedDict(center=self.center, radius=self.radius)

    @override
    def drawn_in(
        self, ends_seen: Bool[Array, " e"], reach: Float[Array, " e"]
    ) -> tuple["SphereBody", Float[Array, "4 4"]]:
        return self, jnp.eye(4, dtype=self.radius.dtype)

    @override
    def carried(self, target_from_source: RigidTransform) -> Float[Array, "4 4"]:
        rotation = target_from_source.rotation.astype(self.radius.dtype)
        return jnp.eye(4, dtype=rotation.dtype).at[:3, :3].set(rotation.T)
