"""Constructors, what wrappers hand on, and the incidence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.numerics import eps
from impostor_jax.sensor.base import cos_incidence
from tests.cases import CAMERAS
from tests.checks import QUICKLY
from tests.sensor.scenes import CAMERA, bands, normals, sigma_of

incidence = jax.jit(cos_incidence, compiler_options=QUICKLY)
SENSOR = ij.ConstantNoise(0.001)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: ij.ConstantNoise(0),
            "deviation must be a positive number in meters, got 0.0",
        ),
        (
            lambda: ij.StructuredLight(floor=-1),
            "floor must be a positive number in meters, got -1.0",
        ),
        (
            lambda: ij.StructuredLight(growth=-1),
            "growth must be 0 or positive, in 1/meters, got -1.0",
        ),
        (
            lambda: ij.StructuredLight(best_depth=np.nan),
            "best_depth must be a finite number in meters, got nan",
        ),
        (
            lambda: ij.StructuredLight(grazing=-1),
            "grazing must be 0 or positive, in meters^1.5, got -1.0",
        ),
        (
            lambda: ij.StructuredLight(max_angle=80),
            "max_angle must be an angle from 0 to 1.562 radians (89.5 degrees), "
            "got 80.0",
        ),
        (
            lambda: ij.MatchingWindow(SENSOR, half_window=-1),
            "half_window must be 0 or positive, got -1.0",
        ),
        (
            lambda: ij.MatchingWindow(SENSOR, half_window=20, native_scale=2),
            "half_window must be at most 32 pixels of the image, got 20.0 "
            "times native_scale 2.0",
        ),
        (lambda: ij.LateralNoise(0.8), "sensor must be a noise model such as"),
        (
            lambda: ij.LateralNoise(SENSOR, floor=-1),
            "floor must be from 0 to 10000 pixels, got -1.0",
        ),
        (
            lambda: ij.LateralNoise(SENSOR, growth=-1),
            "growth must be from 0 to 10000 pixels, got -1.0",
        ),
        (lambda: ij.LateralNoise(SENSOR, max_angle=-1), "max_angle must be an angle"),
        (
            lambda: ij.StereoDisparity(-525),
            "focal_length must be a positive number in pixels, got -525.0",
        ),
        (
            lambda: ij.StereoDisparity(525, baseline=0),
            "baseline must be a positive number in meters, got 0.0",
        ),
        (
            lambda: ij.StereoDisparity(525, deviation=0),
            "deviation must be a positive number in pixels, got 0.0",
        ),
        (
            lambda: ij.StereoDisparity(525, step=-1),
            "step must be 0 or positive, in pixels, got -1.0",
        ),
        (lambda: ij.Dropout(None), "sensor must be a noise model such as"),
        (
            lambda: ij.Dropout(SENSOR, rate=1.5),
            "rate must be a probability from 0 to 1, got 1.5",
        ),
        (
            lambda: ij.Dropout(SENSOR, cutoff=np.pi / 2),
            "cutoff must be an angle from 0 to 1.562 radians (89.5 degrees), got 1.57",
        ),
        (lambda: ij.FlyingPixels(1), "sensor must be a noise model such as"),
        (
            lambda: ij.FlyingPixels(SENSOR, probability=-0.1),
            "probability must be a probability from 0 to 1, got -0.1",
        ),
        (
            lambda: ij.FlyingPixels(SENSOR, jump=-1),
            "jump must be 0 or a positive fraction of the nearer depth, got -1.0",
        ),
        (
            lambda: ij.FlyingPixels(SENSOR, jump="large"),
            "jump must be a finite number, got 'large'",
        ),
    ],
)
def test_an_error_names_argument_value_and_need(make, message):
    with pytest.raises(ValueError, match="must be") as caught:
        make()
    assert message in str(caught.value)


def test_traced_numbers_pass():
    @jax.jit
    def sigma(x):
        sensor = ij.StereoDisparity(x, x, x, x)
        sensor = ij.LateralNoise(sensor, x, x, x)
        sensor = ij.FlyingPixels(ij.Dropout(sensor, x, x), x, x)
        # A value that is out of range is not known to be.
        light = ij.StructuredLight(-x, -x, x, x, x)
        one = jnp.ones(())
        return sensor.sigma(one, one), light.sigma(one, one)

    assert np.isfinite(sigma(0.5)).all()


@pytest.mark.parametrize("wrap", [ij.LateralNoise, ij.Dropout, ij.FlyingPixels])
def test_a_wrapper_leaves_sigma_alone(wrap, dtype):
    sensor = ij.StructuredLight()
    at = [0.4, 2.0, np.inf, 0.0], [1.0, 0.3, 0.0, 1.0]
    np.testing.assert_array_equal(sigma_of(wrap(sensor), *at), sigma_of(sensor, *at))


def test_incidence_is_the_angle_of_normal_and_ray(dtype):
    angle = np.radians(bands([0, 20, 60, 89], 0))
    found = incidence(jnp.asarray(normals(angle), dtype), CAMERA)
    assert found.dtype == dtype
    np.testing.assert_allclose(found, np.cos(angle), atol=eps(dtype, 4))
    assert (np.asarray(found) <= 1).all()


def test_incidence_is_that_of_the_lens():
    camera = CAMERAS["distorted"]()
    normal = np.zeros((camera.height, camera.width, 3), np.float32)
    normal[..., 2] = -1
    field = camera.ray_field
    expected = 1 / np.sqrt(1 + field.x**2 + field.y**2)
    found = incidence(jnp.asarray(normal), camera)
    np.testing.assert_allclose(found, expected, rtol=eps(np.float32, 4))


def test_nothing_hit_has_an_incidence_of_zero():
    found = incidence(jnp.zeros((CAMERA.height, CAMERA.width, 3)), CAMERA)
    assert not np.asarray(found).any()


def test_an_image_of_another_size_is_refused():
    depth, normal = jnp.ones((4, 5)), jnp.zeros((4, 5, 3))
    with pytest.raises(ValueError, match=r"normal must have .* got shape \(4, 5, 3\)"):
        ij.StructuredLight().sample(jax.random.key(0), depth, normal, CAMERA)
