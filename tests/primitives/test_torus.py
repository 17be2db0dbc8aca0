import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.oracle.torus import TorusRays, answer, extreme_tori
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.torus import Torus
from tests.checks import all_finite
from tests.groups import FULL, RELEASE
from tests.primitives.casting import assert_numbers, cast_one, caster, count_told

FIELDS = tuple(field.name for field in dataclasses.fields(TorusRays))
# What the module of the torus promises of a depth and of a decision, in eps.
DEPTH = 8
DECISION = 8


@caster
def cast(*fields):
    """The axis stays as it was rounded."""
    return eqx.tree_at(
        lambda s: (s.center, s.axis, s.major_radius, s.minor_radius),
        Torus((0, 0, 1), (0, 0, 1), 1, 0.5),
        fields,
    )


def check_against_oracle(row, found, dtype):
    """What is promised of one ray; whether a depth was promised."""
    t, normal, slopes, bends = found
    assert not np.isnan(t)
    assert all_finite((normal, slopes, bends))
    exact = answer(*row)
    is_sure = exact.margin > eps(dtype, DECISION)
    if np.isfinite(t) != (exact.t is not None):
        assert not is_sure
        return False
    if exact.derivative is None:
        assert normal.any() == (exact.t is not None)
        return False
    values = np.concatenate([np.ravel(x) for x in row]).astype(float)
    derivative = np.array([float(x) for x in exact.derivative])
    condition = np.sum(np.abs(values * derivative)) / float(exact.t)
    if eps(dtype) * condition > 0.1 or not is_sure:
        return False
    assert float(abs(float(t) / exact.t - 1)) <= eps(dtype, DEPTH) * condition
    # The normal turns by the error of the place over the radius of curvature, which on
    # the inner side is that of the hole, and all derivatives with it, over the slant.
    direction, major, minor = (row[k].astype(float) for k in (1, 4, 5))
    exact_normal = np.array([float(x) for x in exact.normal])
    slant = -direction @ exact_normal / np.linalg.norm(direction)
    place = np.linalg.norm(row[0]) + np.linalg.norm(row[2])
    place += float(exact.t) * np.linalg.norm(direction)
    turn = eps(dtype, 8) * (condition * place / min(minor, major - minor) + 1)
    assert np.linalg.norm(normal - exact_normal) <= turn
    slopes = np.concatenate([np.ravel(x) for x in slopes]).astype(float)
    error = np.linalg.norm((slopes - derivative) * values)
    assert error <= turn / slant * np.linalg.norm(np.abs(derivative * values))
    return True


@FULL
@pytest.mark.parametrize("count", [100, pytest.param(400, marks=RELEASE)])
def test_depth_keeps_its_promise_over_all_extremes(count, dtype):
    rays = extreme_tori(count, 8, dtype)
    fields = [getattr(rays, name) for name in FIELDS]
    assert count_told(cast, check_against_oracle, fields, dtype) > 0.375 * count


@FULL
def test_derivatives_are_numbers_with_lengths_from_1e_minus_12_to_1e12(dtype):
    rays, rng = extreme_tori(4000, 9, dtype), np.random.default_rng(10)
    near = [getattr(rays, name) for name in FIELDS]
    distance, major = np.exp(rng.uniform(*np.log([1e-12, 1e12]), (2, 4000)))
    offset = (rays.origin - rays.center).astype(float)
    offset *= (distance / np.linalg.norm(offset, axis=1))[:, None]
    minor = major * rng.uniform(0, 1, 4000)
    stretched = (0 * offset, rays.direction, -offset, rays.axis, major, minor)
    for fields in (near, stretched):
        assert_numbers(cast, fields, dtype, 0.1, 0.95)


S = 0.5**0.5


