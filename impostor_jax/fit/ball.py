"""The sphere as a fit moves it."""

__all__ = ["Ball"]

from collections import OrderedDict
from typing import Any, ClassVar

import equinox as eqx
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
from impostor_jax.fit.rows import Rows
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.sphere import Sphere

Numbers = Float[Array, "*batch"]


class Ball(AbstractBody):
    """Sphere. It moves by its center and the logarithm of its radius."""

    coordinates: ClassVar[dict[str, tuple[str, ...]]] = {
        "center": ("center_x", "center_y", "center_z"),
        "radius": ("radius",),
    }
    ends: ClassVar[tuple[int, ...]] = ()
    center: Float[Array, "*batch 3"]
    radius: Numbers

    @staticmethod
    @override
    def of(shape: Sphere) -> "Ball":
        return Ball(shape.center, shape.radius)

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
    def sign(self) -> Numbers:
        return jnp.ones_like(self.radius)

    @property
    @override
    def numbers(self) -> Float[Array, "4"]:
        return jnp.concatenate([self.center, self.radius[None]])

    @override
    def passing(
        self, direction: Vec3, chord: float | Float[Array, "*#batch"]
    ) -> Passing:
        center, r = Vec3.from_array(self.center), self.radius
        zero = jnp.zeros_like(direction.x)
        ray = Ray(Vec3(zero, zero, zero), direction)
        local, foot = ray.brought_near(center, center, r)
        o, d = local.origin, local.direction
        inverse = 1 / d.dot(d)
        aside = o.cross(d)
        square = (r * r - aside.dot(aside) * inverse) * inverse
        nearest = -o.dot(d) * inverse
        half, bend = blunted_root(square, chord)
        return Passing(
            local=local,
            foot=foot,
            inverse=inverse,
            # Of the nearest approach, from the center: exactly across the ray.
            m=d.cross(aside) * inverse,
            nearest=nearest,
            square=square,
            half=half,
            bend=bend,
            outside=nearest - half + foot > 0,
            cap=zero,
            on_cap=jnp.zeros(zero.shape, bool),
            rim=zero,
            wide=zero,
            falls=zero,
            keep=zero,
        )

    @override
    def seen(self, passing: Passing) -> SurfaceSeen:
        d, zero = passing.local.direction, jnp.zeros_like(passing.half)
        # |n.d| / |d| = h |d| / r, with the unit normal n.
        facing = jnp.maximum(passing.half, 0) * jnp.sqrt(d.dot(d)) / self.radius
        return SurfaceSeen(
            depth=passing.depth,
            cos_incidence=jnp.minimum(facing, 1),
            outside=passing.outside,
            on_cap=passing.on_cap,
            nearest=passing.nearest + passing.foot,
            square=passing.square,
            along=zero,
            enter_along=zero,
            leave_along=zero,
            slope=zero,
            cap_distance=zero,
        )

    @override
    def compared(
        self,
        rows: Rows,
        passing: Passing,
        error: Numbers,
        alpha: Numbers,
        beta: Numbers,
    ) -> tuple[Numbers, list[Numbers]]:
        """Error of each row, as it is, and its derivative.

        With x the point of the nearest approach, from the center, and d the ray's
        direction, |d|^2 dn = d.dc and |d|^2 dq = 2 x.dc + 2 r dr.
        """
        outward = beta * (2 * passing.inverse)
        by_center = passing.local.direction * (alpha * passing.inverse)
        by_center = by_center + passing.m * outward
        return error, [by_center.x, by_center.y, by_center.z, self.radius * outward]

    @override
    def margins(self, seen: SurfaceSeen) -> Float[Array, "k n m"]:
        return -seen.square[None]

    @override
    def covers(self, seen: SurfaceSeen) -> Bool[Array, "*batch"]:
        return (seen.square > 0) & seen.outside

    @override
    def moved(self, natural: Float[Array, "4"], fixed: tuple[str, ...]) -> "Ball":
        return Ball(self.center + natural[:3], self.radius * jnp.exp(natural[3]))

    @override
    def steps(
        self, unit: Float[Array, ""], end_unit: Float[Array, ""]
    ) -> Float[Array, "4"]:
        return jnp.stack([unit, unit, unit, unit / self.radius])

    @override
    def free_directions(self, fixed: tuple[str, ...]) -> Float[np.ndarray, "c n"]:
        free = np.eye(4)
        if "center" in fixed:
            return free[:, 3:]
        return free[:, :3] if "radius" in fixed else free

    @override
    def moving(self, fixed: tuple[str, ...]) -> tuple[int, ...]:
        center = () if "center" in fixed else (0, 1, 2)
        return center if "radius" in fixed else (*center, 3)

    @override
    def transformed(self, target_from_source: RigidTransform) -> "Ball":
        return Ball(target_from_source.apply(self.center), self.radius)

    @override
    def readout(self, near: "Ball", ends_seen: Bool[Array, " e"]) -> Readout:
        return OrderedDict(center=self.center, radius=self.radius)

    @override
    def reversed(self, sign: Float[Array, ""]) -> "Ball":
        return self

    @override
    def drawn_in(
        self, ends_seen: Bool[Array, " e"], reach: Float[Array, " e"]
    ) -> "Ball":
        return self

    @override
    def mirrored(self) -> "Ball":
        return self

    @override
    def distance(self, others: Any) -> Float[Array, " k"]:
        apart = jnp.sum((others.center - self.center[None]) ** 2, axis=1)
        return jnp.sqrt(apart + (others.radius - self.radius) ** 2)
