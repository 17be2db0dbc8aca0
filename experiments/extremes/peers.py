"""Other formulas for the same ray and cylinder, in single precision."""

__all__ = ["FORMULAS"]

import importlib.util
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.oracle.claims import depth
from experiments.oracle.condition import FIELDS
from experiments.oracle.extremes import Rays

Depths = Float[np.ndarray, " n"]


def _textbook(origin, direction, center, axis, radius, height) -> Float[Array, ""]:
    """Roots of b^2 - ac in the wall, the planes of the caps, the nearest that fits.

    As most engines write it, MuJoCo's JAX port included: the root is taken first and
    masked afterwards.
    """
    w = origin - center
    w_a, d_a = w @ axis, direction @ axis
    across, along = w - w_a * axis, direction - d_a * axis
    a, b, c = along @ along, along @ across, across @ across - radius**2
    discriminant = b * b - a * c
    root = jnp.sqrt(discriminant)
    found = []
    for t in ((-b - root) / a, (-b + root) / a):
        fits = (discriminant >= 0) & (jnp.abs(w_a + t * d_a) <= height / 2)
        found.append(jnp.where(fits, t, jnp.inf))
    for plane in (-height / 2, height / 2):
        t = (plane - w_a) / d_a
        aside = across + t * along
        found.append(jnp.where(aside @ aside <= radius**2, t, jnp.inf))
    times = jnp.stack(found)
    return jnp.min(jnp.where(times > 0, times, jnp.inf))


def _published(origin, direction, center, axis, radius, height) -> Float[Array, ""]:
    """As the published shader computes it, in the frame where the axis is y."""
    flat = jnp.abs(axis[0]) < 0.5
    aside = jnp.where(flat, jnp.array([1.0, 0, 0]), jnp.array([0, 0, 1.0]))
    u = jnp.cross(axis, aside.astype(axis.dtype))
    u = u / jnp.linalg.norm(u)
    turn = jnp.stack([u, axis, jnp.cross(u, axis)])
    c, e = turn @ (center - origin), turn @ direction
    across = jnp.array([0, 2])
    first, second = (c[1] - height / 2) / e[1], (c[1] + height / 2) / e[1]
    cap = jnp.minimum(first, second)
    off = cap * e[across] - c[across]
    cap_fits = (first > 0) & (second > 0) & (off @ off <= radius**2)
    ec, cc = e[across], c[across]
    a, b, rest = ec @ ec, -2 * (ec @ cc), cc @ cc - radius**2
    discriminant = b * b - 4 * a * rest
    side = (-b - jnp.sqrt(jnp.maximum(discriminant, 0))) / (2 * a)
    side_fits = (discriminant >= 0) & (jnp.abs(side * e[1] - c[1]) < height / 2)
    side = jnp.where(side_fits, side, -1.0)
    on_cap = cap_fits & ((side <= 0) | (cap < side))
    t = jnp.where(on_cap, cap, side)
    return jnp.where(t > 0, t, jnp.inf)


def _mapped(function) -> Any:
    """The function over all rays, and its derivative in the radius."""
    both = jax.jit(jax.vmap(jax.value_and_grad(function, argnums=4)))

    def cast(rays: Rays) -> tuple[Depths, Depths]:
        fields = (jnp.asarray(getattr(rays, name), jnp.float32) for name in FIELDS)
        t, slope = both(*fields)
        return np.asarray(t, float), np.asarray(slope, float)

    return cast


def _mitsuba(rays: Rays) -> tuple[Depths, Depths]:
    """Mitsuba's cylinder, which has no caps and is not differentiated here."""
    mi = importlib.import_module("mitsuba")
    mi.set_variant("scalar_rgb")
    # Of rounded matrices that it takes for sheared ones.
    mi.set_log_level(mi.LogLevel.Error)
    found = np.full(len(rays.radius), np.inf)
    for k in range(len(rays.radius)):
        half = rays.axis[k] * (rays.height[k] / 2)
        length = np.linalg.norm(rays.direction[k])
        shape = mi.load_dict(
            {
                "type": "cylinder",
                "p0": (rays.center[k] - half).astype(float).tolist(),
                "p1": (rays.center[k] + half).astype(float).tolist(),
                "radius": float(rays.radius[k]),
            }
        )
        ray = mi.Ray3f(rays.origin[k].tolist(), (rays.direction[k] / length).tolist())
        t = mi.load_dict({"type": "scene", "shape": shape}).ray_intersect(ray).t
        found[k] = float(t) / float(length)
    return found, np.full(len(found), np.nan)


FORMULAS = {
    "textbook": _mapped(_textbook),
    "published": _mapped(_published),
    "ours": _mapped(depth),
}
"""Depth (inf on a miss) and its derivative in the radius, by name."""

# Of the extra `bench`.
if importlib.util.find_spec("mitsuba") is not None:
    FORMULAS["mitsuba"] = _mitsuba
