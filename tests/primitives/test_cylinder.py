import hypothesis
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.oracle.cylinder import answer
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.cylinder import Cylinder


def cast(cylinder, origin, direction):
    dtype = cylinder.radius.dtype
    ray = Ray(*(Vec3(*(jnp.asarray(c, dtype) for c in v)) for v in (origin, direction)))
    return compiled(cylinder, ray)


@jax.jit
def compiled(cylinder, ray):
    hit = cylinder.intersect(ray)
    return hit, cylinder.normal(ray, hit)


@pytest.mark.parametrize(
    ("origin", "direction", "t", "normal", "on_cap"),
    [
        pytest.param((-3, 0, 0), (1, 0, 0), 2, (-1, 0, 0), False, id="wall, outside"),
        pytest.param(
            (-3, 0, 0), (4, 0, 0), 0.5, (-1, 0, 0), False, id="long direction"
        ),
        pytest.param((0, 0, -5), (0, 0, 1), 3, (0, 0, -1), True, id="end on"),
        pytest.param((0.5, 0.5, 9), (0, 0, -1), 7, (0, 0, 1), True, id="off the axis"),
        pytest.param((0, 0, 0), (1, 0, 0), 1, (-1, 0, 0), False, id="inside: the wall"),
        pytest.param((0, 0, 0), (0, 0, 1), 2, (0, 0, -1), True, id="inside: the cap"),
        pytest.param((0.5, 0, 0), (0, 0, 1), 2, (0, 0, -1), True, id="inside, along"),
        pytest.param((-3, 0, 1.9), (1, 0, 0), 2, (-1, 0, 0), False, id="below a cap"),
        pytest.param((-3, 0, 2.1), (1, 0, 0), None, None, False, id="above a cap"),
        pytest.param((-3, 0, 1.5), (1, 0, 1), None, None, False, id="over the rim"),
        pytest.param((3, 0, 0), (1, 0, 0), None, None, False, id="behind"),
        pytest.param((0, 0, 3), (0, 0, 1), None, None, False, id="behind, end on"),
        pytest.param((-3, 1.5, 0), (1, 0, 0), None, None, False, id="beside the wall"),
        pytest.param((2, 0, 0), (0, 0, 1), None, None, False, id="along, outside"),
    ],
)
def test_hit_of_a_cylinder_of_radius_1_and_height_4(
    origin, direction, t, normal, on_cap, dtype
):
    hit, found = cast(Cylinder((0, 0, 0), (0, 0, 3), 1, 4), origin, direction)
    assert bool(hit.mask) == (t is not None)
    assert bool(hit.on_cap) == on_cap
    if t is not None:
        assert float(hit.t) == pytest.approx(t, rel=eps(dtype, 4))
        np.testing.assert_allclose(found.stack(), normal, atol=eps(dtype, 4))
    else:
        assert float(hit.t) == np.inf
        assert not np.asarray(found.stack()).any()


def exact_depth(cylinder, direction):
    """First hit from the origin in 50 digits, on the same rounded inputs."""
    c = cylinder
    found = answer((0, 0, 0), direction, c.center, c.axis, c.radius, c.height)
    return None if found.t is None else float(found.t)


def test_depth_of_a_distant_thin_cylinder_is_exact_to_its_conditioning(dtype):
    # b^2 - ac loses 1.6e-4 m here in single precision.
    cylinder = Cylinder((0.5, -0.3, 5.0), (0.3, 0.8, 0.2), 0.01, 1.0)
    pixels = np.linspace(-1, 1, 101)
    errors = []
    for u in pixels:
        target = np.asarray(cylinder.center, float) + 0.2 * u * np.asarray(
            cylinder.axis
        )
        direction = jnp.asarray(target / target[2] + (0.0009 * u, 0, 0), dtype)
        exact = exact_depth(cylinder, direction)
        if exact is not None:
            hit, _ = cast(cylinder, (0, 0, 0), direction)
            errors.append(abs(float(hit.t) - exact))
    assert len(errors) > 80
    # Measured: 4e-7 m at the 90th percentile in single precision.
    assert np.percentile(errors, 90) < eps(dtype, 8) * 5


