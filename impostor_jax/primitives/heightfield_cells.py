"""First crossing of a ray with a grid of patches, none passed over.

The ray walks over square blocks of patches, whose heights have a known range: over one
that it stays clear of in a single step, into the four parts of any other. In a patch it
takes steps that provably do not cross (`free_step`): the bound of the gap's second
derivative there is exact for a bilinear patch, so that one step ends on the surface.

Blocks are counted, not measured: a ray leaves a block by going to its neighbor, at the
parameter where both say that their common edge is. So no rounding lets it slip between
two, and the side of the surface on which it began is remembered from block to block.

References:
    Tevs, Ihrke, Seidel (2008), Maximum mipmaps for fast, accurate, and scalable dynamic
    height field rendering.
"""

__all__ = ["first_crossing"]

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.geometry.lanes import in_lanes
from impostor_jax.geometry.rays import Interval, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, eps
from impostor_jax.primitives.heightfield_grid import (
    Indices,
    MaximumMipmap,
    largest_curvature,
    surface,
)
from impostor_jax.primitives.heightfield_march import free_step, side_of


def first_crossing(
    points: Float[Array, "k k rows cols"],
    near: Ray,
    half_x: Float[Array, ""],
    half_z: Float[Array, ""],
    span: Interval,
) -> Float[Array, "*batch"]:
    """Ray parameter of the first crossing, `+inf` where there is none.

    Args:
        points: Control points of the patches.
        near: Ray in meters from the middle of the grid.
        half_x: Half of the grid's extent along x, in meters.
        half_z: Likewise along z.
        span: Stretch of the ray over the grid.
    """
    ray = _in_patches(near, points, half_x, half_z)
    mipmap = MaximumMipmap.of(points)
    last = len(mipmap.shapes) - 1
    active = span.lower <= span.upper
    t = jnp.where(active, span.lower, 0)
    side = _side(points, ray, t)

    def turn(
        given: tuple[Ray, Numbers, Interval],
    ) -> Callable[[_State], _State]:
        ray, side, span = given
        o, d = ray.origin, ray.direction
        least = jnp.maximum(jnp.abs(span.lower), jnp.abs(span.upper))
        least = eps(least.dtype, 2) * least

        def once(state: _State) -> _State:
            t, i, j, level, active, found = state
            size = jnp.left_shift(1, level)
            to_x = _reaches(jnp.where(d.x > 0, i + 1, i) * size, o.x, d.x)
            to_z = _reaches(jnp.where(d.z > 0, j + 1, j) * size, o.z, d.z)
            leave = jnp.maximum(t, jnp.minimum(jnp.minimum(to_x, to_z), span.upper))
            lowest = jnp.minimum(side * (o.y + t * d.y), side * (o.y + leave * d.y))
            enters = active & (lowest <= mipmap.top(level, i, j, side))
            descends = enters & (level > 0)
            at_patch = enters & (level == 0)
            step = jax.lax.cond(
                jnp.any(at_patch),
                lambda: _step(points, ray, side, t, i, j, leave, least),
                lambda: jnp.zeros_like(t),
            )
            arrives = at_patch & (step <= 0)
            found = jnp.where(arrives, t - step, found)
            advances = at_patch & (step > 0) & (t + step < leave)
            passes = active & ~arrives & ~advances & ~descends

            over_x = to_x <= to_z
            i_next = i + jnp.where(passes & over_x, _sign(d.x), 0)
            j_next = j + jnp.where(passes & ~over_x, _sign(d.z), 0)
            rows, cols = mipmap.shape(level)
            inside = (i_next >= 0) & (i_next < rows) & (j_next >= 0) & (j_next < cols)
            active = active & ~arrives & ~(passes & ((leave >= span.upper) | ~inside))
            # Into another block of twice the size: that one is yet to be looked at.
            ascends = passes & (level < last)
            ascends &= (i_next >> 1 != i >> 1) | (j_next >> 1 != j >> 1)
            level = level + ascends.astype(level.dtype) - descends.astype(level.dtype)
            rows, cols = mipmap.shape(level)
            size = jnp.left_shift(1, level)
            i_part = _part(i, o.x + t * d.x, size, rows)
            j_part = _part(j, o.z + t * d.z, size, cols)
            i = jnp.where(descends, i_part, jnp.where(ascends, i_next >> 1, i_next))
            j = jnp.where(descends, j_part, jnp.where(ascends, j_next >> 1, j_next))
            t = jnp.where(advances, t + step, jnp.where(passes, leave, t))
            return _State(t, i, j, level, active, found)

        return once

    zero = jnp.zeros(t.shape, jnp.int32)
    begin = _State(t, zero, zero, zero + last, active, jnp.full_like(t, jnp.inf))
    given = ray, side, span
    return in_lanes(turn, lambda state: state.is_open, given, begin).found


