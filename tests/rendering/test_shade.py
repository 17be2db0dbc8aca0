import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.numerics import eps
from tests.cases import pose
from tests.checks import all_finite
from tests.groups import FULL

OUTPUTS = ("point", "normal", "mask")
CAMERA = ij.PinholeCamera(60.0, 60.0, 20.0, 15.0, 41, 31)
PARALLEL = ij.OrthographicCamera(10.0, 10.0, 20.0, 15.0, 41, 31)
CENTER = (15, 20)


def ball():
    return ij.Sphere((0.0, 0.0, 4.0), 0.8)


def seen(primitive=None, camera=CAMERA):
    return ij.render(primitive or ball(), camera, outputs=OUTPUTS)


def by_the_formula(maps, camera, lights, exponent):
    """What a white surface reflects, pixel by pixel, in double precision."""
    found = np.zeros(maps.mask.shape)
    for pixel in np.argwhere(np.asarray(maps.mask)):
        p, n = (np.asarray(m[tuple(pixel)], float) for m in (maps.point, maps.normal))
        v = -p / np.linalg.norm(p) if camera.is_central else np.array([0, 0, -1.0])
        for light in lights:
            if isinstance(light, ij.AmbientLight):
                found[tuple(pixel)] += light.intensity
                continue
            away = (
                np.asarray(light.position) - p
                if isinstance(light, ij.PointLight)
                else np.asarray(light.direction)
            )
            to_light = away / np.linalg.norm(away)
            n_l = n @ to_light
            r = 2 * n * n_l - to_light
            shine = max(0, r @ v) ** exponent if n_l > 0 else 0
            found[tuple(pixel)] += light.intensity * (max(0, n_l) + shine)
    return found


@pytest.mark.parametrize("camera", [CAMERA, PARALLEL], ids=["pinhole", "parallel"])
def test_sphere_lit_head_on_is_brightest_in_its_middle(camera, dtype):
    light = ij.PointLight((0.0, 0.0, 0.0), 0.4)
    color = np.array([1.0, 0.5, 0.25])
    picture = np.asarray(ij.shade(seen(camera=camera), camera, [light], color))
    # Diffuse and specular reflection are both whole.
    np.testing.assert_allclose(picture[CENTER], 0.8 * color, rtol=eps(dtype, 8))
    assert picture.max() == picture[CENTER].max()
    assert picture.dtype == dtype


def test_highlight_falls_off_with_its_exponent():
    light = ij.DirectionalLight((0.0, 0.0, -1.0), 1.0)
    maps = seen(camera=PARALLEL)
    plain = ij.shade(maps, PARALLEL, [light], exponent=None)[..., 0]
    cosine = -np.asarray(maps.normal)[..., 2]
    # Seen along the light, r.v is the cosine of twice the angle of the normal.
    r_v = np.maximum(2 * cosine**2 - 1, 0) * np.asarray(maps.mask)
    for exponent in (1.0, 30.0, 500.0):
        shiny = ij.shade(maps, PARALLEL, [light], exponent=exponent)[..., 0]
        np.testing.assert_allclose(shiny - plain, r_v**exponent, atol=1e-4)
    np.testing.assert_allclose(plain, cosine * np.asarray(maps.mask), atol=1e-6)


@pytest.mark.parametrize("camera", [CAMERA, PARALLEL], ids=["pinhole", "parallel"])
def test_lights_add_up_as_the_formula_says(camera, double):
    lights = [
        ij.AmbientLight(0.2),
        ij.PointLight((2.0, 1.0, 0.0), 0.6),
        ij.DirectionalLight((1.0, 4.0, 4.0), 0.2),
    ]
    maps = seen(camera=camera)
    picture = np.asarray(ij.shade(maps, camera, lights, exponent=10.0))
    expected = by_the_formula(maps, camera, lights, 10.0)
    np.testing.assert_allclose(picture, expected[..., None] * np.ones(3), atol=1e-12)


def test_direction_to_a_light_has_any_length():
    pictures = [
        ij.shade(seen(), CAMERA, [ij.DirectionalLight((0.0, -length, -length), 1.0)])
        for length in (1e-30, 1.0, 1e30)
    ]
    np.testing.assert_array_equal(pictures[0], pictures[1])
    np.testing.assert_array_equal(pictures[2], pictures[1])


def test_lights_are_of_the_world(dtype):
    lights = [
        ij.PointLight((1.0, -2.0, 0.5), 0.7),
        ij.DirectionalLight((1.0, -1.0, -2.0), 0.5),
    ]
    posed = ij.PinholeCamera(60.0, 60.0, 20.0, 15.0, 41, 31, camera_from_world=pose())
    moved = ball().transformed(pose().inverse())
    there = [light.transformed(pose().inverse()) for light in lights]
    found = ij.shade(seen(moved, posed), posed, there)
    expected = ij.shade(seen(), CAMERA, lights)
    inner = np.hypot(*(np.indices((31, 41)) - np.array(CENTER)[:, None, None])) < 10
    np.testing.assert_allclose(
        np.asarray(found)[inner], np.asarray(expected)[inner], atol=eps(dtype, 512)
    )


