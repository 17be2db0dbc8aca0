"""How far rounding may move an answer: condition numbers, for a million rays.

The formulas are not the package's, and run in double precision, a thousand rays in the
time that `experiments.oracle.cylinder` takes for one; that one checks these.

An input x_i, rounded, is known to a relative eps. To first order a result f is then
known to eps sum |x_i df/dx_i|: over |f| this is its condition number, and over the eps
of single precision the size of what no formula can avoid. A decision, such as hit or
miss, is the sign of a margin g; it is sure unless |g| is below eps sum |x_i dg/dx_i|.
"""

__all__ = ["FIELDS", "Reference", "decisions", "frustum_bounds", "reference"]

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from experiments.oracle.extremes import Rays
from impostor_jax.numerics import safe_norm, safe_sqrt

FIELDS = tuple(field.name for field in dataclasses.fields(Rays))
CHUNK = 1000
"""Rays at a time, always as many: one compilation serves all."""

FAR = 1e30
"""Where a bound is that a parallel ray never meets."""


@dataclasses.dataclass(frozen=True)
class Reference:
    """Answers to a set of rays, and how well the inputs determine them.

    Attributes:
        t: Ray parameter of the first surface; inf on a miss.
        on_cap: Whether it is a cap.
        condition: Of t, in all 14 inputs; at least 2 on a hit, where t grows with all
            lengths together and shrinks as the direction grows.
        gradient: Of t in center (3), unit axis (3, its part across, over t), radius and
            height: numbers without a unit.
        gradient_condition: Of the gradient, in norm.
        hit_margin: Relative change of the inputs that turns a hit into a miss or back.
        surface_margin: The same for cap against wall, and entering against leaving.
    """

    t: Float[np.ndarray, " n"]
    on_cap: Bool[np.ndarray, " n"]
    condition: Float[np.ndarray, " n"]
    gradient: Float[np.ndarray, "n 8"]
    gradient_condition: Float[np.ndarray, " n"]
    hit_margin: Float[np.ndarray, " n"]
    surface_margin: Float[np.ndarray, " n"]


def reference(rays: Rays) -> Reference:
    """Answer in double precision, on the numbers as they are rounded in `rays`."""
    count = len(rays.radius)
    columns = []
    with jax.enable_x64(True):
        for start in range(0, count, CHUNK):
            rows = np.arange(start, start + CHUNK).clip(max=count - 1)
            fields = (np.asarray(getattr(rays, name)[rows], float) for name in FIELDS)
            columns.append(jax.device_get(_examine(*fields)))
    whole = (np.concatenate(column)[:count] for column in zip(*columns, strict=True))
    return Reference(*whole)


@jax.jit
@jax.vmap
def _examine(*fields):
    every = tuple(range(len(fields)))
    t, on_cap = _surface(*fields)
    hit = jnp.isfinite(t)
    condition = _change(fields, jax.grad(_depth, argnums=every)(*fields)) / t

    # Of the unit axis, and over t: both held fixed.
    scale = jnp.linalg.norm(fields[3]) / jnp.where(hit, t, 1)

    def gradient(*fields):
        center, axis, radius, height = jax.grad(_depth, argnums=(2, 3, 4, 5))(*fields)
        return jnp.concatenate([center, axis * scale, radius[None], height[None]])

    slope = gradient(*fields)
    bends = jax.jacfwd(gradient, argnums=every)(*fields)
    moved = sum(
        jnp.sum(jnp.abs(x) * jnp.linalg.norm(bend.reshape(8, -1), axis=0))
        for x, bend in zip(fields, bends, strict=True)
    )
    return (
        t,
        on_cap,
        jnp.where(hit, condition, 0),
        slope,
        jnp.where(hit, moved / jnp.linalg.norm(slope), 0),
        *decisions(_bounds, *fields),
    )


