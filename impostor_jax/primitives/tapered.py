"""Round body whose radius changes linearly along its axis, whole or a sector of it.

What a frustum and a cylinder with a sector have in common. The wall (one nappe of a
cone), the slab between the ends and the sector are each one interval of a ray, or all
but one. So a ray spends at most two stretches in the solid. The first of their ends in
front of the origin that is there is seen: missing caps or faces are passed through to
the wall's inner side.

Rounding. All is counted from a point of the axis near the ray's origin, with the radius
of that place, so that a tip close to the camera is as exact as a wall. The bounds of
`impostor_jax.primitives.cylinder` hold: 8 eps times the condition number in depth.
"""

__all__ = [
    "HIGH_CAP",
    "NUM_PARTS",
    "Tapered",
    "tapered_distance",
    "tapered_hit",
    "tapered_normal",
    "tapered_outline_gap",
    "tapered_rim_gap",
    "tapered_stretches",
]

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import zero_from_primal
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.compiling import computed_apart
from impostor_jax.geometry.rays import Hit, Ray, cone_interval, plane_interval
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import (
    Numbers,
    eps,
    has_square,
    safe_divide,
    safe_sqrt,
    smallest_slope,
)
from impostor_jax.primitives.sector import Sector
from impostor_jax.primitives.stretch import End, Stretch
from impostor_jax.primitives.surface import facing, hit_tangent, within_range

NUM_PARTS = 5
WALL, LOW_CAP, HIGH_CAP, START_FACE, END_FACE = range(NUM_PARTS)
"""Parts of the surface."""


class Tapered(eqx.Module):
    """The body, relative to a point of its axis.

    Attributes:
        anchor: The point; any, but the nearer to where rays start, the more exact.
        axis: Unit vector.
        low: Where the body begins, along the axis from the anchor.
        high: Where it ends.
        radius: Of the wall at the anchor.
        slope: Change of the radius per length along the axis.
        sector: Part of the turn; None for all of it.
        caps: Whether the ends are closed.
        cut_faces: Whether the faces of the cut are closed.
    """

    anchor: Vec3
    axis: Vec3
    low: Float[Array, "*#batch"]
    high: Float[Array, "*#batch"]
    radius: Float[Array, "*#batch"]
    slope: Float[Array, "*#batch"]
    sector: Sector | None
    caps: bool = eqx.field(static=True)
    cut_faces: bool = eqx.field(static=True)

    @property
    def end_radii(self) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Radii of the low and the high end."""
        return self.radius + self.slope * self.low, self.radius + self.slope * self.high


class _Bound(NamedTuple):
    """Where a ray crosses the surface of the solid, and which part."""

    at: Float[Array, "*batch"]
    part: Int[Array, "*batch"]

    def where(self, mask: Bool[Array, "*batch"], other: "_Bound") -> "_Bound":
        """Take this one where `mask` holds and the other elsewhere."""
        return jax.tree.map(lambda x, y: jnp.where(mask, x, y), self, other)


def tapered_hit(ray: Ray, body: Tapered) -> Hit:
    """First surface in front of the origin; `part` tells which."""
    t, part = _first_hit(ray, body)
    on_cap = (part == LOW_CAP) | (part == HIGH_CAP)
    return Hit(t=t, on_cap=on_cap & jnp.isfinite(t), part=part)


def tapered_normal(ray: Ray, hit: Hit, body: Tapered) -> Vec3:
    """Unit normal at a hit, turned towards the ray's origin; zero on a miss."""
    q = ray.at(jnp.where(hit.mask, hit.t, 0)) - body.anchor
    n, _ = _gradient(q, hit.part, body)
    return facing(n.normalize(), ray.direction, hit.mask)


def tapered_stretches(ray: Ray, body: Tapered) -> tuple[Stretch, ...] | None:
    """Stretches of the ray in the solid; None of what is open."""
    if not (body.caps and (body.cut_faces or body.sector is None)):
        return None
    near, foot, is_solid = _near_solid(ray, body)

    def end(bound: _Bound) -> End:
        at, part = bound
        n, _ = _gradient(near.at(jnp.where(jnp.isfinite(at), at, 0)), part, body)
        on_cap = (part == LOW_CAP) | (part == HIGH_CAP)
        slope = jnp.abs(n.normalize().dot(near.direction))
        return End(foot + at, part, on_cap, slope)

    found = [Stretch(end(enter), end(leave)) for enter, leave in _bounds(near, body)]
    return tuple(stretch.where(stretch.crosses & is_solid) for stretch in found)


