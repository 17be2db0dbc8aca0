import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.oracle.box import answer, face_margin, hit_margin
from experiments.oracle.extreme_boxes import BoxRays, extreme_boxes
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.box import Box
from tests.checks import all_finite
from tests.groups import FULL
from tests.primitives.casting import assert_numbers, cast_one, caster, count_told

FIELDS = tuple(field.name for field in dataclasses.fields(BoxRays))
# What the module of the box promises of a depth and of a decision, in eps.
DEPTH = 4
DECISION = 8

cast = caster(Box)


def check_against_oracle(row, found, dtype):
    """What is promised of one ray; whether a depth was promised."""
    t, normal, slopes, bends = found
    assert not np.isnan(t)
    assert all_finite((normal, slopes, bends))
    exact = answer(*row)
    if np.isfinite(t) != (exact.t is not None):
        assert hit_margin(*row) < eps(dtype, DECISION)
        return False
    if exact.t is None:
        assert not normal.any()
        return False
    # Depth grows with the size of a box from inside and shrinks from outside.
    enters = slopes[4].sum() < 0
    error = np.abs(normal - np.array(exact.normal, float)).max()
    if enters != exact.entering or error > 1e-2:
        assert face_margin(*row) < eps(dtype, DECISION)
        return False
    assert error <= eps(dtype, 8)
    origin, direction, center, _, size = row
    values = np.concatenate([center, np.zeros(9), size, origin, direction])
    derivative = np.array([float(x) for x in exact.derivative])
    condition = np.sum(np.abs(values * derivative)) / float(exact.t)
    if eps(dtype) * condition > 0.1:
        return False
    assert float(abs(float(t) / exact.t - 1)) <= eps(dtype, DEPTH) * condition
    known = np.abs(derivative)
    # The place of the hit relative to the center is rounded with what it is made from.
    place = np.abs(origin) + np.abs(center) + float(exact.t) * np.abs(direction)
    known[3:12] = (np.linalg.norm(derivative[:3]) * place[:, None] * np.ones(3)).ravel()
    origin, direction, center, rotation, size = slopes
    order = (center, rotation.ravel(), size, origin, direction)
    error = np.abs(np.concatenate(order) - derivative)
    if not (error <= eps(dtype, DECISION) * condition * known).all():
        # Of another face, or of a miss: derivatives are compiled apart from the value.
        assert min(hit_margin(*row), face_margin(*row)) < eps(dtype, DECISION)
    return True


def turned(angle):
    """Turn by an angle about a skew axis."""
    x, y, z = np.array((0.3, -0.2, 0.7)) / np.sqrt(0.62)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


SIZE = (2, 4, 6)


@FULL
@pytest.mark.parametrize(
    ("origin", "direction", "t", "normal"),
    [
        pytest.param((-5, 0, 0), (1, 0, 0), 4, (-1, 0, 0), id="x from below"),
        pytest.param((0, 5, 0), (0, -2, 0), 1.5, (0, 1, 0), id="y from above"),
        pytest.param((0.5, 0.5, -5), (0, 0, 1), 2, (0, 0, -1), id="z"),
        pytest.param((0, 0, 0), (0, 1, 0), 2, (0, -1, 0), id="from the center"),
        pytest.param((0.5, 1, 2), (1, 1, 1), 0.5, (-1, 0, 0), id="from inside"),
        pytest.param((-2, -2.5, 0), (1, 1, 0), 1, (-1, 0, 0), id="slanted"),
        pytest.param((-1, 0, 0), (1, 0, 0), 2, (-1, 0, 0), id="from a face, in"),
        pytest.param((-1, 0, 0), (-1, 0, 0), np.inf, (0, 0, 0), id="from a face, out"),
        pytest.param((5, 0, 0), (1, 0, 0), np.inf, (0, 0, 0), id="behind"),
        pytest.param((-5, 2.1, 0), (1, 0, 0), np.inf, (0, 0, 0), id="beside"),
        pytest.param((-5, 2.1, 0), (1, -1e-3, 0), np.inf, (0, 0, 0), id="past a face"),
        pytest.param((-5, 2, 0), (1, 0, 0), 4, (-1, 0, 0), id="in a face's plane"),
    ],
)
def test_hit_of_a_box_along_the_axes(origin, direction, t, normal, dtype):
    _, (found, n, _, _) = cast_one(
        cast, origin, direction, (0, 0, 0), np.eye(3), SIZE, dtype=dtype
    )
    assert found == pytest.approx(t, rel=eps(dtype, 4))
    np.testing.assert_array_equal(n, normal)


