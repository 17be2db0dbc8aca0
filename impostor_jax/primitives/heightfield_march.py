"""Marching along a ray towards a surface that is known by its gap alone.

The gap is the height of a point above the surface. It is no distance: over steep ground
a step in proportion to it, as shaders take it, passes through
(experiments/marching_trade). `advance` takes steps over which the gap provably keeps
its sign, from a bound on how fast it may close (`free_step`).
"""

__all__ = ["advance", "free_step", "side_of"]

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.geometry.lanes import in_lanes
from impostor_jax.geometry.rays import Interval, Ray
from impostor_jax.numerics import Numbers, eps, safe_divide, safe_sqrt

Gap = Callable[[Ray, Numbers], Numbers]
"""Height above the surface of the point of a ray at a parameter, in meters."""

MOST_STEPS = 1 << 14
"""Of `advance`: a ray that is still within a hair's breadth then counts as a hit."""


def advance(
    gap: Gap,
    ray: Ray,
    span: Interval,
    reach: Float[Array, ""],
    lipschitz: Float[Array, ""],
    curvature: Float[Array, ""] | None,
) -> Numbers:
    """Ray parameter where the gap first closes, `+inf` where it does not.

    Args:
        gap: Of rays and their parameters.
        ray: The ray.
        span: Stretch of the ray over the extent.
        reach: Lengths, besides that of the ray, whose rounding the gap suffers.
        lipschitz: Bound of the surface's slope.
        curvature: Bound of its second derivative; None where none is known.
    """
    active = span.lower <= span.upper
    t = jnp.where(active, span.lower, 0)

    def rounding(ray: Ray, t: Numbers) -> Numbers:
        o, d = ray.origin, ray.direction
        return eps(t.dtype, 2) * (jnp.abs(o.y) + jnp.abs(t * d.y) + reach)

    now, slope = jax.jvp(lambda t: gap(ray, t), (t,), (jnp.ones_like(t),))
    side = side_of(now, slope, rounding(ray, t))

    def turn(given: tuple[Ray, Numbers, Numbers]) -> Callable[[_State], _State]:
        ray, side, upper = given
        d = ray.direction
        level = safe_sqrt(d.x * d.x + d.z * d.z)
        closing = lipschitz * level - side * d.y
        along_ray = None if curvature is None else curvature * level * level

        def above(t: Numbers) -> Numbers:
            return side * gap(ray, t)

        def slope_of(t: Numbers) -> tuple[Numbers, Numbers]:
            if along_ray is None:
                return above(t), jnp.zeros_like(t)
            return jax.jvp(above, (t,), (jnp.ones_like(t),))

        def once(state: _State) -> _State:
            now, slope = slope_of(state.t)
            close = rounding(ray, state.t)
            # A ray that begins on the surface has to leave it first.
            arrives = ((now <= close) & state.away) | (now < -close)
            arrives &= state.is_open
            room = jnp.maximum(now, close)
            closes = closing > 0
            step = jnp.where(closes, room / jnp.where(closes, closing, 1), jnp.inf)
            if along_ray is not None:
                step = jnp.maximum(step, free_step(room, slope, -along_ray))
            ahead = state.t + step
            goes_on = state.is_open & ~arrives & (ahead <= upper)
            return _State(
                num_steps=state.num_steps + 1,
                t=jnp.where(goes_on, ahead, state.t),
                away=state.away | (now > close),
                is_open=goes_on & (state.num_steps < MOST_STEPS),
                hits=jnp.where(state.is_open, arrives | goes_on, state.hits),
            )

        return once

    nothing = jnp.zeros(t.shape, bool)
    begin = _State(jnp.zeros(t.shape, jnp.int32), t, nothing, active, nothing)
    given = ray, side, span.upper
    end = in_lanes(turn, lambda state: state.is_open, given, begin)
    return _settled(partial(gap, ray), jnp.where(end.hits, end.t, jnp.inf))


class _State(NamedTuple):
    """What a ray that marches is at.

    Attributes:
        num_steps: That it took.
        t: Ray parameter.
        away: Whether it has been off the surface.
        is_open: Whether it goes on.
        hits: Whether it ends on the surface, as far as it has come.
    """

    num_steps: Int[Array, "*batch"]
    t: Float[Array, "*batch"]
    away: Bool[Array, "*batch"]
    is_open: Bool[Array, "*batch"]
    hits: Bool[Array, "*batch"]


def side_of(gap: Numbers, slope: Numbers, rounding: Numbers) -> Numbers:
    """Side of the surface: 1 above, -1 below; on it, the side to which a ray goes."""
    leans = jnp.where(jnp.abs(gap) > rounding, gap, slope)
    return jnp.where(leans < 0, -jnp.ones_like(gap), jnp.ones_like(gap))


def _settled(gap: Callable[[Numbers], Numbers], t: Numbers) -> Numbers:
    """Ray parameter after a step of Newton's, where that lowers the gap."""
    at = jnp.where(jnp.isfinite(t), t, 0)
    now, slope = jax.jvp(gap, (at,), (jnp.ones_like(at),))
    ahead = at - safe_divide(now, slope)
    lowers = jnp.isfinite(t) & (jnp.abs(gap(ahead)) < jnp.abs(now))
    return jnp.where(lowers, ahead, t)


def free_step(gap: Numbers, slope: Numbers, curvature: Numbers) -> Numbers:
    """Step s over which a gap cannot close: first root of its parabola.

    That is gap + slope s + curvature s^2 / 2.

    Near the surface it is Newton's step, taken from the safe side; along a ray that
    grazes, it is the square root of the gap and not the gap that bounds it.

    Args:
        gap: Now, not negative.
        slope: Its derivative now.
        curvature: Lower bound of its second derivative ahead; the step is exact where
            the second derivative is this number.
    """
    square = slope * slope
    root = safe_sqrt(square - 2 * curvature * gap)
    passes = (square < 2 * curvature * gap) | ((slope >= 0) & (curvature >= 0))
    # Of the two forms of the root, the one that subtracts nothing.
    closes = slope < 0
    top = jnp.where(closes, 2 * gap, root + slope)
    below = jnp.where(closes, root - slope, -curvature)
    return jnp.where(passes, jnp.inf, top / jnp.where(passes, 1, below))