def tapered_distance(point: Vec3, body: Tapered) -> Float[Array, "*batch"]:
    """Signed distance from the closed solid, in meters, negative inside.

    With a sector it is the larger of the distances from the whole solid and from the
    sector: 0 on the same surface, and never more than the true distance.
    """
    q, a = point - body.anchor, body.axis
    along = q.dot(a)
    out = (q - a * along).norm()
    at_low, at_high = body.end_radii
    length = body.high - body.low
    # In the half-plane of axis and point the solid is bounded by three segments.
    way_out, way_up = at_high - at_low, length
    part = (out - at_low) * way_out + (along - body.low) * way_up
    part = jnp.clip(part / (way_out * way_out + way_up * way_up), 0, 1)
    off_wall = Vec3(
        out - at_low - part * way_out,
        along - body.low - part * way_up,
        jnp.zeros_like(out),
    ).norm()
    off_ends = [
        safe_sqrt(jnp.maximum(out - wide, 0) ** 2 + (along - end) ** 2)
        for wide, end in ((at_low, body.low), (at_high, body.high))
    ]
    size = jnp.minimum(off_wall, jnp.minimum(*off_ends))
    inside = (out < body.radius + body.slope * along) & (
        (body.low < along) & (along < body.high)
    )
    distance = jnp.where(inside, -size, size)
    if body.sector is None:
        return distance
    return jnp.maximum(distance, body.sector.distance(q, a))


def tapered_outline_gap(ray: Ray, body: Tapered) -> Numbers:
    """How far within the outline of a whole body rays pass, in meters.

    Along a ray the wall's radius less the distance from the axis is concave, and the
    ray meets the body where its largest value between the ends is not negative. That is
    where it is stationary, or at one of the ends.
    """
    near, _ = _near(ray, body)
    o_a, d_a = near.origin.dot(body.axis), near.direction.dot(body.axis)
    e, p = (v - body.axis * v.dot(body.axis) for v in (near.direction, near.origin))
    rho, k = body.radius + body.slope * o_a, body.slope * d_a
    e_e = e.dot(e)
    is_along = e_e < smallest_slope(e_e.dtype) ** 2
    e_e = jnp.where(is_along, 1, e_e)
    middle = -e.dot(p) / e_e
    # On a cone it is not where the axis is nearest; on a steep ray it is nowhere.
    opening = e_e - k * k
    shift = k * (p + e * middle).norm()
    shift = safe_divide(shift, safe_sqrt(e_e) * safe_sqrt(opening))
    best = jnp.where(opening > 0, middle + shift, jnp.sign(k) * jnp.inf)
    best = jax.lax.stop_gradient(jnp.where(is_along & (k == 0), 0, best))
    slab = plane_interval(near, body.axis, body.low, body.high)
    at = jnp.where(best > slab.upper, slab.upper, best)
    at = jnp.where(best < slab.lower, slab.lower, at)
    between = jnp.minimum(o_a - body.low, body.high - o_a)
    # No point of a ray beside the ends and parallel to them lies between them.
    is_beside = slab.lower > slab.upper
    at = jnp.where(is_beside, 0, at)
    gap = rho + k * at - (p + e * at).norm()
    return jnp.where(is_beside, between, gap)


def tapered_rim_gap(ray: Ray, is_high: Bool[Array, "*batch"], body: Tapered) -> Numbers:
    """How far within a rim rays pass its plane, in meters; 1 where they never do.

    Args:
        ray: That pass near it.
        is_high: Whether it is the rim of the high end.
        body: The body.
    """
    near, _ = _near(ray, body)
    o_a, d_a = near.origin.dot(body.axis), near.direction.dot(body.axis)
    at_low, at_high = body.end_radii
    level = jnp.where(is_high, body.high, body.low)
    crosses = jnp.abs(d_a) > smallest_slope(d_a.dtype)
    q = near.at(jnp.where(crosses, (level - o_a) / jnp.where(crosses, d_a, 1), 0))
    out = (q - body.axis * q.dot(body.axis)).norm()
    return jnp.where(crosses, jnp.where(is_high, at_high, at_low) - out, 1)


