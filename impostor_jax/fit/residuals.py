"""Whitened residuals of a cylinder against a depth image.

A reading is compared with the depth of the surface along its own ray: sensors err along
the ray, and the orthogonal distance is biased then (a radius of 20 mm comes out 0.97 mm
too small at 3 mm noise and 1 m). The end away from the camera has no part in these
residuals; it shows where the wall stops and background begins, and gives residuals of
its own.
"""

__all__ = [
    "Pixels",
    "Rows",
    "SurfaceSeen",
    "gather_pixels",
    "image_rows",
    "residual_gradient",
    "residuals",
    "surface_seen",
]

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.geometry.rays import Ray, slab_interval
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import safe_divide, smallest_slope
from impostor_jax.primitives.cylinder import Cylinder

MAX_EDGE_PIXELS = 1024
"""Most pixels at the object's edge that are looked at."""

MAX_END_ROWS = 512
"""Most places where an end is seen: one for each row or column of the object."""


class Rows(eqx.Module):
    """What the image says along some rays from the camera's center; one residual each.

    Attributes:
        direction: In the camera frame, with z = 1.
        end: 0 for a reading; for a ray that passes the place where the wall ends, -1 at
            the end `center - axis * height / 2` and 1 at the other.
        target: Depth that was read, in meters; 0 for an end.
        weight: Inverse of the standard deviation; 0 for rows that only fill up.
    """

    direction: Vec3
    end: Float[Array, "*batch"]
    target: Float[Array, "*batch"]
    weight: Float[Array, "*batch"]


class SurfaceSeen(eqx.Module):
    """What a ray sees of a cylinder without a far end.

    Attributes:
        depth: In meters; finite for every ray.
        outside: Whether the ray starts outside, and sees the surface that it enters.
        on_cap: Whether the surface is a cap.
        half_chord: Half the depth interval inside the wall; negative on a ray that
            misses it, by the same law.
        miss_squared: Squared distance between the ray's line and the axis, in radii.
        along: Coordinate of the wall's point along the axis, from the center.
        cap_end: End of the cap that the ray would see: -1 or 1, as in `Rows`.
        cap_distance_squared: Squared distance from the axis of the point in that cap's
            plane, in radii.
    """

    depth: Float[Array, "*batch"]
    outside: Bool[Array, "*batch"]
    on_cap: Bool[Array, "*batch"]
    half_chord: Float[Array, "*batch"]
    miss_squared: Float[Array, "*batch"]
    along: Float[Array, "*batch"]
    cap_end: Float[Array, "*batch"]
    cap_distance_squared: Float[Array, "*batch"]


class _Approach(eqx.Module):
    """Where a ray's line passes the axis, relative to the cylinder's center.

    Attributes:
        local: The ray, starting at its point nearest to the center.
        foot: Depth of that point.
        m: Direction across ray and axis, d x a.
        inverse: 1 / |m|^2; 0 for a ray along the axis.
        offset: m.o, the distance between the lines times |m|.
        nearest: Ray parameter of the nearest approach, from the foot.
        squared: Squared half-chord in the infinite wall, negative on a miss.
        blunt: (squared^2 + soft^4)^(-1/4), the half-chord over its square.
    """

    local: Ray
    foot: Float[Array, "*batch"]
    m: Vec3
    inverse: Float[Array, "*batch"]
    offset: Float[Array, "*batch"]
    nearest: Float[Array, "*batch"]
    squared: Float[Array, "*batch"]
    blunt: Float[Array, "*batch"]


def _approach(
    direction: Vec3, cylinder: Cylinder, soft: float | Float[Array, ""]
) -> _Approach:
    center, a = Vec3.from_array(cylinder.center), Vec3.from_array(cylinder.axis)
    zero = jnp.zeros_like(direction.x)
    local, foot = Ray(Vec3(zero, zero, zero), direction).recentered(center)
    o, d, r = local.origin, local.direction, cylinder.radius
    m = d.cross(a)
    m_m, m_o = m.dot(m), m.dot(o)
    parallel = m_m < smallest_slope(m_m.dtype) ** 2
    # XLA writes each quotient and root to a buffer of its own: there is one of a kind.
    inverse = jnp.where(parallel, 0, 1 / jnp.where(parallel, 1, m_m))
    squared = (r * r - m_o * m_o * inverse) * inverse
    fourth = jnp.maximum(squared**2 + soft**4, np.finfo(squared.dtype).tiny)
    return _Approach(
        local=local,
        foot=foot,
        m=m,
        inverse=inverse,
        offset=m_o,
        nearest=-m.dot(o.cross(a)) * inverse,
        squared=squared,
        blunt=jax.lax.rsqrt(jnp.sqrt(fourth)),
    )


