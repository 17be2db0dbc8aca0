import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.oracle.extreme_triangles import TriangleRays, extreme_triangles
from experiments.oracle.triangle import ahead_margin, beside_margin, crossing
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.triangle import Triangle, is_thin
from tests.checks import all_finite
from tests.groups import FULL
from tests.primitives.casting import assert_numbers, cast_one, caster, count_told

FIELDS = tuple(field.name for field in dataclasses.fields(TriangleRays))
# What the module of the triangle promises of a depth and of a decision, in eps.
DEPTH = 8
DECISION = 16

cast = caster(Triangle)


def check_against_oracle(row, found, dtype):
    """What is promised of one ray; whether a depth was promised."""
    t, normal, slopes, bends = found
    assert not np.isnan(t)
    assert all_finite((normal, slopes, bends))
    exact = crossing(*row)
    is_hit = exact is not None and exact.is_within and exact.t > 0
    if is_hit and np.isinf(t):
        # No ray that meets the triangle misses it, unless it starts in its plane.
        assert ahead_margin(*row) < eps(dtype, DEPTH) / exact.sine
    if not is_hit and np.isfinite(t):
        assert beside_margin(*row) < eps(dtype, DECISION)
        is_ahead = exact is not None and exact.t > 0
        assert is_ahead or ahead_margin(*row) < eps(dtype, DECISION)
    if np.isinf(t):
        assert not normal.any()
        return False
    if not is_hit:
        return False
    condition = float(exact.condition / exact.sine)
    if eps(dtype) * condition > 0.1:
        return False
    assert abs(float(t / exact.t - 1)) <= eps(dtype, DEPTH) * condition
    turned = np.abs(normal - np.array(exact.normal, float)).max()
    assert turned <= eps(dtype, DEPTH) / float(exact.sine)
    # The parts of the corners are known as well as the hit, in heights.
    origin, direction, vertices = slopes
    moved = np.concatenate([vertices.ravel(), origin, direction])
    derivative = np.array([float(x) for x in exact.derivative])
    apart = np.linalg.norm(moved - derivative) / np.linalg.norm(derivative)
    distance = float(exact.t) * np.linalg.norm(row[1].astype(float))
    known_to = eps(dtype, DEPTH) * condition * (1 + distance / height_of(row[2]))
    assert apart <= known_to
    return known_to < 1


def height_of(vertices):
    """Across the longest edge."""
    a, b, c = np.asarray(vertices, float)
    longest = max(np.linalg.norm(edge) for edge in (b - a, c - b, a - c))
    return np.linalg.norm(np.cross(b - a, c - a)) / longest


RIGHT = ((0, 0, 4), (4, 0, 4), (0, 2, 4))


@FULL
@pytest.mark.parametrize(
    ("origin", "direction", "t", "normal"),
    [
        pytest.param((1, 0.5, 0), (0, 0, 1), 4, (0, 0, -1), id="from one side"),
        pytest.param((1, 0.5, 9), (0, 0, -2), 2.5, (0, 0, 1), id="from the other"),
        pytest.param((0, 0, 0), (1, 0.5, 4), 1, (0, 0, -1), id="slanted"),
        pytest.param((2, 1, 0), (0, 0, 1), 4, (0, 0, -1), id="on an edge"),
        pytest.param((0, 0, 0), (0, 0, 1), 4, (0, 0, -1), id="at a corner"),
        pytest.param((2, 1.001, 0), (0, 0, 1), np.inf, (0, 0, 0), id="past an edge"),
        pytest.param((-1e-3, 1, 0), (0, 0, 1), np.inf, (0, 0, 0), id="past another"),
        pytest.param((4.001, 0, 0), (0, 0, 1), np.inf, (0, 0, 0), id="past a corner"),
        pytest.param((1, 0.5, 5), (0, 0, 1), np.inf, (0, 0, 0), id="behind"),
        pytest.param((1, 0.5, 4), (0, 0, 1), np.inf, (0, 0, 0), id="from it"),
        pytest.param((0, 0, 4), (1, 2, 3), np.inf, (0, 0, 0), id="from a corner"),
        pytest.param((1, 0.5, 3), (1, 1, 0), np.inf, (0, 0, 0), id="parallel"),
    ],
)
def test_hit_of_a_right_triangle(origin, direction, t, normal, dtype):
    _, (found, n, _, _) = cast_one(cast, origin, direction, RIGHT, dtype=dtype)
    assert found == pytest.approx(t, rel=eps(dtype, 4))
    np.testing.assert_allclose(n, normal, atol=eps(dtype, 2))


@FULL
def test_ray_along_the_sheet_is_as_deep_as_a_point_of_it_or_misses(dtype):
    # Its corners are passed at 2.87, 3.25 and 6.71.
    for start in (0.1, 0.2, 0.3):
        _, found = cast_one(cast, (-3, start, 4), (1, 0.2, 0), RIGHT, dtype=dtype)
        assert np.isinf(found[0]) or 2.8 <= found[0] <= 6.8
        assert all_finite(found[1:])


