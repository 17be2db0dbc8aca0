"""The cylinder where its formulas are strained: over all the extremes together.

`experiments.oracle` says what is exact, and how far rounding the inputs alone may
move it.
"""

import hypothesis
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.oracle.claims import DECISION, cast_all, depth, errors_of, one, slope
from experiments.oracle.condition import FIELDS, reference
from experiments.oracle.cylinder import answer
from experiments.oracle.extremes import Rays, extreme_rays
from impostor_jax.numerics import eps
from impostor_jax.primitives.cylinder import Cylinder
from tests.checks import all_finite
from tests.groups import FULL, RELEASE

# What the module of the cylinder promises, in eps.
DEPTH = 8
GRADIENT = 16
EVERY = tuple(range(6))


def normal(*fields):
    ray, shape = one(*fields)
    return shape.normal(ray, shape.intersect(ray)).stack()


@jax.jit
@jax.vmap
def differentiate(tangents, *fields):
    """Products with the first derivatives of depth and normal, and the second's."""

    def along(*fields):
        products = jax.tree.map(jnp.vdot, slope(*fields), tangents)
        return sum(products)

    _, pull = jax.vjp(normal, *fields)
    return (
        jax.jvp(depth, fields, tangents)[1],
        jax.jvp(normal, fields, tangents)[1],
        pull(jnp.ones_like(fields[0])),
        jax.jvp(slope, fields, tangents)[1],
        jax.grad(along, argnums=EVERY)(*fields),
    )


def arrays(rays, dtype=None):
    return [jnp.asarray(getattr(rays, name), dtype) for name in FIELDS]


def cast_one(*fields, dtype):
    fields = [jnp.asarray(field, dtype) for field in fields]
    found = cast_all(*(field[None] for field in fields))
    return fields, jax.tree.map(lambda x: np.asarray(x[0]), found)


def condition_of(fields, exact):
    """Sum of |x_i dt/dx_i| over t, from the oracle's own derivative."""
    origin, direction, center, axis, radius, height = map(np.asarray, fields)
    values = [*center, *axis, radius, height, *origin, *direction]
    derivative = [float(x) for x in exact.derivative]
    return float(np.sum(np.abs(np.multiply(values, derivative))) / exact.t)


def check_against_oracle(fields, found, dtype):
    """What is promised of one ray; whether a depth was promised."""
    t, on_cap, n, slopes = found
    assert not np.isnan(t)
    assert np.isfinite(n).all()
    assert all_finite(slopes)
    fields = [np.asarray(field) for field in fields]
    exact = answer(*fields)
    sure = reference(Rays(*(field[None] for field in fields)))
    unsure = eps(dtype, DECISION)
    if np.isfinite(t) != (exact.t is not None):
        assert sure.hit_margin[0] < unsure
        return False
    if exact.t is None or exact.derivative is None or sure.surface_margin[0] < unsure:
        return False
    assert on_cap == exact.on_cap
    condition = condition_of(fields, exact)
    if eps(dtype) * condition > 0.1:
        return False
    assert abs(float(t / float(exact.t)) - 1) <= eps(dtype, DEPTH) * condition
    return True


@FULL
def test_values_and_derivatives_are_numbers_on_every_ray(dtype):
    rays = extreme_rays(20000, 0, dtype)
    t, _, normals, slopes = cast_all(*arrays(rays))
    t = np.asarray(t)
    assert not np.isnan(t).any()
    assert (t > 0).all()
    assert 0.5 < np.isfinite(t).mean() < 0.95
    assert all_finite((normals, slopes))
    lengths = np.linalg.norm(normals, axis=1)
    np.testing.assert_allclose(lengths[np.isfinite(t)], 1, atol=eps(dtype, 8))
    assert not lengths[np.isinf(t)].any()


def tangents_of(fields, seed):
    rng = np.random.default_rng(seed)
    return tuple(jnp.asarray(rng.normal(size=x.shape), x.dtype) for x in fields)