def surface_seen(
    direction: Vec3, cylinder: Cylinder, soft: float | Float[Array, ""] = 0.0
) -> SurfaceSeen:
    """Depth of the surface along each ray, continued past the outline.

    A ray that misses the wall gets the depth of its nearest approach, plus the square
    root of its miss as a ray that hits gets it less: the depth grows steadily as the
    wall recedes, so the residual pulls the outline over every pixel of the object.

    Args:
        direction: Of rays from the camera's center, in its frame.
        cylinder: In the camera frame.
        soft: Half-chord in meters below which the square root gives way to a straight
            line, so that a solver can move the outline across pixels: the half-chord
            sqrt(q) becomes q / (q^2 + soft^4)^(1/4).
    """
    return _surface(_approach(direction, cylinder, soft), cylinder)


def _surface(passing: _Approach, cylinder: Cylinder) -> SurfaceSeen:
    a, r = Vec3.from_array(cylinder.axis), cylinder.radius
    o, d, foot = passing.local.origin, passing.local.direction, passing.foot
    parallel = passing.inverse == 0
    half = passing.squared * passing.blunt
    slab = slab_interval(passing.local, a, cylinder.height / 2)
    cap_in = jnp.where(jnp.isfinite(slab.lower), slab.lower, -jnp.inf)
    cap_out = jnp.where(jnp.isfinite(slab.upper), slab.upper, jnp.inf)
    wall_in = jnp.where(parallel, -jnp.inf, passing.nearest - half)
    wall_out = jnp.where(parallel, jnp.inf, passing.nearest + half)
    enter, leave = jnp.maximum(wall_in, cap_in), jnp.minimum(wall_out, cap_out)
    outside = enter + foot > 0
    t = jnp.where(outside, enter, leave)
    t = jnp.where(jnp.isfinite(t), t, 0)
    wall = passing.nearest + jnp.where(outside, -half, half)
    cap = jnp.where(outside, cap_in, cap_out)
    in_plane = o + d * jnp.where(jnp.isfinite(cap), cap, 0)
    from_axis = in_plane.cross(a)
    return SurfaceSeen(
        depth=t + foot,
        outside=outside,
        on_cap=jnp.where(outside, cap_in > wall_in, cap_out < wall_out),
        half_chord=half,
        miss_squared=passing.offset**2 * passing.inverse / (r * r),
        along=(o + d * wall).dot(a),
        cap_end=jnp.where(outside, -1.0, 1.0) * jnp.sign(d.dot(a)),
        cap_distance_squared=from_axis.dot(from_axis) / (r * r),
    )


@jax.custom_jvp
def residuals(
    rows: Rows, cylinder: Cylinder, soft: float | Float[Array, ""]
) -> Float[Array, " n"]:
    """Cylinder less image, in standard deviations.

    Args:
        rows: What the image says.
        cylinder: In the camera frame.
        soft: As in `surface_seen`.

    Derivatives:
        In the cylinder by `residual_gradient`, in all else by automatic
        differentiation.
    """
    return _residuals(rows, cylinder, soft)


def _residuals(
    rows: Rows, cylinder: Cylinder, soft: float | Float[Array, ""]
) -> Float[Array, " n"]:
    seen = surface_seen(rows.direction, cylinder, soft)
    past_end = seen.along - rows.end * cylinder.height / 2
    error = jnp.where(rows.end == 0, seen.depth - rows.target, past_end)
    return error * rows.weight


@partial(residuals.defjvp, symbolic_zeros=True)
def _residuals_jvp(primals, tangents):
    rows, cylinder, soft = primals
    d_rows, d_cylinder, d_soft = jax.tree.map(
        lambda t, p: jnp.zeros_like(p) if isinstance(t, SymbolicZero) else t,
        tangents,
        primals,
        is_leaf=lambda t: isinstance(t, SymbolicZero),
    )
    move = jnp.concatenate(
        [
            d_cylinder.center,
            d_cylinder.axis,
            jnp.stack([d_cylinder.radius, d_cylinder.height]),
        ]
    )
    change = residual_gradient(rows, cylinder, soft) @ move
    others = (tangents[0], tangents[2])
    if all(isinstance(t, SymbolicZero) for t in jax.tree.leaves(others)):
        return residuals(rows, cylinder, soft), change
    out, more = jax.jvp(
        lambda r, w: _residuals(r, cylinder, w), (rows, soft), (d_rows, d_soft)
    )
    return out, change + more