class _State(NamedTuple):
    """What a ray that walks is at.

    Attributes:
        t: Ray parameter.
        i: Number of its block along x.
        j: Likewise along z.
        level: Of the blocks: their size is 2 to this.
        is_open: Whether it goes on.
        found: Ray parameter of its crossing; infinite while there is none.
    """

    t: Float[Array, "*batch"]
    i: Int[Array, "*batch"]
    j: Int[Array, "*batch"]
    level: Int[Array, "*batch"]
    is_open: Bool[Array, "*batch"]
    found: Float[Array, "*batch"]


def _in_patches(
    near: Ray,
    points: Float[Array, "k k rows cols"],
    half_x: Float[Array, ""],
    half_z: Float[Array, ""],
) -> Ray:
    """The ray with x and z counted in patches from the corner of the first one."""
    rows, cols = points.shape[2:]
    per_x, per_z = rows / (2 * half_x), cols / (2 * half_z)
    o, d = near.origin, near.direction
    return Ray(
        origin=Vec3(o.x * per_x + rows / 2, o.y, o.z * per_z + cols / 2),
        direction=Vec3(d.x * per_x, d.y, d.z * per_z),
    )


def _step(
    points: Float[Array, "k k rows cols"],
    ray: Ray,
    side: Numbers,
    t: Numbers,
    i: Indices,
    j: Indices,
    leave: Numbers,
    least: Numbers,
) -> Float[Array, "*batch"]:
    """How far the gap surely stays open in patch (i, j).

    Where it closes at once, minus the little way to there, or 0. One array tells both,
    so that XLA evaluates the patch once.
    """
    d = ray.direction
    here = points[:, :, i, j] * side[None, None]
    count = max(points.shape[2:])
    gap, slope, rounding = _gap(here, count, ray, side, t, i, j)
    step = free_step(jnp.maximum(gap, 0), slope, -largest_curvature(here, d.x, d.z))
    closes = (gap <= rounding) & ((slope < 0) | (step <= least))
    rest = jnp.where(gap > 0, jnp.minimum(step, leave - t), 0)
    return jnp.where(closes | (gap < -rounding), -rest, jnp.maximum(step, least))


def _side(
    points: Float[Array, "k k rows cols"], ray: Ray, t: Numbers
) -> Float[Array, "*batch"]:
    """Side on which a ray begins."""
    _, _, rows, cols = points.shape
    p = ray.at(t)
    i = jnp.clip(jnp.floor(p.x).astype(jnp.int32), 0, rows - 1)
    j = jnp.clip(jnp.floor(p.z).astype(jnp.int32), 0, cols - 1)
    up = jnp.ones_like(t)
    return side_of(*_gap(points[:, :, i, j], max(rows, cols), ray, up, t, i, j))


def _gap(
    here: Float[Array, "k k *batch"],
    count: int,
    ray: Ray,
    side: Numbers,
    t: Numbers,
    i: Indices,
    j: Indices,
) -> tuple[Numbers, Numbers, Numbers]:
    """Gap to the patch (i, j) of control points `here`, its slope, its rounding."""
    o, d = ray.origin, ray.direction
    u = o.x + t * d.x - i.astype(t.dtype)
    v = o.z + t * d.z - j.astype(t.dtype)
    h, by_u, by_v = surface(here, u, v)
    slope = side * d.y - by_u * d.x - by_v * d.z
    # Of u and v, which count up to the size of the grid, and of the two heights.
    lengths = jnp.abs(o.y) + jnp.abs(t * d.y) + jnp.abs(h)
    places = count * (jnp.abs(by_u) + jnp.abs(by_v))
    rounding = eps(t.dtype, 2) * (lengths + places)
    return side * (o.y + t * d.y) - h, slope, rounding


def _reaches(edge: Indices, o: Numbers, d: Numbers) -> Numbers:
    """Ray parameter of an edge; `+inf` for a ray along it."""
    along = d == 0
    return jnp.where(
        along, jnp.inf, (edge.astype(o.dtype) - o) / jnp.where(along, 1, d)
    )


def _part(i: Indices, x: Numbers, size: Indices, count: Indices) -> Indices:
    """Number of the half of block i that holds x, of the halves' size and count."""
    second = 2 * i + 1
    beyond = (x >= (second * size).astype(x.dtype)) & (second < count)
    return 2 * i + beyond.astype(i.dtype)


def _sign(d: Numbers) -> Indices:
    return jnp.where(d > 0, 1, -1)