@FULL
def test_derivatives_of_a_slanted_hit(dtype):
    # It meets (-1, -1.5, 0), where t = (c_x - s_x / 2 - o_x) / d_x.
    _, (_, _, slopes, _) = cast_one(
        cast, (-2, -2.5, 0), (1, 1, 0), (0, 0, 0), np.eye(3), SIZE, dtype=dtype
    )
    in_origin, in_direction, in_center, in_rotation, in_size = slopes
    np.testing.assert_array_equal(in_center, (1, 0, 0))
    np.testing.assert_array_equal(in_size, (-0.5, 0, 0))
    np.testing.assert_array_equal(in_origin, (-1, 0, 0))
    np.testing.assert_array_equal(in_direction, (-1, 0, 0))
    # a.(p - c) = -s_x / 2 with a the first column: da moves t by -da.(p - c).
    np.testing.assert_array_equal(in_rotation, [(1, 0, 0), (1.5, 0, 0), (0, 0, 0)])


@FULL
def test_depth_keeps_its_promise_over_all_extremes(dtype):
    rays = extreme_boxes(400, 8, dtype)
    fields = [getattr(rays, name) for name in FIELDS]
    assert count_told(cast, check_against_oracle, fields, dtype) > 200


@FULL
def test_derivatives_are_numbers_with_lengths_from_1e_minus_12_to_1e12(dtype):
    rays, rng = extreme_boxes(4000, 9, dtype), np.random.default_rng(10)
    near = [getattr(rays, name) for name in FIELDS]
    sizes = np.exp(rng.uniform(*np.log([1e-12, 1e12]), (4000, 4)))
    offset = (rays.origin - rays.center).astype(float)
    reach = np.linalg.norm(offset, axis=1)
    offset *= (sizes[:, 3] / np.where(reach > 0, reach, 1))[:, None]
    zero = np.zeros_like(offset)
    stretched = (zero, rays.direction, -offset, rays.rotation, sizes[:, :3])
    for fields in (near, stretched):
        assert_numbers(cast, fields, dtype, 0.1, 0.95)


# Origin, direction, center, size.
PLACES = {
    "almost touching": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, 1 + 1e-6], [2, 2, 2]),
    "a million sizes away": ([0, 0, 0], [0, 0.1, 1], [0, 1e5, 1e6], [1, 2, 3]),
    "on a face, looking in": ([0, 0, 0], [0.2, 0.3, 1], [0, 0, 1], [2, 2, 2]),
    "on a face, looking out": ([0, 0, 0], [0.2, 0.3, -1], [0, 0, 1], [2, 2, 2]),
    "on a face, looking along": ([0, 0, 0], [0.2, 0.3, 0], [0, 0, 1], [2, 2, 2]),
    "on an edge": ([0, 0, 0], [0.2, 0.3, 1], [0, 1, 1], [2, 2, 2]),
    "on a corner": ([0, 0, 0], [-0.2, 0.3, 1], [1, 1, 1], [2, 2, 2]),
    "in a tunnel": ([0, 0, 0], [0.3, 0.2, 50], [0.1, 0.2, 400], [2, 3, 1000]),
    "behind": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, -3], [2, 2, 2]),
    "a sheet": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, 3], [2, 1, 1e-4]),
    "a sheet, edge on": ([0, 0, 0], [0.05, 1e-6, 1], [0, 0, 3], [2, 1e-4, 1]),
    "a sheet, a kilometer away": (
        [0, 0, 0],
        [0.05, 0.1, 1],
        [50, 100, 1e3],
        [1, 1, 1e-4],
    ),
    "in a sheet": ([0, 0, 0], [0.3, 0.2, 1], [1e2, 2e2, 0], [1e3, 1e3, 1e-4]),
    "along a table": ([0, 0, 0], [0.1, 1e-7, 1], [0, 0.5, 5], [4, 1, 8]),
    "a pole": ([0, 0, 0], [0.3, -0.5, 1], [0.2, -1000, 2], [1, 2000, 1]),
    "through an edge": ([0, 0, 0], [1, 0, 3], [0, 0, 4], [2, 2, 2]),
    "through a corner": ([0, 0, 0], [1, 1, 3], [0, 0, 4], [2, 2, 2]),
    "through two corners": ([0, 0, 0], [1, 1, 1], [3, 3, 3], [2, 2, 2]),
    "along an edge": ([0, 0, 0], [0, 0, 1], [1, 1, 4], [2, 2, 2]),
    "in micrometers": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, 3e-6], [1e-6, 2e-6, 2e-6]),
    "in megameters": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, 3e6], [1e6, 2e6, 2e6]),
}