def _near(ray: Ray, body: Tapered) -> tuple[Ray, Numbers]:
    """The ray from near the body, and the parameter that it starts from."""
    level = jnp.clip((ray.origin - body.anchor).dot(body.axis), body.low, body.high)
    widest = jnp.maximum(*body.end_radii)
    return ray.brought_near(body.anchor, body.anchor + body.axis * level, widest)


@jax.custom_jvp
def _first_hit(
    ray: Ray, body: Tapered
) -> tuple[Float[Array, "*batch"], Int[Array, "*batch"]]:
    """Ray parameter of the first hit, `+inf` on a miss, and the part that is hit."""

    def trace() -> tuple[Float[Array, "*batch"], Int[Array, "*batch"]]:
        near, foot, is_solid = _near_solid(ray, body)
        t = jnp.full(foot.shape, jnp.inf, foot.dtype)
        part = jnp.full(foot.shape, WALL)
        for enter, leave in _bounds(near, body):
            meets = is_solid & (enter.at <= leave.at)
            for bound in (enter, leave):
                at = foot + bound.at
                nearer = meets & _is_closed(bound.part, body) & (at > 0) & (at < t)
                t = jnp.where(nearer, at, t)
                part = jnp.where(nearer, bound.part, part)
        return t, part

    return computed_apart(trace, body.radius)


def _near_solid(
    ray: Ray, body: Tapered
) -> tuple[Ray, Float[Array, "*batch"], Bool[Array, "*#batch"]]:
    """The ray from near the body, and whether that has a size."""
    at_low, at_high = body.end_radii
    widest = jnp.maximum(at_low, at_high)
    near, foot = _near(ray, body)
    # An end that is a point may be rounded to less than nothing.
    least = -eps(widest.dtype, 8) * widest
    is_solid = has_square(widest) & (jnp.minimum(at_low, at_high) >= least)
    return near, foot, is_solid & (body.low < body.high)


def _is_closed(part: Int[Array, "*batch"], body: Tapered) -> Bool[Array, "*batch"]:
    """Whether a part of the surface is there."""
    is_there = jnp.ones(part.shape, bool)
    if not body.caps:
        is_there &= (part != LOW_CAP) & (part != HIGH_CAP)
    if not body.cut_faces:
        is_there &= (part != START_FACE) & (part != END_FACE)
    return is_there


def _bounds(near: Ray, body: Tapered) -> list[tuple[_Bound, _Bound]]:
    """Where the ray enters and leaves the closed solid, once or, of a sector, twice."""
    a = body.axis
    wall = cone_interval(near, a, body.radius, body.slope)
    slab = plane_interval(near, a, body.low, body.high)
    rises = near.direction.dot(a) > 0
    # An end that is a point, to rounding, has no cap.
    at_low, at_high = body.end_radii
    least = eps(at_low.dtype, 4) * jnp.maximum(at_low, at_high)
    has_low, has_high = at_low > least, at_high > least
    into_cap = (slab.lower > wall.lower) & jnp.where(rises, has_low, has_high)
    out_of_cap = (slab.upper < wall.upper) & jnp.where(rises, has_high, has_low)
    cap_in = jnp.where(rises, LOW_CAP, HIGH_CAP)
    cap_out = jnp.where(rises, HIGH_CAP, LOW_CAP)
    solid = wall.overlap(slab)
    enter = _Bound(solid.lower, jnp.where(into_cap, cap_in, WALL))
    leave = _Bound(solid.upper, jnp.where(out_of_cap, cap_out, WALL))
    if body.sector is None:
        return [(enter, leave)]
    cut = body.sector.cut(near, a)
    low, high = cut.stretch.lower, cut.stretch.upper
    begins = jnp.where(cut.begins_at_start, START_FACE, END_FACE)
    finishes = jnp.where(cut.finishes_at_start, START_FACE, END_FACE)
    # Of less than half a turn what lies between the faces, or else all but that.
    low = jnp.where(cut.is_convex | cut.crosses, low, jnp.inf)
    high = jnp.where(cut.is_convex | cut.crosses, high, jnp.inf)
    into = _Bound(low, begins).where(cut.is_convex & (low > enter.at), enter)
    last = jnp.where(cut.is_convex, high, low)
    part = jnp.where(cut.is_convex, finishes, begins)
    first = into, _Bound(last, part).where(last < leave.at, leave)
    again = _Bound(high, finishes).where(high > enter.at, enter)
    again = again._replace(at=jnp.where(cut.is_convex, jnp.inf, again.at))
    return [first, (again, leave)]