@FULL
def test_derivative_is_shared_by_the_parts_of_the_corners(dtype):
    # The hit is at (1, 0.5, 4), half a corner and a quarter of the two others.
    _, (_, _, slopes, _) = cast_one(cast, (0, 0, 0), (1, 0.5, 4), RIGHT, dtype=dtype)
    in_origin, in_direction, in_vertices = slopes
    expected = np.zeros((3, 3))
    expected[:, 2] = np.array((0.5, 0.25, 0.25)) / 4
    np.testing.assert_allclose(in_vertices, expected, atol=eps(dtype, 4))
    np.testing.assert_allclose(in_origin, (0, 0, -0.25), atol=eps(dtype, 4))
    np.testing.assert_allclose(in_direction, (0, 0, -0.25), atol=eps(dtype, 4))


@FULL
def test_depth_keeps_its_promise_over_all_extremes(dtype):
    rays = extreme_triangles(600, 8, dtype)
    kept = ~is_thin(rays.vertices, dtype)
    fields = [getattr(rays, name)[kept] for name in FIELDS]
    assert count_told(cast, check_against_oracle, fields, dtype) > 100


@FULL
def test_derivatives_are_numbers_with_lengths_from_1e_minus_12_to_1e12(dtype):
    rays, rng = extreme_triangles(4000, 9, dtype), np.random.default_rng(10)
    near = [getattr(rays, name) for name in FIELDS]
    sizes, distances = np.exp(rng.uniform(*np.log([1e-12, 1e12]), (2, 4000, 1)))
    # About a point of the triangle, which the ray is aimed at.
    parts = rng.dirichlet((1, 1, 1), 4000)
    middle = np.einsum("nk,nki->ni", parts, rays.vertices.astype(float))
    shape = rays.vertices - middle[:, None]
    shape *= (sizes / np.abs(shape).max(axis=(1, 2))[:, None])[:, None]
    shape += (rays.direction * distances)[:, None]
    stretched = (np.zeros_like(middle), rays.direction, shape)
    for fields in (near, stretched):
        assert_numbers(cast, fields, dtype, 0.3, 1)


# Origin, direction, vertices.
PLACES = {
    "almost in the plane": ([1, 0.5, 4 - 1e-6], [0.1, 0.2, 1], RIGHT),
    "nearly edge on": ([-9, 0.5, 4 - 1e-3], [1, 0, 1e-4], RIGHT),
    "along an edge": ([-9, 0, 4], [1, 0, 0], RIGHT),
    "a mile away": ([1000, 500, -1e6], [-0.001, -0.0005, 1], RIGHT),
    "a needle": ([0, 0, 0], [0, 0, 1], ((-1e-4, 0, 3), (1e-4, 0, 3), (0, 100, 3))),
    "all but a line": ([0, 0, 0], [0.1, 0, 3], ((-1, 0, 3), (1, 0, 3), (0, 1e-4, 3))),
    "a floor": ([0, 0, 0], [0.1, 0.01, 1], ((-1e3, 1, -1e3), (1e3, 1, 0), (0, 1, 1e3))),
    "in micrometers": ([0, 0, 0], [1e-6, 1e-6, 4e-6], np.multiply(RIGHT, 1e-6)),
    "in megameters": ([0, 0, 0], [1e6, 1e5, 4e6], np.multiply(RIGHT, 1e6)),
}


@pytest.mark.parametrize("place", PLACES)
def test_place_is_answered_as_the_oracle_does(place, dtype):
    row, found = cast_one(cast, *PLACES[place], dtype=dtype)
    check_against_oracle(row, found, dtype)


def test_distance_of_a_point(dtype):
    triangle = Triangle(jnp.asarray(RIGHT, dtype))
    # The normal points along z.
    points = [
        ((1, 0.5, 5), 1),
        ((1, 0.5, 3.5), -0.5),
        ((1, 0.5, 4), 0),
        ((0, 0, 2), -2),
        ((1, -3, 8), 5),
        ((-3, 1, 0), -5),
        ((4 + 3, 0, 4 + 4), 5),
        ((-2, -1, 4 - 2), -3),
        ((2 + 1, 1 + 2, 4), 5**0.5),
    ]
    place, distance = zip(*points, strict=True)
    found = triangle.implicit(Vec3.from_array(jnp.asarray(place, dtype)))
    np.testing.assert_allclose(found, distance, atol=eps(dtype, 8))


@pytest.mark.parametrize(
    "vertices",
    [
        pytest.param(((0, 0, 4), (0, 0, 4), (0, 2, 4)), id="two corners in one"),
        pytest.param(((0, 0, 4),) * 3, id="a point"),
    ],
)
def test_vertices_that_tracing_lets_in_are_an_empty_image(vertices):
    _, (t, n, slopes, bends) = cast_one(
        cast, (0, 0, 0), (0, 0.25, 1), vertices, dtype="float32"
    )
    assert np.isinf(t)
    assert not n.any()
    assert all_finite((slopes, bends))


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        ([(0, 0, 0), (1, 1, 1), (3, 3, 3)], "vertices must not lie on a line"),
        ([(0, 0, 0), (0, 0, 0), (3, 2, 3)], "vertices must not lie on a line"),
        ([RIGHT, [(0, 0, 0), (1, 0, 0), (2, 1e-8, 0)]], "among 2"),
        ([(0, 0), (1, 0), (0, 1)], r"vertices must be meters of shape \(3, 3\)"),
        ([(0, 0, 0), (1, 0, 0), (0, np.nan, 0)], "vertices must be finite meters"),
        ([(0, 0, 0), (1, 0, 0), (0, 1e30, 0)], "must be meters of at most"),
    ],
)
def test_bad_vertices_are_refused(vertices, message):
    with pytest.raises(ValueError, match=message):
        Triangle(vertices)
