"""What bodies about an axis have in common, whatever their walls."""

__all__ = ["AbstractAxialBody", "in_frame"]

import abc
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from impostor_jax.fit.body import AbstractBody, FreeDirections, Passing, shift_to
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, product, safe_divide, safe_sqrt

SHORT = 2.0
"""Height in radii up to which an object is short."""

SQUARE = 2.0
"""Length over width, or width over length, up to which one is taken for the other."""


class AbstractAxialBody(AbstractBody):
    """A body about an axis, between two ends.

    Its tangent coordinates are the tilt of the axis and the motion of the center along
    the two vectors of `tangent_basis(axis)`, the logarithms of its radii, and the
    motions of the ends along the axis.

    Attributes:
        axis: Unit vector.
        height: Distance of the ends.
    """

    axis: eqx.AbstractVar[Float[Array, "*batch 3"]]
    height: eqx.AbstractVar[Numbers]

    @property
    @abc.abstractmethod
    def names_of_radii(self) -> tuple[str, ...]:
        """Names of the radii that are fitted."""

    @property
    @override
    def coordinates(self) -> dict[str, tuple[str, ...]]:
        """First and second are along the two vectors of `tangent_basis(axis)`."""
        return {
            "axis": ("axis_first", "axis_second"),
            "across_axis": ("center_first", "center_second"),
            "along_axis": ("center_along",),
            **{name: (name,) for name in self.names_of_radii},
            "height": ("height",),
        }

    @property
    @override
    def ends(self) -> tuple[int, ...]:
        return -1, 1

    @property
    @override
    def end_axes(self) -> Float[Array, "e 3"]:
        return jnp.stack([-self.axis, self.axis])

    @property
    @override
    def sign(self) -> Numbers:
        largest = self.axis[jnp.argmax(jnp.abs(self.axis))]
        return jnp.where(largest < 0, -1, 1).astype(largest.dtype)

    @property
    @override
    def is_long(self) -> Bool[Array, "*batch"]:
        return self.height > SHORT * self.radius

    @property
    @override
    def is_square(self) -> Bool[Array, "*batch"]:
        width = 2 * self.radius
        return (self.height < SQUARE * width) & (width < SQUARE * self.height)

    @property
    @override
    def size(self) -> Numbers:
        return (self.height + self.radius) / 2

    @override
    def end_shown(self, passing: Passing, depth: Numbers, slack: Numbers) -> Numbers:
        seen = passing
        wall = seen.nearest + seen.foot + seen.sign * safe_sqrt(seen.square)
        on_cap = seen.on_cap & (seen.rim < seen.cap_radius)
        on_cap &= jnp.abs(wall - depth) > slack
        return jnp.where(on_cap, seen.sign * jnp.sign(seen.local.direction.z), 0)

    @override
    def outward(self, passing: Passing) -> Float[Array, "e n"]:
        ends = jnp.array(self.ends, passing.along.dtype)[:, None]
        along = passing.along[None] * ends
        return jnp.where(passing.on_cap[None], -jnp.inf, along)

    @override
    def far_side(self, passing: Passing) -> Numbers:
        # A mug has no cap, and shows the inside of its wall and its floor.
        along, ahead = passing.local.origin.z, passing.local.direction.z
        floor = -passing.cap - 2 * safe_divide(along, ahead)
        return jnp.minimum(passing.nearest + jnp.maximum(passing.half, 0), floor)

    @property
    @override
    def bends(self) -> int:
        return 2

    @override
    def moved_across(
        self, passing: Passing, square: Numbers, slide: Numbers
    ) -> Passing:
        (o1, o2, _), (e1, e2, _) = in_frame(passing)
        n = passing.nearest
        x1, x2 = o1 + n * e1, o2 + n * e2
        more = shift_to(passing, x1 * x1 + x2 * x2, square)
        start, step = passing.local.origin.z, passing.local.direction.z
        origin = Vec3(o1 + more * x1, o2 + more * x2, start + slide * step)
        return eqx.tree_at(
            lambda p: (p.local.origin, p.square), passing, (origin, square)
        )

    @override
    def free_directions(self, fixed: tuple[str, ...]) -> Float[np.ndarray, "c c"]:
        names = ("axis", "axis", "center", "center", *self.names_of_radii)
        free = np.diag([*(float(name not in fixed) for name in names), 1.0, 1.0])
        # A held height moves both ends together, a held center moves them apart.
        together, apart = float("center" not in fixed), float("height" not in fixed)
        if together + apart < 2:
            free[-2:, -2] = together
            free[-2:, -1] = -apart, apart
        return free

    @override
    def transformed(self, target_from_source: RigidTransform) -> "AbstractAxialBody":
        return eqx.tree_at(
            lambda b: (b.center, b.axis),
            self,
            (
                target_from_source.apply(self.center),
                target_from_source.rotate(self.axis),
            ),
        )

    @override
    def carried(self, target_from_source: RigidTransform) -> Float[Array, "c c"]:
        own = target_from_source.rotate(tangent_basis(self.axis))
        there = tangent_basis(target_from_source.rotate(self.axis))
        # Both bases are of the plane across the axis.
        turn = product(own, there.T)
        carried = jnp.eye(6 + len(self.names_of_radii), dtype=turn.dtype)
        return carried.at[:2, :2].set(turn).at[2:4, 2:4].set(turn)

    @override
    def mirrored(self) -> "AbstractAxialBody":
        axis, center = self.axis, self.center
        along = jnp.sum(axis * center) / jnp.sum(center**2)
        return eqx.tree_at(lambda b: b.axis, self, axis - 2 * along * center)

    def scaled(
        self,
        free: FreeDirections,
        unit: Float[Array, ""],
        end_unit: Float[Array, ""],
        radii: Sequence[Numbers],
    ) -> Float[Array, "c c"]:
        """As `free_basis`, where each of the `radii` moves by itself."""
        lever, one = unit / self.size, jnp.ones_like(self.radius)
        steps = [lever, lever, unit * one, unit * one, *(unit / r for r in radii)]
        steps = jnp.stack([*steps, end_unit * one, end_unit * one])
        return jnp.asarray(free) * steps[:, None]


def in_frame(passing: Passing) -> tuple[tuple[Numbers, ...], tuple[Numbers, ...]]:
    """Where rays begin and their directions: across the axis twice, and along it."""
    o, d = passing.local.origin, passing.local.direction
    return (o.x, o.y, o.z), (d.x, d.y, d.z)
