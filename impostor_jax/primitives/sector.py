"""Part of the turn about an axis, and where a ray is in it.

A sector of at most half a turn is the overlap of two half-spaces, a larger one all but
the sector that is missing. So a ray spends one interval in the sector or one outside
it, and no angle of a point is ever computed.
"""

__all__ = ["Cut", "Sector", "sector", "sector_fields", "with_zero_turned"]

from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.arguments import float_arrays, is_concrete
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Interval, Ray
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps, kept_from_zero, smallest_slope

Body = TypeVar("Body", bound=Any)


class Sector(eqx.Module):
    """Counterclockwise part of a turn, by the planes of its two cut faces.

    Attributes:
        start: Unit normal of the face where it starts, into the sector.
        end: Unit normal of the face where it ends, out of the sector.
    """

    start: Vec3
    end: Vec3

    def cut(self, ray: Ray, axis: Vec3) -> "Cut":
        """Where a ray crosses the faces.

        Args:
            ray: Relative to a point of the axis.
            axis: Unit vector.
        """
        is_convex = self.start.cross(self.end).dot(axis) >= 0
        sign = jnp.where(is_convex, 1, -1).astype(self.start.x.dtype)
        first = _half_space(ray, self.start * sign)
        second = _half_space(ray, self.end * -sign)
        return Cut(
            first.overlap(second),
            is_convex,
            first.lower > second.lower,
            first.upper < second.upper,
        )

    def distance(self, q: Vec3, axis: Vec3) -> Float[Array, "*batch"]:
        """Signed distance from the faces' planes, negative in the sector.

        Args:
            q: Relative to a point of the axis.
            axis: Unit vector.
        """
        before, after = -q.dot(self.start), q.dot(self.end)
        return jnp.where(
            self.start.cross(self.end).dot(axis) >= 0,
            jnp.maximum(before, after),
            jnp.minimum(before, after),
        )


class Cut(eqx.Module):
    """A ray and a sector.

    Attributes:
        stretch: Of the ray, in the smaller of the sector and the rest of the turn.
        is_convex: Whether that is the sector.
        begins_at_start: Whether the stretch begins at the face of the start.
        finishes_at_start: Whether it finishes there.
    """

    stretch: Interval
    is_convex: Bool[Array, "*#batch"]
    begins_at_start: Bool[Array, "*batch"]
    finishes_at_start: Bool[Array, "*batch"]

    @property
    def crosses(self) -> Bool[Array, "*batch"]:
        """Whether there is a stretch."""
        return self.stretch.lower <= self.stretch.upper


def sector(
    axis: Vec3,
    start_angle: Float[Array, "*batch"] | None,
    end_angle: Float[Array, "*batch"] | None,
    zero: Float[Array, "*batch 3"] | None,
) -> Sector | None:
    """Sector from one angle counterclockwise about the axis to another; None stays.

    Args:
        axis: Unit vector.
        start_angle: In radians.
        end_angle: In radians; only its difference from the other modulo a turn counts.
        zero: Direction of the angle 0; its part along the axis does not count.
    """
    if start_angle is None or end_angle is None or zero is None:
        return None
    z = Vec3.from_array(zero)
    x = (z - axis * z.dot(axis)).normalize()
    y = axis.cross(x)

    def plane(angle: Float[Array, "*batch"]) -> Vec3:
        return y * jnp.cos(angle) - x * jnp.sin(angle)

    return Sector(plane(start_angle), plane(end_angle))


def sector_fields(
    axis: Float[Array, "*batch 3"], start_angle: Any, end_angle: Any, zero: Any
) -> tuple[Any, Any, Any]:
    """Check the three arguments of a sector; all None stand for the whole turn.

    Args:
        axis: Unit vectors.
        start_angle: In radians.
        end_angle: In radians.
        zero: Direction of the angle 0; if None, one that `tangent_basis` chooses.

    Raises:
        ValueError: One is missing, the angles are a whole turn apart, or zero is along
            the axis.
    """
    if start_angle is None and end_angle is None and zero is None:
        return None, None, None
    if start_angle is None or end_angle is None:
        raise ValueError(
            "start_angle and end_angle must both be given, in radians, got "
            f"{start_angle} and {end_angle} with zero {zero}"
        )
    if zero is None:
        basis = jnp.vectorize(tangent_basis, signature="(3)->(2,3)")(axis)
        zero = jax.lax.stop_gradient(basis[..., 0, :])
    start, end, zero, _ = float_arrays(
        start_angle=(start_angle, (), "radians"),
        end_angle=(end_angle, (), "radians"),
        zero=(zero, (3,), "numbers"),
        axis=(axis, (3,), "numbers"),
    )
    start, end, zero = (x.astype(axis.dtype) for x in (start, end, zero))
    if is_concrete((start, end)):
        low, high = np.asarray(start), np.asarray(end)
        sweep = np.remainder(high - low, 2 * np.pi)
        few = eps(low.dtype, 4) * (1 + np.abs(low) + np.abs(high))
        if np.any(np.minimum(sweep, 2 * np.pi - sweep) <= few):
            raise ValueError(
                "start_angle and end_angle must differ by a part of a turn, in "
                f"radians, got {low} and {high}; None stands for the whole turn"
            )
    if is_concrete((axis, zero)):
        a, z = np.asarray(axis), np.asarray(zero)
        aside = np.linalg.norm(np.cross(a, z), axis=-1)
        if np.any(aside <= eps(a.dtype, 8) * np.linalg.norm(z, axis=-1)):
            raise ValueError(f"zero must not be along the axis {a}, got {z}")
    return start, end, zero


def with_zero_turned(body: Body, target_from_source: RigidTransform) -> Body:
    """A body whose direction of the angle 0, if it has one, is in another frame."""
    if body.zero is None:
        return body
    return eqx.tree_at(lambda b: b.zero, body, target_from_source.rotate(body.zero))


def _half_space(ray: Ray, normal: Vec3) -> Interval:
    """Stretch of the ray on the side of a plane through 0 that the normal is on."""
    level, speed = ray.origin.dot(normal), ray.direction.dot(normal)
    least = smallest_slope(speed.dtype)
    parallel = jnp.abs(speed) < least
    crossing = -level / kept_from_zero(speed, least)
    never = parallel & (level < 0)
    lower = jnp.where(never, jnp.inf, jnp.where(speed > 0, crossing, -jnp.inf))
    upper = jnp.where(never, -jnp.inf, jnp.where(speed < 0, crossing, jnp.inf))
    always = parallel & (level >= 0)
    return Interval(
        jnp.where(always, -jnp.inf, lower), jnp.where(always, jnp.inf, upper)
    )
