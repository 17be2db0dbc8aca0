import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.oracle.extremes import extreme_rays
from experiments.oracle.sphere import answer, distance
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.sphere import Sphere
from tests.checks import AS_USERS_RUN, all_finite
from tests.groups import FULL


def depth(origin, direction, center, radius):
    return Sphere(center, radius).intersect(Ray(Vec3(*origin), Vec3(*direction))).t


@jax.jit(compiler_options=AS_USERS_RUN)
@jax.vmap
def cast(*fields):
    """Depth, normal, and the derivatives of depth in all that it depends on."""
    origin, direction, center, radius = fields
    ray, shape = Ray(Vec3(*origin), Vec3(*direction)), Sphere(center, radius)
    normal = shape.normal(ray, shape.intersect(ray)).stack()
    return depth(*fields), normal, jax.grad(depth, argnums=(0, 1, 2, 3))(*fields)


def cast_one(*fields, dtype):
    found = cast(*(jnp.asarray(field, dtype)[None] for field in fields))
    return jax.tree.map(lambda x: np.asarray(x[0]), found)


@pytest.mark.parametrize(
    ("origin", "direction", "t", "normal"),
    [
        pytest.param((0, 0, -5), (0, 0, 1), 3, (0, 0, -1), id="outside"),
        pytest.param((0, 0, -5), (0, 0, 2), 1.5, (0, 0, -1), id="long direction"),
        pytest.param((0, 0, 0), (0, 1, 0), 2, (0, -1, 0), id="from the center"),
        pytest.param((0, 0, 1), (0, 0, 1), 1, (0, 0, -1), id="inside"),
        pytest.param((0, 0, 5), (0, 0, 1), np.inf, (0, 0, 0), id="behind"),
        pytest.param((0, 2.1, -5), (0, 0, 1), np.inf, (0, 0, 0), id="beside"),
    ],
)
def test_hit_of_a_sphere_of_radius_2(origin, direction, t, normal, dtype):
    found, n, _ = cast_one(origin, direction, (0, 0, 0), 2, dtype=dtype)
    assert found == pytest.approx(t, rel=eps(dtype, 4))
    np.testing.assert_allclose(n, normal, atol=eps(dtype, 4))


def test_depth_keeps_its_promise_over_all_extremes(dtype):
    rays = extreme_rays(500, 8, dtype)
    names = ("origin", "direction", "center", "radius")
    fields = [np.asarray(getattr(rays, name)) for name in names]
    t, normal, slopes = jax.tree.map(np.asarray, cast(*map(jnp.asarray, fields)))
    assert not np.isnan(t).any()
    assert all_finite((normal, slopes))
    told = 0
    for k in range(len(t)):
        row = [field[k] for field in fields]
        exact = answer(*row)
        origin, direction, center, radius = row
        if np.isfinite(t[k]) != (exact.t is not None):
            # Only where rounding the inputs decides: the ray grazes, or starts there.
            reach = np.linalg.norm((origin - center).astype(float)) + radius
            grazes = abs(float(distance(origin, direction, center) - radius))
            starts = abs(
                float(np.linalg.norm((origin - center).astype(float))) - radius
            )
            assert min(grazes, starts) < eps(dtype, 8) * reach
            continue
        if exact.t is None or exact.derivative is None:
            continue
        values = [*center, radius, *origin, *direction]
        derivative = [float(x) for x in exact.derivative]
        condition = np.sum(np.abs(np.multiply(values, derivative))) / float(exact.t)
        # From the surface itself the ray enters at 0, or leaves far away.
        if eps(dtype) * condition > 0.1 or t[k] < 1e-3 * float(exact.t):
            continue
        told += 1
        assert abs(t[k] / float(exact.t) - 1) <= eps(dtype, 8) * condition
    assert told > 100


def test_image_of_a_sphere_is_its_closed_form(dtype):
    # Radius 5 at 15, seen along the optical axis: a disc of tan(asin(1 / 3)).
    camera = ij.PinholeCamera(100, 100, 63.5, 47.5, 128, 96)
    maps = ij.render(Sphere(jnp.asarray((0, 0, 15.0), dtype), 5.0), camera)
    v, u = np.mgrid[:96, :128]
    distance = np.hypot(u - 63.5, v - 47.5)
    expected = distance < 100 * 5 / np.sqrt(15**2 - 5**2)
    np.testing.assert_array_equal(np.asarray(maps.mask), expected)
    assert float(jnp.min(maps.depth)) == pytest.approx(10, rel=1e-3)


@FULL
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0, 1), 0.0), "radius must be positive, in meters, got 0.0"),
        (((0, 0, 1), [1.0, 2.0]), "must have one batch shape"),
        (((0, 0), 1.0), r"center must be meters of shape \(3,\)"),
        (((0, 0, np.nan), 1.0), "center must be finite meters"),
    ],
)
def test_bad_field_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Sphere(*arguments)