@FULL
def test_products_with_derivatives_are_numbers_on_every_ray(dtype):
    fields = arrays(extreme_rays(20000, 1, dtype))
    assert all_finite(differentiate(tangents_of(fields, 2), *fields))


@FULL
def test_products_are_numbers_with_lengths_from_1e_minus_12_to_1e12(dtype):
    # Second derivatives go with 1 / radius, and with the height squared.
    rays, rng = extreme_rays(20000, 3, dtype), np.random.default_rng(4)
    radius, height, distance = np.exp(rng.uniform(*np.log([1e-12, 1e12]), (3, 20000)))
    offset = (rays.origin - rays.center).astype(float)
    offset *= (distance / np.linalg.norm(offset, axis=1))[:, None]
    zero = np.zeros_like(offset)
    values = (zero, rays.direction, -offset, rays.axis, radius, height)
    fields = [jnp.asarray(value, dtype) for value in values]
    assert 0.2 < np.isfinite(cast_all(*fields)[0]).mean() < 0.95
    assert all_finite(differentiate(tangents_of(fields, 5), *fields))


@FULL
def test_reference_in_double_precision_agrees_with_the_oracle():
    rays = extreme_rays(400, 5, "float32")
    found = reference(rays)
    for k in range(400):
        exact = answer(*(getattr(rays, name)[k] for name in FIELDS))
        assert (exact.t is None) == np.isinf(found.t[k])
        assert exact.on_cap == found.on_cap[k]
        if exact.derivative is None:
            continue
        fields = [getattr(rays, name)[k] for name in FIELDS]
        condition = condition_of(fields, exact)
        assert found.condition[k] == pytest.approx(condition, rel=1e-6)
        error = abs(found.t[k] / float(exact.t) - 1)
        assert error <= eps("float64", 8) * condition
        slopes = np.array([float(x) for x in exact.derivative[:8]])
        slopes[3:6] /= float(exact.t)
        error = np.linalg.norm(found.gradient[k] - slopes) / np.linalg.norm(slopes)
        assert error <= 1e-10 * found.gradient_condition[k]


@FULL
def test_single_precision_keeps_its_promises_over_all_extremes():
    # A million rays are cast by experiments/extremes.
    found = errors_of(extreme_rays(60000, 6, "float32"))
    assert not found.not_finite.any()
    assert found.wrong_hit.max() < DECISION
    assert found.wrong_surface.max() < DECISION
    assert len(found.depth) > 25000
    assert found.depth.max() <= DEPTH
    # Half an eps is the rounding of the result alone.
    assert np.percentile(found.depth, 99.9) < 1
    assert np.mean(found.gradient <= GRADIENT) > 0.999


@RELEASE
@pytest.mark.usefixtures("double")
def test_double_precision_keeps_its_promise():
    rays = extreme_rays(400, 7, "float64")
    told = 0
    found = jax.tree.map(np.asarray, cast_all(*arrays(rays)))
    for k in range(400):
        fields = [getattr(rays, name)[k] for name in FIELDS]
        row = jax.tree.map(lambda x, k=k: x[k], found)
        told += check_against_oracle(fields, row, "float64")
    assert told > 220