@pytest.mark.parametrize(
    ("origin", "direction", "t", "normal"),
    [
        pytest.param((-5, 0, 0), (1, 0, 0), 1, (-1, 0, 0), id="from beside"),
        pytest.param((-5, 0, 0), (2, 0, 0), 0.5, (-1, 0, 0), id="long direction"),
        pytest.param((3, 0, 5), (0, 0, -1), 4, (0, 0, 1), id="from above"),
        pytest.param((0, 0, 0), (0, 1, 0), 2, (0, -1, 0), id="from the hole"),
        pytest.param((0, 3, 0), (0, 1, 0), 1, (0, -1, 0), id="inside, outward"),
        pytest.param((0, 3, 0), (0, -1, 0), 1, (0, 1, 0), id="inside, inward"),
        pytest.param((0, 3, 0), (0, 0, 1), 1, (0, 0, -1), id="inside, upward"),
        pytest.param((0, 0, -5), (0, 0, 1), np.inf, (0, 0, 0), id="along the axis"),
        pytest.param((1.9, 0, -5), (0, 0, 1), np.inf, (0, 0, 0), id="through the hole"),
        pytest.param((4.1, 0, -5), (0, 0, 1), np.inf, (0, 0, 0), id="beside"),
        pytest.param((5, 0, 0), (1, 0, 0), np.inf, (0, 0, 0), id="behind"),
        pytest.param((0, -9, 1.1), (0, 1, 0), np.inf, (0, 0, 0), id="above"),
        pytest.param((-5, 0, 2), (1, 0, -1), 2 - S, (-S, 0, S), id="slanted"),
    ],
)
def test_hit_of_a_ring_of_3_and_1_about_z(origin, direction, t, normal, dtype):
    _, (found, n, *_) = cast_one(
        cast, origin, direction, (0, 0, 0), (0, 0, 1), 3, 1, dtype=dtype
    )
    assert found == pytest.approx(t, rel=eps(dtype, 4))
    np.testing.assert_allclose(n, normal, atol=eps(dtype, 4))


# Origin, direction, center, axis, major radius, minor radius.
PLACES = {
    "almost touching": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, 1.5 + 1e-6], "x", 1, 0.5),
    "a million radii away": ([0, 0, 0], [0, 0.1, 1], [1, 1e5, 1e6], "z", 1, 0.4),
    "in the ring, along it": ([0, 0, 0], [0.01, 1, 0], [1, 0, 0], "z", 1, 0.5),
    "in the hole": ([0, 0, 0], [0.1, 0.2, 1], [0.1, 0, 0], "y", 1, 0.3),
    "along the axis": ([0, 0, 0], [0, 0, 1], [0, 0, 5], "z", 1, 0.3),
    "beside the axis": ([0, 0, 0], [0, 0, 1], [0.8, 0, 5], "z", 1, 0.3),
    "through the axis": ([0, 0, 0], [0.1, 0, 1], [0.5, 0, 5], "z", 1, 0.3),
    "across the axis": ([0, 0, 0], [0, 0, 1], [0.3, 0, 5], "y", 1, 0.3),
    "in the plane, between": ([0, 0, 0], [0.01, 0, 1], [1e-3, 0, 5], "y", 1, 0.999),
    "tangent to the ring": ([0, 0, 0], [0, 0, 1], [1, 0, 5], "y", 1, 1e-4),
    "over the top": ([0, 0, 0], [0, 0, 1], [0.5, 0.1999999, 5], "y", 1, 0.2),
    "a wire": ([0, 0, 0], [0.2, 0, 1], [1, 3e-5, 5], "y", 1, 1e-4),
    "a wire, a kilometer away": ([0, 0, 0], [0, 0, 1], [1, 3e-5, 1e3], "z", 1, 1e-4),
    "hardly a hole": ([0, 0, 0], [0, 1e-7, 1], [0, 0, 5], "z", 1, 1 - 1e-6),
    "behind": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, -3], "x", 1, 0.3),
    "in micrometers": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, 3e-6], "x", 1e-6, 3e-7),
    "in megameters": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, 3e6], "x", 1e6, 3e5),
}
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


@pytest.mark.parametrize("place", PLACES)
def test_place_is_answered_as_the_oracle_does(place, dtype):
    origin, direction, center, axis, *radii = PLACES[place]
    for tilt in (0.0, 1e-7, 1e-3, 0.5):
        turned = np.add(AXES[axis], np.multiply(tilt, (0.3, -0.2, 0.7)))
        turned = turned / np.linalg.norm(turned)
        fields = (origin, direction, center, turned, *radii)
        row, found = cast_one(cast, *fields, dtype=dtype)
        check_against_oracle(row, found, dtype)


