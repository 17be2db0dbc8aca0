"""The published ways to march over a heightfield, and to take its normal."""

__all__ = ["MARCHES", "March", "difference_normal", "march"]

import dataclasses
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from impostor_jax.geometry.rays import Hit, Interval, Ray, slab_interval
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.heightfield_march import side_of
from impostor_jax.primitives.surface import facing


@dataclasses.dataclass(frozen=True)
class March:
    """How a shader marches; distances are in meters along the ray.

    Attributes:
        factor: Step over gap.
        steps: Number of steps after which a ray is given up, as a miss.
        threshold: Gap below which the surface is reached; meters, or meters per meter
            of distance.
        proportional: Whether the threshold grows with the distance.
        secant: Whether the crossing is interpolated between the last two points.
        far: Distance at which a ray is given up.
    """

    factor: float = 0.2
    steps: int = 64
    threshold: float = 0.02
    proportional: bool = False
    secant: bool = False
    far: float = 100.0


MARCHES = {
    "fixed": March(),
    "proportional": March(threshold=0.001, proportional=True),
    "secant": March(threshold=0.001, proportional=True, secant=True),
}
"""The published settings, by name."""


@partial(jax.jit, static_argnames="settings")
def march(field: Heightfield, ray: Ray, settings: March) -> Numbers:
    """Ray parameter where a march stops at the surface, `+inf` where it does not.

    Args:
        field: Of a function, in the world frame.
        ray: The ray.
        settings: How to march.
    """
    (x, z), half = jnp.mean(field.extent, axis=-1), jnp.diff(field.extent)[:, 0] / 2
    center = Vec3(x, field.surface(x, z)[0], z)
    near, foot = ray.brought_near(center, center, jnp.sqrt(half @ half))
    span = Interval(lower=-foot, upper=jnp.full_like(foot, jnp.inf))
    for axis, width in ((0, half[0]), (2, half[1])):
        across = Vec3.from_array(jnp.eye(3, dtype=field.dtype)[axis])
        slab = slab_interval(near, across, width)
        span = Interval(
            lower=jnp.maximum(span.lower, slab.lower),
            upper=jnp.minimum(span.upper, slab.upper),
        )

    def gap(t: Numbers) -> Numbers:
        p = near.at(t)
        p = Vec3(
            jnp.clip(p.x, -half[0], half[0]), p.y, jnp.clip(p.z, -half[1], half[1])
        )
        p = p + center
        return p.y - field.surface(p.x, p.z)[0]

    active = span.lower <= span.upper
    t = jnp.where(active, span.lower, 0)
    now, slope = jax.jvp(gap, (t,), (jnp.ones_like(t),))
    side = side_of(now, slope, jnp.zeros_like(t))
    length = ray.direction.norm()

    def turn(state):
        count, t, step, last, active, found = state
        now = side * gap(t)
        distance = (foot + t) * length
        limit = settings.threshold * (distance if settings.proportional else 1.0)
        arrives = active & (now < limit)
        at = t
        if settings.secant:
            closed = last - now
            ratio = now / jnp.where(closed > 0, closed, 1)
            at = t + jnp.where(closed > 0, step * ratio, 0)
        found = jnp.where(arrives, jnp.clip(at, span.lower, span.upper), found)
        step = settings.factor * now / length
        ahead = t + step
        goes_on = (ahead <= span.upper) & ((foot + ahead) * length <= settings.far)
        active = active & ~arrives & goes_on
        return count + 1, jnp.where(active, ahead, t), step, now, active, found

    def is_open(state):
        return (state[0] < settings.steps) & jnp.any(state[4])

    none, never = jnp.zeros_like(t), jnp.full_like(t, jnp.inf)
    state = (jnp.int32(0), t, none, none, active, never)
    found = jax.lax.while_loop(is_open, turn, state)[-1]
    return jnp.where(jnp.isfinite(found), foot + found, jnp.inf)


def difference_normal(field: Heightfield, ray: Ray, hit: Hit, epsilon: Any) -> Vec3:
    """Normal by central differences, as shaders take it.

    Args:
        field: In the world frame.
        ray: That was cast.
        hit: What it hit.
        epsilon: Half the distance of the samples in meters, a number or one per ray.
            Published are 0.02, and 0.001 times the distance of the hit.
    """
    p = ray.at(jnp.where(hit.mask, hit.t, 0))
    e = jnp.where(hit.mask, jnp.asarray(epsilon, field.dtype), 1)
    by_x = (field.surface(p.x + e, p.z)[0] - field.surface(p.x - e, p.z)[0]) / (2 * e)
    by_z = (field.surface(p.x, p.z + e)[0] - field.surface(p.x, p.z - e)[0]) / (2 * e)
    n = Vec3(-by_x, jnp.ones_like(by_x), -by_z).normalize()
    return facing(n, ray.direction, hit.mask)