# Origin, direction, center, axis, radius, height.
PLACES = {
    "almost touching the wall": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, 1 + 1e-6], "y", 1, 2),
    "a million radii away": ([0, 0, 0], [0, 0.1, 1], [0, 1e5, 1e6], "x", 1, 2),
    "on the wall, looking in": ([0, 0, 0], [0.2, 0.3, 1], [0, 0, 1], "y", 1, 4),
    "on the wall, looking out": ([0, 0, 0], [0.2, 0.3, -1], [0, 0, 1], "y", 1, 4),
    "on the axis, inside": ([0, 0, 0], [0.2, 0.3, 1], [0, 1, 0], "y", 1, 4),
    "on the axis, looking along it": ([0, 0, 0], [0, 1, 0], [0, 1, 0], "y", 1, 4),
    "on the axis, outside": ([0, 0, 0], [0.1, 1, 0.2], [0, 7, 0], "y", 1, 4),
    "on a cap's plane, inside": ([0, 0, 0], [0.3, 0.2, 1], [0, 1, 0], "y", 1, 2),
    "on a cap's plane, outside": ([0, 0, 0], [0.1, 0.2, 1], [0, 1, 5], "y", 1, 2),
    "in a silo": ([0, 0, 0], [0.3, 50, 1], [0.2, 400, 0.1], "y", 2, 1000),
    "behind": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, -3], "y", 1, 2),
    "a disc": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, 3], "z", 1, 1e-4),
    "a disc, edge on": ([0, 0, 0], [0.05, 1e-6, 1], [0, 0, 3], "y", 1, 1e-4),
    "a wire": ([0, 0, 0], [0, 0.2, 1], [3e-5, 0, 5], "y", 1e-4, 10),
    "a pole": ([0, 0, 0], [0.3, -0.5, 1], [0.2, -1000, 2], "y", 1, 2000),
    "through the rim": ([0, 0, 0], [0.0, 0.25, 1], [0, 0, 4], "y", 1, 1.5),
    "through a cap's center": ([0, 0, 0], [0, 0, 1], [0, 0, 4], "z", 1, 2),
    "grazing": ([0, 0, 0], [0.2499999, 0, 1], [1, 0, 4], "y", 1e-6, 2),
    "at 0.01 degrees": ([0, 0, 0], [8e-5, 3e-5, 1], [0, 0, 1e4], "y", 1, 2),
    "at 175 degrees": ([0, 0, 0], [22.0, 3.0, 1], [22.0, 3, 1], "y", 1, 2),
    "around the camera": ([0, 0, 0], [1.0, 3.0, 1], [0, 0, 0], "y", 2, 2),
    "in micrometers": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, 3e-6], "y", 1e-6, 2e-6),
    "in megameters": ([0, 0, 0], [0.1, 0.2, 1], [0, 0, 3e6], "y", 1e6, 2e6),
}
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
TILTS = (0.0, 1e-7, 1e-3, 0.5)


@FULL
@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("place", PLACES)
def test_place_is_answered_as_the_oracle_does(place, tilt, dtype):
    origin, direction, center, axis, radius, height = PLACES[place]
    axis = np.add(AXES[axis], np.multiply(tilt, (0.3, -0.2, 0.7)))
    axis = axis / np.linalg.norm(axis)
    fields, found = cast_one(
        origin, direction, center, axis, radius, height, dtype=dtype
    )
    check_against_oracle(fields, found, dtype)


lengths = st.floats(-6, 6).map(lambda x: 10.0**x)
numbers = st.floats(-1, 1)


@FULL
@hypothesis.given(
    scale=lengths,
    distance=st.floats(-6, 6).map(lambda x: 1 + 10.0**x),
    ratio=st.floats(-4, 4).map(lambda x: 10.0**x),
    axis=st.tuples(numbers, numbers, numbers).filter(lambda a: np.any(np.abs(a) > 0.1)),
    tilt=st.sampled_from([0.0, 1e-7, 1e-4, 1.0]),
    aim=st.tuples(numbers, numbers, numbers),
    precision=st.sampled_from(["float32", "float64"]),
)
@hypothesis.settings(max_examples=200)
def test_any_scene_keeps_the_promise(
    scale, distance, ratio, axis, tilt, aim, precision
):
    axis = np.add((0, 0, 1), np.multiply(tilt, axis))
    axis /= np.linalg.norm(axis)
    center = np.array((0.3, -0.1, 1)) * distance * scale
    target = center + scale * np.array(aim) + axis * aim[2] * ratio / 3 * scale
    direction = target / max(np.abs(target).max(), 1e-30)
    values = ((0, 0, 0), direction, center, axis, scale, ratio * scale)
    with jax.enable_x64(precision == "float64"):
        fields, found = cast_one(*values, dtype=precision)
        check_against_oracle(fields, found, precision)