def test_rays_from_the_axis_meet_the_near_side(dtype):
    # They meet the axis to rounding, where their distance from the center line has a
    # kink: of a thousand one came out at the far side, inside the ring.
    rng = np.random.default_rng(0)
    axis, direction = rng.normal(size=(2, 4000, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    fields = (0.1 * axis, axis, np.ones(4000), np.full(4000, 0.7))
    ring = Torus((0, 0, 1), (0, 0, 1), 1, 0.5)
    cast = [jnp.asarray(x, dtype) for x in fields]
    ring = eqx.tree_at(
        lambda s: (s.center, s.axis, s.major_radius, s.minor_radius), ring, cast
    )
    zero = jnp.zeros(4000, dtype)
    ray = Ray(Vec3(zero, zero, zero), Vec3.from_array(jnp.asarray(direction, dtype)))
    hit = ring.intersect(ray)
    assert float(hit.mask.mean()) > 0.6
    off = ring.implicit(ray.at(jnp.where(hit.mask, hit.t, 0)))
    assert float(jnp.abs(jnp.where(hit.mask, off, 0)).max()) < 1e-5


def test_distance_of_a_point(dtype):
    torus = Torus(jnp.asarray((1, 0, 0), dtype), (0, 0, 1), 3, 1)
    points = [
        ((1, 0, 0), 2),
        ((4, 0, 0), -1),
        ((5, 0, 0), 0),
        ((1, 3, 1.5), 0.5),
        ((1, -6, 4), 4),
        ((1, 0, 4), 4),
    ]
    place, distance = zip(*points, strict=True)
    found = torus.implicit(Vec3.from_array(jnp.asarray(place, dtype)))
    np.testing.assert_allclose(found, distance, atol=eps(dtype, 8))


def test_image_of_a_ring_seen_along_its_axis_is_its_closed_form(dtype):
    # Across parallel rays it is what lies between two circles.
    camera = ij.OrthographicCamera(20, 20, 63.5, 47.5, 128, 96)
    maps = ij.render(Torus(jnp.asarray((0, 0, 5), dtype), (0, 0, 1), 1.5, 0.4), camera)
    v, u = np.mgrid[:96, :128]
    beside = np.hypot(u - 63.5, v - 47.5) / 20 - 1.5
    expected = np.abs(beside) < 0.4
    np.testing.assert_array_equal(np.asarray(maps.mask), expected)
    depth = 5 - np.sqrt(0.4**2 - beside[expected] ** 2)
    np.testing.assert_allclose(maps.depth[expected], depth, rtol=eps(dtype, 32))


@pytest.mark.parametrize("radii", [(1, 0), (1, -0.5), (1, np.nan), (1, 1), (1, 2)])
def test_radii_that_tracing_lets_in_are_an_empty_image(radii):
    fields = ((0, 0, 0), (0.3, 0.05, 1), (0, 0, 3), (0, 0, 1), *radii)
    _, (t, n, slopes, bends) = cast_one(cast, *fields, dtype="float32")
    assert np.isinf(t)
    assert not n.any()
    assert all_finite((slopes, bends))


ZERO, UP = (0, 0, 0), (0, 0, 1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((ZERO, UP, 1.0, 0.0), "minor_radius must be positive, in meters, got 0.0"),
        ((ZERO, UP, 1.0, 1.0), "minor_radius must be less than major_radius"),
        ((ZERO, UP, 1.0, 2.0), "less than major_radius, in meters, got 2.0 and 1.0"),
        ((ZERO, ZERO, 1.0, 0.5), "axis must not be the zero vector"),
        ((ZERO, UP, [2.0, 2.0], [1.0, 1.0]), "must have one batch shape"),
        (((0, 0, np.nan), UP, 1.0, 0.5), "center must be finite meters"),
    ],
)
def test_bad_field_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Torus(*arguments)