def test_a_cap_seen_end_on_from_afar_is_hit(dtype):
    # Without moving the ray's origin close, single precision loses this cap.
    cylinder = Cylinder((0, 0, 1000.0), (1e-6, 0, 1), 0.05, 0.1)
    direction = jnp.asarray((1e-5, 2e-5, 1), dtype)
    hit, _ = cast(cylinder, (0, 0, 0), direction)
    assert bool(hit.on_cap)
    expected = exact_depth(cylinder, direction)
    assert float(hit.t) == pytest.approx(expected, rel=eps(dtype, 4))


@pytest.mark.usefixtures("double")
def test_depth_of_a_wall_point_has_the_derivatives_of_geometry():
    # A camera 3 m from the wall of a cylinder of radius 1, looking at its axis.
    cylinder = Cylinder((0, 0, 4.0), (0, 1, 0), 1.0, 2.0)

    def depth(cylinder):
        return cast(cylinder, (0, 0, 0), (0, 0, 1))[0].t

    slope = jax.grad(depth)(cylinder)
    np.testing.assert_allclose(slope.center, [0, 0, 1], atol=1e-12)
    assert float(slope.radius) == pytest.approx(-1)
    assert float(slope.height) == 0
    np.testing.assert_allclose(slope.axis, 0, atol=1e-12)


@hypothesis.given(
    scale=st.sampled_from([2.0**-10, 0.5, 4.0, 2.0**12]),
    tilt=st.floats(-1.5, 1.5),
    turn=st.floats(-3, 3),
    x=st.floats(-0.3, 0.3),
    y=st.floats(-0.3, 0.3),
)
def test_scaling_the_scene_by_a_power_of_two_scales_depth_exactly(
    scale, tilt, turn, x, y
):
    axis = (np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt))
    depths = [
        float(
            cast(Cylinder((0, 0, 3 * s), axis, 0.5 * s, 1.5 * s), (0, 0, 0), (x, y, 1))[
                0
            ].t
        )
        for s in (1.0, scale)
    ]
    assert depths[1] == scale * depths[0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"radius": 0.0}, "radius must be positive, in meters, got 0.0"),
        ({"radius": -1.0}, "radius must be positive"),
        ({"height": 0.0}, "height must be positive"),
        ({"radius": np.nan}, "radius must be finite meters, got nan"),
        ({"center": (0, 0)}, r"center must be meters of shape \(3,\)"),
        ({"center": (0, np.inf, 1)}, "center must be finite meters"),
        ({"axis": (0, 0, 0)}, "axis must not be the zero vector"),
        ({"axis": "up"}, "axis must be numbers of shape"),
        ({"radius": [1.0, 2.0]}, "must have one batch shape"),
    ],
)
def test_bad_field_is_refused(changes, message):
    fields = {"center": (0, 0, 1), "axis": (0, 1, 0), "radius": 0.1, "height": 0.2}
    with pytest.raises(ValueError, match=message):
        Cylinder(**{**fields, **changes})


@pytest.mark.parametrize("length", [1e-30, 1.0, 1e30])
def test_axis_of_any_length_becomes_unit(length, dtype):
    axis = Cylinder((0, 0, 1), (3 * length, 0, 4 * length), 1, 1).axis
    np.testing.assert_allclose(axis, [0.6, 0, 0.8], rtol=eps(dtype, 4))


def test_signed_distance_of_points_inside_beside_and_at_a_corner(dtype):
    cylinder = Cylinder((0, 0, 0), (0, 0, 1), 1, 4)
    points = Vec3.from_array(
        jnp.asarray([[0, 0, 0], [0.9, 0, 0], [3, 0, 0], [0, 0, 5], [4, 0, 6]], dtype)
    )
    np.testing.assert_allclose(
        cylinder.implicit(points), [-1, -0.1, 2, 3, 5], atol=eps(dtype, 4)
    )