@FULL
def test_height_derivative_of_a_coin_seen_from_afar_has_its_sign():
    # The far end was taken for the near one: the rounding of the depth hid which it is.
    _, (t, on_cap, _, slopes) = cast_one(
        *((0, 0, 0), (1e-5, 2e-5, 1), (0, 0, 3e4), (0.1, 0.2, 0.97), 1, 1e-3),
        dtype="float32",
    )
    assert on_cap
    assert t == pytest.approx(3e4, rel=1e-4)
    # Half of 1 / a_z, of the axis as a unit vector.
    assert slopes[5] == pytest.approx(-0.5131, abs=1e-3)


@pytest.mark.parametrize(
    "values",
    [
        # Each was a hundred times worse: the ray was moved to its point nearest to the
        # center, much farther than what it meets.
        pytest.param(
            ((0, 0, 0), (0.3, -0.5, 1), (0.2, -1000, 2), (0, 1, 0), 1, 2000), id="pole"
        ),
        pytest.param(
            ((0, 0, 1e-3), (0.6, 0, -0.8), (0.9, 0, 0), (0, 0, 1), 1, 1.8e-3), id="disc"
        ),
    ],
)
def test_surface_much_nearer_than_the_center_keeps_its_digits(values, dtype):
    fields, (t, *_) = cast_one(*values, dtype=dtype)
    exact = answer(*(np.asarray(field) for field in fields))
    assert abs(float(t) / float(exact.t) - 1) < eps(dtype, 8)


def test_ray_along_the_axis_and_beside_the_wall_misses():
    # It met the wall: of the cross product of direction and axis only rounding is left.
    along = (-0.35384166, -0.65963984, 0.66307718)
    center = (-1.7692083, -1.5967385, 5.008026)
    _, (t, *_) = cast_one((0, 0, 0), along, center, along, 1, 1, dtype="float32")
    assert np.isinf(t)


@pytest.mark.parametrize("distance", [1e2, 1e4])
def test_cap_seen_end_on_from_afar_is_hit(distance, dtype):
    values = ((0, 0, 0), (2e-5 / distance, 0, 1), (0, 0, distance), (0, 0, 1), 1, 1)
    _, (t, on_cap, *_) = cast_one(*values, dtype=dtype)
    assert on_cap
    assert t == pytest.approx(distance - 0.5, rel=eps(dtype, 4))


@pytest.mark.parametrize("name", ["radius", "height"])
@pytest.mark.parametrize(
    ("value", "sees"),
    [
        (0.0, False),
        (-0.5, False),
        (np.nan, False),
        (1e-40, False),
        (np.inf, None),
    ],
)
def test_size_that_tracing_lets_in_is_an_empty_image_or_a_defined_one(
    name, value, sees
):
    values = [(0, 0, 0), (0.1, 0.05, 1), (0, 0, 3), (0, 1, 0), 0.5, 1.0]
    values[4 if name == "radius" else 5] = value
    _, (t, on_cap, n, slopes) = cast_one(*values, dtype="float32")
    # An endless wall is seen where it stands; no radius is endless.
    expected = name == "height" if sees is None else sees
    assert np.isfinite(t) == expected
    assert not on_cap
    assert np.isfinite(n).all()
    assert all_finite(slopes)


@pytest.mark.parametrize("size", ["radius", "height"])
def test_smallest_normal_size_is_taken(size, dtype):
    tiny = float(np.finfo(dtype).tiny)
    sizes = {"radius": 0.5, "height": 1.0, size: tiny}
    cylinder = Cylinder((0, 0, 3), (0, 0, 1), **sizes)
    fields = ((0, 0, 0), (0.05, 0.02, 1), (0, 0, 3), (0, 0, 1))
    _, (t, _, n, slopes) = cast_one(
        *fields, cylinder.radius, cylinder.height, dtype=dtype
    )
    # A disc without thickness is seen, a wire of no thickness is not.
    assert np.isfinite(t) == (size == "height")
    assert np.isfinite(n).all()
    assert all_finite(slopes)
