"""Errors of the cylinder in single precision, in the units of what it promises."""

__all__ = [
    "AS_USERS_RUN",
    "DECISION",
    "Errors",
    "cast_all",
    "depth",
    "errors_of",
    "one",
    "slope",
]

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from experiments.oracle.condition import FIELDS, reference
from experiments.oracle.extremes import Rays
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.cylinder import Cylinder

AS_USERS_RUN: dict[str, bool | int] = {"xla_backend_optimization_level": 3}
"""Options for `jax.jit` that undo the flags of the tests' `conftest.py`: for what is
promised of rounding errors, which are those of users."""
if jax.__version_info__ < (0, 11, 1):
    # Since then there is but one.
    AS_USERS_RUN["xla_cpu_use_fusion_emitters"] = True

DECISION = 8
"""Relative change of the inputs, in eps, within which a decision may be wrong."""

KNOWN = 0.1
"""Relative error that the inputs' rounding may make; beyond it no digit is claimed."""


@dataclasses.dataclass(frozen=True)
class Errors:
    """What was found of a set of rays; each array over the rays that it concerns.

    Attributes:
        not_finite: Whether a value or first derivative is NaN or infinite, but for t.
        wrong_hit: Where hit and miss are confused: the margin, in eps.
        wrong_surface: Where cap and wall are confused: the margin, in eps.
        depth: Relative error over eps and the condition number.
        depth_ulps: Relative error over eps.
        gradient: Error in norm over the norm, eps and the gradient's condition number.
        gradient_relative: Error in norm over the norm and eps.
    """

    not_finite: Bool[np.ndarray, " a"]
    wrong_hit: Float[np.ndarray, " b"]
    wrong_surface: Float[np.ndarray, " c"]
    depth: Float[np.ndarray, " d"]
    depth_ulps: Float[np.ndarray, " d"]
    gradient: Float[np.ndarray, " e"]
    gradient_relative: Float[np.ndarray, " e"]


def one(origin, direction, center, axis, radius, height):
    """The ray and the cylinder; the axis stays as it was rounded."""
    shape = eqx.tree_at(
        lambda c: (c.center, c.axis, c.radius, c.height),
        Cylinder((0, 0, 1), (0, 0, 1), 1, 1),
        (center, axis, radius, height),
    )
    return Ray(Vec3(*origin), Vec3(*direction)), shape


def depth(*fields):
    """Ray parameter of the first hit."""
    ray, shape = one(*fields)
    return shape.intersect(ray).t


def slope(*fields):
    """Its derivative in all fields."""
    return jax.grad(depth, argnums=tuple(range(6)))(*fields)


@jax.jit(compiler_options=AS_USERS_RUN)
@jax.vmap
def cast_all(*fields):
    """Depth, cap, normal, and the derivatives of depth in all that it depends on."""
    ray, shape = one(*fields)
    hit = shape.intersect(ray)
    return hit.t, hit.on_cap, shape.normal(ray, hit).stack(), slope(*fields)


def errors_of(rays: Rays) -> Errors:
    """Cast the rays in single precision and compare them with the reference."""
    ulp = eps("float32")
    fields = (jnp.asarray(getattr(rays, name), jnp.float32) for name in FIELDS)
    t, on_cap, normal, slopes = jax.tree.map(np.asarray, cast_all(*fields))
    exact = reference(rays)
    finite = np.isfinite(np.hstack([normal, *(s.reshape(len(t), -1) for s in slopes)]))
    hit, true = np.isfinite(t), np.isfinite(exact.t)
    both = hit & true
    confused = both & (on_cap != exact.on_cap)
    both &= exact.surface_margin > DECISION * ulp

    told = both & (exact.condition * ulp < KNOWN)
    relative = np.abs(t[told] / exact.t[told] - 1) / ulp

    known = both & (exact.gradient_condition * ulp < KNOWN)
    _, _, center, axis, radius, height = (s[known].astype(float) for s in slopes)
    unit = rays.axis[known] / np.linalg.norm(rays.axis[known], axis=1, keepdims=True)
    axis = axis - np.sum(axis * unit, axis=1, keepdims=True) * unit
    axis /= exact.t[known, None]
    found = np.hstack([center, axis, radius[:, None], height[:, None]])
    expected = exact.gradient[known]
    turned = np.linalg.norm(found - expected, axis=1) / ulp
    turned /= np.linalg.norm(expected, axis=1)
    return Errors(
        not_finite=np.isnan(t) | ~finite.all(axis=1),
        wrong_hit=exact.hit_margin[hit != true] / ulp,
        wrong_surface=exact.surface_margin[confused] / ulp,
        depth=relative / exact.condition[told],
        depth_ulps=relative,
        gradient=turned / exact.gradient_condition[known],
        gradient_relative=turned,
    )