def residual_gradient(
    rows: Rows, cylinder: Cylinder, soft: float | Float[Array, ""]
) -> Float[Array, "n 8"]:
    """Derivative of each residual in center, axis, radius and height.

    Shorter than what differentiating the formulas gives: the Jacobian takes a third of
    the time. With m = d x a across ray and axis, e = a x m / |m|^2, and the ray passing
    the axis at the distance s along m / |m|, where the axis has the coordinate l, a
    motion dc, da of the axis changes

        s by -m.(dc + l da) / |m|,
        t of the nearest approach by e.(dc + l da) + s (d.a) (m.da) / |m|^3,
        |m|^2 by -2 (d.a) |m|^2 (e.da),

    and the squared half-chord (r^2 - s^2) / |m|^2 follows.
    """
    a, r = Vec3.from_array(cylinder.axis), cylinder.radius
    passing = _approach(rows.direction, cylinder, soft)
    seen = _surface(passing, cylinder)
    o, d, inverse = passing.local.origin, passing.local.direction, passing.inverse
    d_a = d.dot(a)
    e = a.cross(passing.m) * inverse
    pull = passing.m * (passing.offset * inverse * inverse)
    level = o.dot(a) + passing.nearest * d_a
    # Of the blunted half-chord in its square, with the sign that the surface has.
    slope = passing.blunt * (1 - (seen.half_chord * passing.blunt) ** 2 / 2)
    slope = jnp.where(seen.outside, -slope, slope)

    # Of the wall's t.
    in_center = e + pull * (2 * slope)
    in_axis = in_center * level + pull * d_a + e * (2 * passing.squared * d_a * slope)
    in_radius = 2 * r * slope * inverse
    wall = passing.nearest + jnp.where(seen.outside, -seen.half_chord, seen.half_chord)
    from_center = o + d * wall

    # A cap's point stays in its plane.
    parallel = jnp.abs(d_a) < smallest_slope(d_a.dtype)
    per_step = jnp.where(parallel, 0, 1 / jnp.where(parallel, 1, d_a))
    cap_point = o + d * (seen.depth - passing.foot)
    is_end = rows.end != 0
    on_cap = seen.on_cap & ~is_end

    def of_row(of_wall: Vec3, of_cap: Vec3, of_along: Vec3) -> Float[Array, "n 3"]:
        return of_along.where(is_end, of_cap.where(on_cap, of_wall)).stack()

    in_height = jnp.where(on_cap, seen.cap_end * per_step / 2, 0)
    columns = [
        of_row(in_center, a * per_step, in_center * d_a - a),
        of_row(in_axis, cap_point * -per_step, in_axis * d_a + from_center),
        jnp.where(is_end, in_radius * d_a, jnp.where(on_cap, 0, in_radius))[:, None],
        jnp.where(is_end, -rows.end / 2, in_height)[:, None],
    ]
    return jnp.concatenate(columns, axis=1) * rows.weight[:, None]


class Pixels(eqx.Module):
    """What the image holds at some pixels.

    Attributes:
        direction: Of the rays, in the camera frame, with z = 1.
        depth: In meters; 0 where there is no reading.
        exists: False beyond the image, and for entries that only fill up.
        in_region: Whether the pixel belongs to the object.
    """

    direction: Vec3
    depth: Float[Array, "*batch"]
    exists: Bool[Array, "*batch"]
    in_region: Bool[Array, "*batch"]


def gather_pixels(
    depth: Float[Array, "h w"],
    region: Bool[Array, "h w"],
    camera: AbstractCamera,
    row: Int[Array, " n"],
    col: Int[Array, " n"],
) -> tuple[Pixels, Pixels]:
    """Collect what the image holds at the object and around its edge.

    Args:
        depth: In meters; 0 where there is no reading.
        region: Pixels of the object.
        camera: The camera.
        row: Rows of the object's pixels; one beyond the image only fills up.
        col: Columns of the object's pixels.

    Returns:
        The object's pixels, (n,), and (5, m) those at its edge with their neighbors:
        itself, left, right, above and below.
    """
    height, width = depth.shape

    def gather(row: Int[Array, "*batch"], col: Int[Array, "*batch"]) -> Pixels:
        exists = (row >= 0) & (row < height) & (col >= 0) & (col < width)
        row, col = jnp.where(exists, row, 0), jnp.where(exists, col, 0)
        return Pixels(
            direction=camera.rays(row, col, depth.dtype).direction,
            depth=depth[row, col],
            exists=exists,
            in_region=region[row, col],
        )

    down, right = jnp.array([[0, 0, 0, -1, 1], [0, -1, 1, 0, 0]])[..., None]
    around = gather(row[None] + down, col[None] + right)
    outside = jnp.any(around.exists & ~around.in_region, axis=0)
    is_edge = jnp.where(around.exists[0] & outside, 1, 0).astype(depth.dtype)
    is_edge, chosen = jax.lax.top_k(is_edge, min(MAX_EDGE_PIXELS, row.shape[0]))
    edge_row = jnp.where(is_edge > 0, row[chosen], -2)
    return gather(row, col), gather(edge_row[None] + down, col[chosen][None] + right)


