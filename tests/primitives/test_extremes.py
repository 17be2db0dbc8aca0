"""The cylinder where its formulas are strained: over all the extremes together."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.cylinder import Cylinder
from tests.checks import all_finite
from tests.oracle.cylinder import answer
from tests.oracle.extremes import extreme_rays


def one(origin, direction, center, axis, radius, height):
    """The ray and the cylinder; the axis stays as it was rounded."""
    shape = eqx.tree_at(
        lambda c: (c.center, c.axis, c.radius, c.height),
        Cylinder((0, 0, 1), (0, 0, 1), 1, 1),
        (center, axis, radius, height),
    )
    return Ray(Vec3(*origin), Vec3(*direction)), shape


def depth(*fields):
    ray, shape = one(*fields)
    return shape.intersect(ray).t


@jax.jit
@jax.vmap
def cast(*fields):
    """Depth, cap, normal, and the derivatives of depth in all that it depends on."""
    ray, shape = one(*fields)
    hit = shape.intersect(ray)
    slope = jax.grad(depth, argnums=tuple(range(6)))(*fields)
    return hit.t, hit.on_cap, shape.normal(ray, hit).stack(), slope


def fields(rays):
    names = ("origin", "direction", "center", "axis", "radius", "height")
    return [jnp.asarray(getattr(rays, name)) for name in names]


def test_values_and_derivatives_are_numbers_on_every_ray(dtype):
    t, _, normal, slope = cast(*fields(extreme_rays(20000, 0, dtype)))
    t = np.asarray(t)
    assert not np.isnan(t).any()
    assert (t > 0).all()
    assert 0.5 < np.isfinite(t).mean() < 0.95
    assert all_finite(normal)
    assert all_finite(slope)


@pytest.mark.usefixtures("double")
def test_double_precision_agrees_with_the_oracle():
    # In all but the rays that the last digits of the inputs turn from a hit to a miss.
    rays = extreme_rays(1500, 1, "float64")
    t, on_cap, normal, slope = (
        np.asarray(x) if not isinstance(x, tuple) else x for x in cast(*fields(rays))
    )
    slope = np.concatenate(
        [np.asarray(slope[k]).reshape(len(t), -1) for k in (2, 3, 4, 5)], axis=1
    )
    apart, turned, slopes, decisions = [], [], [], []
    for k in range(len(t)):
        exact = answer(*(np.asarray(f)[k] for f in fields(rays)))
        same = (exact.t is None) == (not np.isfinite(t[k]))
        same &= exact.t is None or exact.on_cap == on_cap[k]
        decisions.append(same)
        if not same or exact.t is None or exact.derivative is None:
            continue
        apart.append(abs(float(t[k] / exact.t) - 1))
        turned.append(np.abs(normal[k] - np.array(exact.normal, float)).max())
        expected = np.array([float(x) for x in exact.derivative[:8]])
        # An axis that grows longer is no other cylinder: only what turns it counts.
        axis, found = rays.axis[k], slope[k].copy()
        found[3:6] -= found[3:6] @ axis * axis
        size = np.linalg.norm(expected)
        slopes.append(np.linalg.norm(found - expected) / size)
    assert np.mean(decisions) > 0.985
    assert np.percentile(apart, 95) < 1e-9
    assert np.percentile(turned, 95) < 1e-8
    assert np.percentile(slopes, 90) < 1e-8