def test_edge_is_blended_with_the_background_by_its_coverage():
    can = ij.Cylinder((0.1, 0.0, 4.0), (0.2, 1, 0.1), 0.5, 1.2)
    coverage, maps = ij.coverage(can, CAMERA), seen(can)
    lights, background = [ij.AmbientLight(1.0)], (0.1, 0.2, 0.9)
    color = (0.8, 0.6, 0.4)
    picture = ij.shade(
        maps, CAMERA, lights, color, background=background, coverage=coverage
    )
    part = np.asarray(coverage)[..., None]
    # With a center that misses, too, an edge has the color of the surface.
    assert ((part[..., 0] > 0.2) & ~np.asarray(maps.mask)).any()
    expected = part * np.array(color) + (1 - part) * np.array(background)
    np.testing.assert_allclose(picture, expected, atol=1e-6)


def test_hard_edge_shows_what_the_center_sees():
    maps = seen()
    picture = np.asarray(
        ij.shade(maps, CAMERA, [ij.AmbientLight(0.5)], background=(0.0, 0.0, 1.0))
    )
    mask = np.asarray(maps.mask)
    np.testing.assert_array_equal(picture[mask], np.full((mask.sum(), 3), 0.5))
    np.testing.assert_array_equal(picture[~mask], [[0.0, 0.0, 1.0]] * (~mask).sum())


def test_every_pixel_may_have_its_own_color():
    color = jnp.linspace(0, 1, 31 * 41 * 3).reshape(31, 41, 3)
    picture = ij.shade(seen(), CAMERA, [ij.AmbientLight(1.0)], color, None, color)
    np.testing.assert_array_equal(picture, color)


def test_light_behind_a_surface_is_not_reflected():
    light = ij.DirectionalLight((0.0, 0.02, 1.0), 1.0)
    picture = ij.shade(seen(), CAMERA, [light], exponent=0.5)
    assert float(picture[CENTER].max()) == 0


@FULL
@pytest.mark.parametrize(
    ("exponent", "smooth"), [(None, False), (0.5, False), (30.0, True)]
)
def test_derivatives_are_finite_and_those_of_differences(exponent, smooth, double):
    lights = [ij.PointLight((0.5, -1.0, 0.0), 0.6), ij.DirectionalLight((0, 0, 1), 0.2)]
    can = ij.Cylinder((0.1, 0.0, 4.0), (0.2, 1, 0.1), 0.5, 1.2)

    @jax.jit
    @functools.partial(jax.value_and_grad, argnums=(0, 1, 2))
    def total(can, lights, color):
        coverage = ij.coverage(can, CAMERA) if smooth else None
        picture = ij.shade(
            seen(can), CAMERA, lights, color, exponent, coverage=coverage
        )
        return jnp.sum(picture**2)

    arguments = (can, lights, jnp.array([0.9, 0.5, 0.2]))
    _, gradient = total(*arguments)
    assert all_finite(gradient)
    assert float(jnp.abs(gradient[0].center).max()) > 0
    step = 1e-6
    moved = [
        total(can, [ij.PointLight((0.5 + sign * step, -1.0, 0.0), 0.6), lights[1]],
              arguments[2])[0]
        for sign in (1, -1)
    ]  # fmt: skip
    slope = (moved[0] - moved[1]) / (2 * step)
    assert gradient[1][0].position[0] == pytest.approx(float(slope), rel=1e-5)


def test_misuse_is_named():
    maps, lights = seen(), [ij.AmbientLight(1.0)]
    with pytest.raises(ValueError, match="maps must hold point, normal and mask"):
        ij.shade(ij.render(ball(), CAMERA), CAMERA, lights)
    with pytest.raises(ValueError, match="coverage must have the shape"):
        ij.shade(maps, CAMERA, lights, coverage=jnp.zeros((4, 5)))
    with pytest.raises(ValueError, match="color must have the shape"):
        ij.shade(maps, CAMERA, lights, color=np.zeros((4, 5, 3)))
    with pytest.raises(ValueError, match="exponent must be a number"):
        ij.shade(maps, CAMERA, lights, exponent=-1.0)
    with pytest.raises(ValueError, match="intensity must be a number"):
        ij.AmbientLight(-0.1)
    with pytest.raises(ValueError, match="direction must not be the zero vector"):
        ij.DirectionalLight((0, 0, 0), 1.0)
