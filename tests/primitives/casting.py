"""Rays at shapes, each at one of its own, with all that follows from their depths."""

import jax
import jax.numpy as jnp
import numpy as np

from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from tests.checks import AS_USERS_RUN, all_finite, in_chunks


def caster(make):
    """Casts a ray at a shape, for each row of its fields; compiled as users' runs are.

    It finds depth, normal, the first derivatives of the depth in all fields, and
    products of the second ones.

    Args:
        make: Makes a shape of the fields behind the ray's origin and direction.
    """

    def one(origin, direction, *fields):
        return Ray(Vec3(*origin), Vec3(*direction)), make(*fields)

    def depth(*fields):
        ray, shape = one(*fields)
        return shape.intersect(ray).t

    @jax.jit(compiler_options=AS_USERS_RUN)
    @jax.vmap
    def cast(*fields):
        ray, shape = one(*fields)
        normal = shape.normal(ray, shape.intersect(ray)).stack()
        slope = jax.grad(depth, argnums=tuple(range(len(fields))))
        ones = jax.tree.map(jnp.ones_like, fields)
        return depth(*fields), normal, *jax.jvp(slope, fields, ones)

    return cast


def cast_one(cast, *fields, dtype):
    """The fields as they are rounded, and what is found."""
    fields = [np.asarray(field, dtype) for field in fields]
    found = in_chunks(cast, *(field[None] for field in fields))
    return fields, jax.tree.map(lambda x: x[0], found)


def count_told(cast, check, fields, dtype):
    """Of how many rays `check(fields, found, dtype)` says that a depth was promised."""
    found = in_chunks(cast, *fields)
    told = 0
    for k in range(len(fields[0])):
        row = [field[k] for field in fields]
        told += check(row, jax.tree.map(lambda x, k=k: x[k], found), dtype)
    return told


def assert_numbers(cast, fields, dtype, least, most):
    """Nothing is NaN, no derivative infinite, and so large a part of the rays hits."""
    t, *rest = in_chunks(cast, *(field.astype(dtype) for field in fields))
    assert not np.isnan(t).any()
    assert least < np.isfinite(t).mean() < most
    assert all_finite(rest)