def decisions(bounds, *fields) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Relative change of the inputs that turns a hit, and the surface, into another.

    Args:
        bounds: Where a ray enters and leaves a body's wall and slab, from the fields.
        fields: Numbers of a ray and a body.
    """
    every = tuple(range(len(fields)))
    margins = _margins(bounds, *fields)
    slopes = jax.jacrev(partial(_margins, bounds), argnums=every)(*fields)
    moves = {name: _change(fields, slopes[name]) for name in margins}
    sure = {name: jnp.abs(margins[name]) / moves[name] for name in margins}
    surface = _surface_margin(margins, sure)
    return _hit_margin(margins, sure), surface


def _hit_margin(margins, sure):
    names = ("gap", "top", "bottom", "wall_ahead", "slab_ahead", "between")
    hit = jnp.min(jnp.stack([sure[name] for name in names]))
    # A miss ends when the last of its reasons does; beside the wall there is but one.
    fails = [jnp.where(margins[name] < 0, sure[name], 0) for name in names]
    miss = jnp.where(margins["gap"] < 0, sure["gap"], jnp.max(jnp.stack(fails)))
    is_hit = jnp.all(jnp.stack([margins[name] >= 0 for name in names]))
    return jnp.where(is_hit, hit, miss)


def _surface_margin(margins, sure):
    enters = jnp.stack([margins["into_wall"], margins["into_slab"]])
    how_sure = jnp.stack([sure["into_wall"], sure["into_slab"]])
    outside = jnp.max(enters) > 0
    ahead = jnp.max(jnp.where(enters > 0, how_sure, 0))
    margin = jnp.where(outside, ahead, jnp.min(how_sure))
    surface = jnp.where(outside, sure["cap_in"], sure["cap_out"])
    # On the wall and along the axis, both to rounding, the ray leaves anywhere.
    sine = jnp.where(margins["sine"] > 0, sure["sine"], 0)
    on_wall = jnp.stack([sure[name] for name in ("gap", "wall_ahead", "into_wall")])
    anywhere = jnp.maximum(sine, jnp.min(on_wall))
    return jnp.minimum(jnp.minimum(margin, surface), anywhere)


def _change(fields, slopes) -> Float[Array, ""]:
    """Sum of |x_i df/dx_i|: what a relative change of the inputs does at the most."""
    return sum(
        jnp.sum(jnp.abs(x * slope)) for x, slope in zip(fields, slopes, strict=True)
    )


def _bounds(origin, direction, center, axis, radius, height):
    """Where the ray enters and leaves wall and slab, and what else decides."""
    o, d, a, h = origin - center, direction, axis, height / 2
    length = jnp.sqrt(a @ a)
    # Any start and any point of the axis give the same t, but near ones cancel less.
    level = jax.lax.stop_gradient(jnp.clip(o @ a / length, -h, h) / length)
    start = o - level * a
    foot = jax.lax.stop_gradient(-(start @ d) / (d @ d))
    p = start + foot * d
    m, w, d_a = jnp.cross(d, a), jnp.cross(p, a), d @ a
    is_along, is_across = m @ m == 0, d_a == 0
    m_m, d_a = jnp.where(is_along, 1, m @ m), jnp.where(is_across, 1, d_a)
    gap = jnp.where(
        is_along,
        radius * length - safe_sqrt(w @ w),
        radius * jnp.sqrt(m_m) - jnp.abs(m @ p),
    )
    root = safe_sqrt(radius**2 * m_m - (m @ p) ** 2)
    middle, half = foot - m @ w / m_m, length * root / m_m
    planes = [(side * h * length - level * a @ a - p @ a) / d_a for side in (-1, 1)]
    between = h - jnp.abs(o @ a) / length
    beyond = jnp.where(between >= 0, FAR, -FAR)
    wall = (
        jnp.where(is_along, -FAR, middle - half),
        jnp.where(is_along, FAR, middle + half),
    )
    slab = (
        jnp.where(is_across, -beyond, foot + jnp.minimum(*planes)),
        jnp.where(is_across, beyond, foot + jnp.maximum(*planes)),
    )
    return gap, wall, slab, safe_norm(m), jnp.where(is_across, between, FAR)


def frustum_bounds(origin, direction, p1, p2, radius1, radius2):
    """As `_bounds`, of a frustum."""
    way, d = p2 - p1, direction
    length = jnp.sqrt(way @ way)
    a, slope = way / length, (radius2 - radius1) / length
    # Any point of the axis and any start give the same t, but near ones cancel less.
    second = (origin - p1) @ a > length / 2
    low, high = jnp.where(second, -length, 0), jnp.where(second, 0, length)
    radius = jnp.where(second, radius2, radius1)
    o = origin - jnp.where(second, p2, p1)
    level = jax.lax.stop_gradient(jnp.clip(o @ a, low, high))
    foot = jax.lax.stop_gradient(-((o - level * a) @ d) / (d @ d))
    o = o + foot * d
    o_a, d_a = o @ a, d @ a
    p, e = o - o_a * a, d - d_a * a
    rho, k = radius + slope * o_a, slope * d_a
    w, m_p = rho * e - k * p, jnp.cross(e, a) @ p
    opening, half_sum = e @ e - k * k, p @ e - rho * k
    root = safe_sqrt(w @ w - m_p**2)
    total = -jnp.where(half_sum < 0, half_sum - root, half_sum + root)
    total = jnp.where(total == 0, 1, total)
    roots = (p @ p - rho * rho) / total, total / jnp.where(opening == 0, 1, opening)
    first, last = jnp.minimum(*roots), jnp.maximum(*roots)
    is_within, is_across = opening < 0, d_a == 0
    wall = (
        foot + jnp.where(is_within, jnp.where(k > 0, last, -FAR), first),
        foot + jnp.where(is_within, jnp.where(k > 0, FAR, first), last),
    )
    gap = safe_norm(w) - jnp.abs(m_p)
    speed = jnp.where(is_across, 1, d_a)
    planes = [(end - o_a) / speed for end in (low, high)]
    between = jnp.minimum(o_a - low, high - o_a)
    beyond = jnp.where(between >= 0, FAR, -FAR)
    slab = (
        jnp.where(is_across, -beyond, foot + jnp.minimum(*planes)),
        jnp.where(is_across, beyond, foot + jnp.maximum(*planes)),
    )
    # A ray on the wall and along it, both to rounding, leaves it anywhere.
    along_wall = jnp.abs(safe_norm(e) - jnp.abs(k))
    return gap, wall, slab, along_wall, jnp.where(is_across, between, FAR)


def _surface(*fields):
    gap, wall, slab, _, _ = _bounds(*fields)
    enter, leave = jnp.maximum(wall[0], slab[0]), jnp.minimum(wall[1], slab[1])
    hit = (gap >= 0) & (enter <= leave) & (leave > 0)
    on_cap = jnp.where(enter > 0, slab[0] > wall[0], slab[1] < wall[1])
    return jnp.where(hit, jnp.where(enter > 0, enter, leave), jnp.inf), hit & on_cap


def _depth(*fields):
    return _surface(*fields)[0]


def _margins(bounds, *fields):
    gap, wall, slab, sine, between = bounds(*fields)
    return {
        "gap": gap,
        "top": wall[1] - slab[0],
        "bottom": slab[1] - wall[0],
        "wall_ahead": wall[1],
        "slab_ahead": slab[1],
        "between": between,
        "into_wall": wall[0],
        "into_slab": slab[0],
        "cap_in": slab[0] - wall[0],
        "cap_out": slab[1] - wall[1],
        "sine": sine,
    }