def image_rows(
    pixels: Pixels, edge: Pixels, sigma: Float[Array, ""], cylinder: Cylinder
) -> Rows:
    """Rows of the readings, and of the places where an end of the wall is seen.

    Readings. Where a ray grazes the wall, depth runs as the square root of the distance
    from the outline. Within one sigma of it the linear law that a deviation stands for
    does not hold, and the few pixels there would carry the whole fit: a reading tells
    the half-chord h no better than sigma, so its deviation is taken as
    sigma sqrt(1 + (sigma / h)^2).

    Ends. Neighbors are compared along the image direction that is nearer to the axis.
    An end needs a pixel of the region on the wall, its neighbor outside the region, and
    there a reading farther away than the wall would be if it went on. A nearer reading
    is an occluder or a support, a missing one says nothing. The end lies anywhere
    between the two pixels' places on the axis, with even odds.

    Args:
        pixels: Pixels of the object.
        edge: Pixels at its edge, with their neighbors.
        sigma: Standard deviation of a reading, in meters.
        cylinder: First estimate, in the camera frame.

    Returns:
        One row for each pixel, then the rows of ends.
    """
    seen = surface_seen(pixels.direction, cylinder)
    h = jnp.abs(seen.half_chord)
    sharpness = jnp.where(seen.on_cap, 1, h * jax.lax.rsqrt(h * h + sigma * sigma))
    readings = Rows(
        direction=pixels.direction,
        end=jnp.zeros_like(pixels.depth),
        target=pixels.depth,
        weight=jnp.where(pixels.exists, sharpness / sigma, 0),
    )
    ends = _end_rows(edge, sigma, cylinder)
    return jax.tree.map(lambda *rows: jnp.concatenate(rows), readings, ends)


def _end_rows(edge: Pixels, sigma: Float[Array, ""], cylinder: Cylinder) -> Rows:
    a, c = cylinder.axis, cylinder.center
    # Image motion along the axis, times the squared depth.
    across = jnp.abs(a[0] * c[2] - c[0] * a[2]) > jnp.abs(a[1] * c[2] - c[1] * a[2])
    itself, left_right, above_below = slice(0, 1), slice(1, 3), slice(3, 5)
    edge = jax.tree.map(
        lambda field: jnp.concatenate(
            [field[itself], jnp.where(across, field[left_right], field[above_below])]
        ),
        edge,
    )
    direction, seen = edge.direction, surface_seen(edge.direction, cylinder)
    behind = edge.depth - seen.depth > jnp.maximum(5 * sigma, 0.1 * cylinder.radius)
    # Near the outline of the wall, background beside it is not an end.
    central = edge.exists & (seen.miss_squared < 0.9**2)
    # A missing reading has depth 0, which is never behind.
    beyond = central & ~edge.in_region & behind
    crosses = beyond[1:] & central[:1] & ~seen.on_cap[:1]
    along = seen.along[1:] - seen.along[:1]
    # At least the width of a pixel, so that no row has more weight than its place.
    x, y = direction.x, direction.y
    footprint = jnp.hypot(x[1:] - x[:1], y[1:] - y[:1]) * seen.depth[:1]
    gap = jnp.maximum(jnp.abs(along), footprint)
    rows = Rows(
        direction=jax.tree.map(lambda field: (field[1:] + field[:1]) / 2, direction),
        end=jnp.where(along > 0, 1, -1).astype(gap.dtype),
        target=jnp.zeros_like(gap),
        weight=safe_divide(jnp.where(crosses, 12**0.5, 0), gap),
    )
    rows = jax.tree.map(lambda field: field.reshape(-1), rows)
    _, chosen = jax.lax.top_k(rows.weight, min(MAX_END_ROWS, rows.weight.size))
    return jax.tree.map(lambda field: field[chosen], rows)