@_first_hit.defjvp
def _first_hit_jvp(primals, tangents):
    (ray, body), (d_ray, d_body) = primals, tangents
    hit, part = _first_hit(ray, body)
    mask = jnp.isfinite(hit)
    t = jnp.where(mask, hit, 0)
    d, a = ray.direction, body.axis
    q = (ray.at(t) - body.anchor) * mask.astype(t.dtype)
    n, along = _gradient(q, part, body)
    on_wall = part == WALL
    d_a = d.dot(a)
    # Of the part of d across the axis: rounding leaves a radial a part along it.
    across = (d - a * d_a).where(on_wall, d)
    lean = jnp.where(on_wall, body.slope * d_a, 0)
    n_d = (n + a * jnp.where(on_wall, body.slope, 0)).dot(across) - lean
    local = jnp.abs(body.radius + body.slope * along)
    # A frustum's ends turn the axis by their move over the length between them, and
    # what they are differentiated through needs some room.
    span = body.high - body.low
    lengths = q.dot(q) + t * t * d.dot(d)
    lengths += safe_divide(lengths, jnp.broadcast_to(span * span, lengths.shape))
    squares = lengths * (1 + body.slope * body.slope)
    bending_radius = jnp.where(on_wall, local, 1) / 1024
    n, n_d, q, along, t = within_range(
        (n, n_d, q, along, t), squares, bending_radius, n_d
    )
    d_q = d_ray.at(t) - d_body.anchor
    # How far the surface itself moves along n, the point held.
    moved = jnp.where(part == LOW_CAP, -d_body.low, 0)
    moved = jnp.where(part == HIGH_CAP, d_body.high, moved)
    moved = jnp.where(on_wall, d_body.radius + along * d_body.slope, moved)
    # The wall's radial unit vector is n + slope a, and a turns across itself.
    turned = n * along + q * body.slope
    end = jnp.where(part == LOW_CAP, -1, jnp.where(part == HIGH_CAP, 1, 0))
    turned = turned.where(on_wall, q * -end.astype(t.dtype))
    moved = moved + turned.dot(d_body.axis)
    if body.sector is not None:
        for face, plane in (
            (START_FACE, -d_body.sector.start),
            (END_FACE, d_body.sector.end),
        ):
            moved = jnp.where(part == face, -q.dot(plane), moved)
    d_t = hit_tangent(moved - n.dot(d_q), n_d, mask)
    return (hit, part), (d_t, zero_from_primal(part))


def _gradient(
    q: Vec3, part: Int[Array, "*batch"], body: Tapered
) -> tuple[Vec3, Float[Array, "*batch"]]:
    """Gradient of the equation of a part of the surface, and q along the axis.

    It points outward and is a unit vector, but on a wall: there it is the radial unit
    vector, leaning by the slope.

    Args:
        q: Point of the surface, relative to the anchor.
        part: Which part.
        body: The body.
    """
    a, along = body.axis, q.dot(body.axis)
    # Counted in radii, so that no power of a small one is lost.
    local = jax.lax.stop_gradient(jnp.abs(body.radius + body.slope * along))
    counted = q * jnp.where(has_square(local), 1 / local, 1)
    radial = (counted - a * counted.dot(a)).normalize()
    n = (radial - a * body.slope).where(part == WALL, a)
    n = (-a).where(part == LOW_CAP, n)
    if body.sector is not None:
        n = (-body.sector.start).where(part == START_FACE, n)
        n = body.sector.end.where(part == END_FACE, n)
    return n, along
