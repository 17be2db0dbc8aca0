import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.oracle.extremes import extreme_rays
from experiments.oracle.plane import answer, hit_margin
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.plane import Plane
from tests.checks import in_chunks
from tests.primitives.casting import assert_numbers, cast_one, caster

WITHOUT_NORMAL = (0, 1, 2, 6, 7, 8, 9, 10, 11)

cast = caster(Plane)


def plane_rays(count, seed, dtype):
    """Rays and planes through the centers of cylinders; a tenth start on the plane."""
    rays = extreme_rays(count, seed, dtype)
    starts = np.arange(count)[:, None] % 10 == 0
    origin = np.where(starts, rays.center, rays.origin)
    return origin, rays.direction, rays.center, rays.axis


@pytest.mark.parametrize(
    ("origin", "direction", "t", "normal"),
    [
        pytest.param((7, 5, 3), (0, -1, 0), 5, (0, 1, 0), id="from above"),
        pytest.param((7, -5, 3), (0, 1, 0), 5, (0, -1, 0), id="from below"),
        pytest.param((0, 5, 0), (3, -2, 0), 2.5, (0, 1, 0), id="slanted, long"),
        pytest.param((0, 5, 0), (1, 0, 0), np.inf, (0, 0, 0), id="parallel"),
        pytest.param((0, 5, 0), (1, 1, 0), np.inf, (0, 0, 0), id="moving away"),
        pytest.param((0, 0, 0), (1, 1, 0), np.inf, (0, 0, 0), id="from it"),
        pytest.param((0, 0, 0), (1, 0, 0), np.inf, (0, 0, 0), id="in it"),
    ],
)
def test_hit_of_a_floor(origin, direction, t, normal, dtype):
    _, (found, n, _, _) = cast_one(
        cast, origin, direction, (1, 0, 2), (0, 3, 0), dtype=dtype
    )
    assert found == pytest.approx(t, rel=eps(dtype, 2))
    np.testing.assert_array_equal(n, normal)


def test_derivatives_of_a_slanted_hit(dtype):
    # t = (h - y) / d_y with h the height of the floor.
    _, (_, _, slopes, _) = cast_one(
        cast, (0, 5, 0), (3, -2, 0), (1, 0, 2), (0, 1, 0), dtype=dtype
    )
    in_origin, in_direction, in_point, in_normal = slopes
    np.testing.assert_allclose(in_point, (0, -0.5, 0), rtol=eps(dtype, 4))
    np.testing.assert_allclose(in_origin, (0, 0.5, 0), rtol=eps(dtype, 4))
    np.testing.assert_allclose(in_direction, (0, 1.25, 0), rtol=eps(dtype, 4))
    # The hit is at (7.5, 0, 0), the floor turns about (1, 0, 2).
    np.testing.assert_allclose(in_normal, (3.25, 0, -1), atol=eps(dtype, 8))


def test_depth_keeps_its_promise_over_all_extremes(dtype):
    fields = plane_rays(300, 9, dtype)
    t, normal, slopes, _ = in_chunks(cast, *fields)
    assert not np.isnan(t).any()
    told = 0
    for k in range(len(t)):
        row = [field[k] for field in fields]
        exact = answer(*row)
        if np.isfinite(t[k]) != (exact.t is not None):
            assert hit_margin(*row) < eps(dtype, 8)
            continue
        if exact.t is None:
            continue
        origin, direction, point, _ = row
        # Neither the length of the normal nor its rounding takes part.
        derivative = np.array([float(exact.derivative[i]) for i in WITHOUT_NORMAL])
        terms = np.multiply([*point, *origin, *direction], derivative)
        condition = np.sum(np.abs(terms)) / float(exact.t)
        if eps(dtype) * condition > 0.1:
            continue
        told += 1
        assert float(abs(float(t[k]) / exact.t - 1)) <= eps(dtype, 2) * condition
        facing = np.array(exact.normal, float)
        np.testing.assert_allclose(normal[k], facing, atol=eps(dtype, 8))
        found = np.concatenate([slopes[i][k] for i in (2, 0, 1)])
        np.testing.assert_allclose(found, derivative, rtol=eps(dtype, 8) * condition)
    assert told > 100


def test_derivatives_are_numbers_with_lengths_from_1e_minus_12_to_1e12(dtype):
    near = plane_rays(4000, 10, dtype)
    scale = np.exp(np.random.default_rng(11).uniform(*np.log([1e-12, 1e12]), 4000))
    origin, direction, point, normal = near
    offset = (origin - point).astype(float)
    reach = np.linalg.norm(offset, axis=1)
    offset *= (scale / np.where(reach > 0, reach, 1))[:, None]
    stretched = (np.zeros_like(offset), direction, -offset, normal)
    for fields in (near, stretched):
        assert_numbers(cast, fields, dtype, 0.2, 0.95)


def test_distance_is_positive_on_the_side_of_the_normal(dtype):
    plane = Plane(jnp.asarray((0, 2, 0), dtype), jnp.asarray((0, 1e-30, 0), dtype))
    point = Vec3(*(jnp.asarray(x, dtype) for x in ([5, 5], [5, -1], [5, 5])))
    np.testing.assert_array_equal(plane.implicit(point), [3, -3])


def test_image_of_a_floor_ends_at_the_horizon(dtype):
    camera = ij.PinholeCamera(100, 100, 31.5, 23.5, 64, 48)
    floor = Plane(jnp.asarray((0, 1.5, 0), dtype), (0, -1, 0))
    maps = ij.render(floor, camera)
    row = np.arange(48)[:, None] * np.ones(64)
    below = row > 23.5
    np.testing.assert_array_equal(np.asarray(maps.mask), below)
    expected = 1.5 * 100 / (row[below] - 23.5)
    np.testing.assert_allclose(maps.depth[below], expected, rtol=eps(dtype, 4))
    np.testing.assert_array_equal(maps.normal[below], [(0, -1, 0)] * below.sum())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0, 1), (0, 0, 0)), "normal must not be the zero vector"),
        (((0, 0, 1), [(0, 0, 1)] * 2), "must have one batch shape"),
        (((0, 0), (0, 0, 1)), r"point must be meters of shape \(3,\)"),
        (((0, 0, np.nan), (0, 0, 1)), "point must be finite meters"),
    ],
)
def test_bad_field_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Plane(*arguments)