@pytest.mark.parametrize("place", PLACES)
def test_place_is_answered_as_the_oracle_does(place, dtype):
    origin, direction, center, size = PLACES[place]
    for tilt in (0.0, 1e-7, 1e-3, 0.5):
        fields = (origin, direction, center, turned(tilt), size)
        row, found = cast_one(cast, *fields, dtype=dtype)
        check_against_oracle(row, found, dtype)


def test_derivative_of_a_turn_is_that_of_the_nine_numbers(dtype):
    fields = ((0, 0, 0), (0.1, 0.05, 1), (0.1, 0.2, 3), turned(0.5), (1, 0.8, 0.6))
    row, (_, _, slopes, _) = cast_one(cast, *fields, dtype=dtype)
    step = 1e-4

    def moved(sign):
        # About the box's own first edge.
        turn = np.eye(3)
        turn[1:, 1:] = [
            [np.cos(step), -sign * np.sin(step)],
            [sign * np.sin(step), np.cos(step)],
        ]
        return float(answer(*row[:3], turned(0.5) @ turn, row[4]).t)

    along = turned(0.5) @ [[0, 0, 0], [0, 0, -1], [0, 1, 0]]
    numeric = (moved(1) - moved(-1)) / (2 * step)
    assert np.sum(slopes[3] * along) == pytest.approx(numeric, rel=1e-5)


def test_distance_of_a_point(dtype):
    box = Box(jnp.asarray((1, 0, 0), dtype), np.eye(3)[[1, 2, 0]], SIZE)
    # The first edge is along z, the second along x, the third along y.
    points = [
        ((1, 0, 0), -1),
        ((1, 0, 0.75), -0.25),
        ((1, 2.5, 0.5), -0.5),
        ((1, 0, 4), 3),
        ((6, 0, 5), 5),
        ((1 + 2 + 1, 3 + 2, 1 + 2), 3),
        ((3, 3, 1), 0),
    ]
    place, distance = zip(*points, strict=True)
    found = box.implicit(Vec3.from_array(jnp.asarray(place, dtype)))
    np.testing.assert_allclose(found, distance, atol=eps(dtype, 8))


def test_image_of_a_box_is_its_closed_form(dtype):
    # The near face at 2, 1 wide and 0.6 high, fills what is behind it.
    camera = ij.PinholeCamera(100, 100, 63.5, 47.5, 128, 96)
    maps = ij.render(Box(jnp.asarray((0, 0, 3), dtype), np.eye(3), (1, 0.6, 2)), camera)
    v, u = np.mgrid[:96, :128]
    expected = (np.abs(u - 63.5) < 25) & (np.abs(v - 47.5) < 15)
    np.testing.assert_array_equal(np.asarray(maps.mask), expected)
    np.testing.assert_allclose(maps.depth[expected], 2, rtol=eps(dtype, 4))
    np.testing.assert_array_equal(maps.normal[expected], [(0, 0, -1)] * expected.sum())


@pytest.mark.parametrize("value", [0.0, -0.5, np.nan])
def test_size_that_tracing_lets_in_is_an_empty_image(value):
    fields = ((0, 0, 0), (0.1, 0.05, 1), (0, 0, 3), np.eye(3), (1, value, 1))
    _, (t, n, slopes, bends) = cast_one(cast, *fields, dtype="float32")
    assert np.isinf(t)
    assert not n.any()
    assert all_finite((slopes, bends))


ZERO, EYE = (0, 0, 0), np.eye(3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((ZERO, EYE, (1, 0, 1)), "size must be positive, in meters"),
        ((ZERO, EYE, 1.0), r"size must be meters of shape \(3,\)"),
        ((ZERO, 2 * EYE, (1, 1, 1)), "rotation must be orthogonal with determinant 1"),
        ((ZERO, -EYE, (1, 1, 1)), "rotation must be orthogonal with determinant 1"),
        ((ZERO, [EYE, EYE * 2], (1, 1, 1)), "must have one batch shape"),
        (([ZERO] * 2, [EYE, 2 * EYE], [(1, 1, 1)] * 2), "rotation must be orthogonal"),
        ((ZERO, (1, 0, 0, 0), (1, 1, 1)), "rotation must be numbers of shape"),
        (((0, 0, np.nan), EYE, (1, 1, 1)), "center must be finite meters"),
    ],
)
def test_bad_field_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Box(*arguments)
