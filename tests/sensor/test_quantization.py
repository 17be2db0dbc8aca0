import jax
import numpy as np
import pytest

from impostor_jax.numerics import eps
from impostor_jax.sensor.quantization import StereoDisparity
from tests.checks import QUICKLY
from tests.sensor.scenes import SHAPE, bands, readings, sigma_of

SCALE = 525.0 * 0.05


@jax.jit(compiler_options=QUICKLY)
def _interval(noise, reading):
    return noise.interval(reading)


def interval(noise, reading):
    return [np.asarray(bound) for bound in _interval(noise, reading)]


@pytest.mark.parametrize("step", [1 / 32, 0.3])
def test_disparities_are_multiples_of_the_step(step):
    sample = readings(StereoDisparity(525.0, step=step), bands([0.5, 3.0], 1))
    steps = SCALE / sample.astype(float) / step
    # The reading and its disparity are each rounded to their precision.
    np.testing.assert_allclose(steps, np.rint(steps), rtol=eps(np.float32, 4))
    assert len(np.unique(np.rint(steps))) > 2


def test_without_steps_hardly_any_disparities_agree():
    sample = readings(StereoDisparity(525.0, step=0), 1.0)[0]
    assert len(np.unique(sample)) > 0.9 * sample.size


@pytest.mark.parametrize("step", [0.0, 1 / 32, 0.2])
def test_readings_scatter_as_sigma_says_at_each_depth(step):
    # Depths of a band spread over many steps, so the rounding is uniform.
    middle = bands([0.5, 1.0, 2.0, 4.0], 1)
    depth = middle * np.linspace(0.9, 1.1, SHAPE[0])[:, None]
    noise = StereoDisparity(525.0, step=step)
    sample = readings(noise, depth)
    score = (sample - depth) / sigma_of(noise, depth, 1.0)
    bins = score.reshape(-1, SHAPE[0], 4, 16).transpose(2, 0, 1, 3).reshape(4, -1)
    # 4.5 standard errors of 12288 draws, and the second order: at 4 m the error is
    # 1.5 percent of the disparity at most, and makes that a bias in deviations.
    count = bins.shape[1]
    assert (abs(bins.mean(axis=1)) < 4.5 / np.sqrt(count) + 0.015).all()
    assert (abs(bins.std(axis=1) - 1) < 4.5 / np.sqrt(2 * count) + 0.003).all()


def test_a_disparity_of_zero_or_less_is_no_reading():
    # A disparity of 0.05 px with a deviation of 0.08: 0.334 of the draws come out below
    # half a step, 1/64 px.
    sample = readings(StereoDisparity(525.0), SCALE / 0.05)
    missing = sample == 0
    assert abs(missing.mean() - 0.334) < 4.5 * np.sqrt(0.334 * 0.666 / sample.size)
    assert (sample[~missing] > 0).all()
    assert np.isfinite(sample).all()


def test_sigma_grows_with_the_square_of_the_depth(dtype):
    noise = StereoDisparity(525.0, step=0.12**0.5, deviation=0.1)
    sigma = sigma_of(noise, [0.5, 1.0, 2.0], 0.3)
    # sqrt(0.1^2 + 0.12 / 12) = 0.1 sqrt(2).
    expected = 0.02**0.5 * np.array([0.25, 1.0, 4.0]) / SCALE
    np.testing.assert_allclose(sigma, expected, rtol=eps(dtype, 8))


def test_interval_holds_the_surfaces_that_round_to_a_reading(dtype):
    depth = np.linspace(0.3, 8.0, 5000)
    reading = SCALE / (np.rint(SCALE / depth * 32) / 32)
    lower, upper = interval(StereoDisparity(525.0), reading.astype(dtype))
    slack = eps(dtype, 8) * depth
    assert (lower <= depth + slack).all()
    assert (depth <= upper + slack).all()
    # To first order a step is step z^2 / (f B) wide; the bounds' rounding, in steps.
    steps = 32 * SCALE / reading
    width = np.asarray(upper - lower, float) / reading * steps
    assert (abs(width - 1) < 1 / steps**2 + eps(dtype, 4) * steps).all()


def test_intervals_of_neighboring_steps_meet(dtype):
    reading = (SCALE * 32 / np.arange(1, 400)).astype(dtype)
    lower, upper = interval(StereoDisparity(525.0), reading)
    np.testing.assert_allclose(lower[:-1], upper[1:], rtol=eps(dtype, 4))
    assert (lower < reading).all()
    assert (reading < upper).all()


@pytest.mark.parametrize(
    ("step", "reading", "expected"),
    [
        pytest.param(0.5, 0.0, (0, np.inf), id="no reading"),
        pytest.param(0.5, -1.0, (0, np.inf), id="negative"),
        pytest.param(0.5, np.nan, (0, np.inf), id="NaN"),
        pytest.param(0.5, np.inf, (SCALE / 0.25, np.inf), id="beyond the last step"),
        pytest.param(0.5, 2 * SCALE, (SCALE / 0.75, SCALE / 0.25), id="last step"),
        pytest.param(0.0, 0.9, (0.9, 0.9), id="no steps"),
        pytest.param(0.0, np.inf, (np.inf, np.inf), id="no steps, nothing"),
    ],
)
def test_interval_at_the_ends(step, reading, expected, dtype):
    noise = StereoDisparity(525.0, step=step)
    found = interval(noise, np.asarray(reading, dtype))
    np.testing.assert_allclose(found, expected, rtol=eps(dtype, 4))


def test_the_bounds_of_a_step_do_not_move(dtype):
    at = np.array([-1, 0, 0.9, 30, np.inf], dtype)
    _, slopes = jax.jvp(
        lambda z: _interval(StereoDisparity(525.0), z), (at,), (np.ones_like(at),)
    )
    np.testing.assert_array_equal(slopes, np.zeros((2, 5)))
