import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from impostor_jax.numerics import eps
from impostor_jax.sensor.structured_light import StructuredLight, _arctan
from tests.checks import central_difference
from tests.groups import FULL
from tests.sensor.scenes import COUNT, bands, readings, sigma_of


@pytest.mark.parametrize(
    ("depth", "degrees", "expected"),
    [
        pytest.param(0.4, 0, 0.0012, id="best depth, normal incidence"),
        pytest.param(1.4, 0, 0.0031, id="a meter farther"),
        pytest.param(1.0, 45, 0.001984, id="45 degrees: the ratio is 1"),
        pytest.param(1.0, 60, 0.002284, id="60 degrees: the ratio is 2"),
        pytest.param(4.0, 60, 0.026024, id="farther, less of the last term"),
        pytest.param(1.0, 80, 0.008284, id="80 degrees: the ratio is 8"),
        pytest.param(1.0, 85, 0.008284, id="held constant from 80 degrees"),
        pytest.param(1.0, 90, 0.008284, id="grazing"),
    ],
)
def test_sigma_is_that_of_the_paper(depth, degrees, expected, dtype):
    sigma = sigma_of(StructuredLight(), depth, np.cos(np.radians(degrees)))
    # At 80 degrees the square multiplies the rounding of the angle that is lacking to
    # 90, which is that of numbers 9 times as large, by 2.
    assert float(sigma) == pytest.approx(expected, rel=eps(dtype, 32))


@pytest.mark.usefixtures("double")
def test_derivatives_are_those_of_differences():
    at = tuple(np.meshgrid([0.3, 0.4, 1.0, 3.0], [0.2, 0.5, 0.9, 0.999]))

    @jax.jit
    def sigma(at):
        return StructuredLight().sigma(*at)

    for which in (0, 1):
        tangent = tuple(np.full((4, 4), float(which == i)) for i in (0, 1))
        _, slope = jax.jvp(sigma, (at,), (tangent,))
        numeric = central_difference(sigma, at, tangent)
        np.testing.assert_allclose(slope, numeric, rtol=1e-6, atol=1e-10)


def test_slope_at_normal_incidence_is_that_of_the_series(dtype):
    # theta^2 = 2 (1 - c) + ..., though theta has an infinite slope there.
    @jax.jit
    @jax.grad
    def slope(cosine):
        return StructuredLight().sigma(jnp.ones_like(cosine), cosine)

    at_one = float(slope(np.ones((), dtype)))
    assert at_one == pytest.approx(-0.0001 * 8 / np.pi**2, rel=eps(dtype, 8))
    # A few steps away it has the other branch: of first order in theta, and rounded
    # as the tangent of its half is.
    beside = float(slope(np.asarray(1 - eps(dtype, 8), dtype)))
    assert beside == pytest.approx(at_one, rel=8 * eps(dtype) ** 0.5)


def test_readings_scatter_as_sigma_says_at_each_depth_and_incidence():
    noise = StructuredLight()
    depth = bands((0.5, 1.0, 2.0, 4.0), 1)
    angle = np.radians(bands((0, 30, 65, 78), 0))
    sample = readings(noise, depth, angle)
    score = (sample - depth) / sigma_of(noise, depth, np.cos(angle))
    bins = score.reshape(COUNT, 4, 12, 4, 16).transpose(1, 3, 0, 2, 4).reshape(16, -1)
    # 4.5 standard errors of 3072 draws, which one of 16 bins exceeds once in 10,000.
    count = bins.shape[1]
    assert (abs(bins.mean(axis=1)) < 4.5 / np.sqrt(count)).all()
    assert (abs(bins.std(axis=1) - 1) < 4.5 / np.sqrt(2 * count)).all()


def test_sigma_is_differentiable_in_the_coefficients(dtype):
    @jax.jit
    @jax.grad
    def slope(coefficients):
        floor, growth, grazing = coefficients
        noise = StructuredLight(floor, growth, grazing=grazing)
        return noise.sigma(jnp.asarray(1.4, dtype), jnp.asarray(np.sqrt(0.5), dtype))

    found = slope([np.asarray(x, dtype) for x in (0.001, 0.002, 0.0001)])
    np.testing.assert_allclose(found, [1, 1, 1.4**-0.5], rtol=eps(dtype, 16))


@FULL
def test_arctangent_is_right_to_three_roundings(dtype):
    x = jnp.linspace(0, 1, 20001)
    found = np.asarray(jax.jit(_arctan)(x), np.float64)
    for angle, value in zip(found, np.asarray(x, np.float64), strict=True):
        exact = mpmath.atan(value)
        assert abs(angle - exact) <= 3 * eps(dtype) * exact
    slope = jax.jit(jax.vmap(jax.grad(_arctan)))(x)
    np.testing.assert_allclose(slope, 1 / (1 + x * x), rtol=5 * eps(dtype), atol=0)
