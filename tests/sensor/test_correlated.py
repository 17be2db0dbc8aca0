import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from tests.groups import FULL
from tests.sensor.scenes import SHAPE, readings

DEPTH = np.full(SHAPE, 2.0)


def errors(length, seeds, power=1.0):
    """Images of a smooth error of 1 mm at 1 m, nearly alone."""
    sensor = ij.CorrelatedNoise(ij.ConstantNoise(1e-7), 0.001, length, power)
    images = [readings(sensor, DEPTH, seed=seed) for seed in range(seeds)]
    return np.concatenate(images) - DEPTH


@pytest.mark.parametrize("length", [2.0, 10.0])
def test_errors_have_the_size_and_the_correlation_that_are_said(length):
    found = errors(length, 25) / 0.002
    # Four standard errors of an average over as many independent patches.
    patches = len(found) * max(1, found[0].size / (2 * np.pi * length**2))
    assert np.mean(found**2) == pytest.approx(1, abs=4 * np.sqrt(2 / patches))
    for away in (int(length / 2), int(length), int(2 * length)):
        wanted = np.exp(-((away / length) ** 2) / 2)
        for axis in (1, 2):
            first = np.take(found, range(found.shape[axis] - away), axis)
            last = np.take(found, range(away, found.shape[axis]), axis)
            correlation = np.mean(first * last)
            assert correlation == pytest.approx(wanted, abs=4 * np.sqrt(2 / patches))


def test_an_error_grows_with_a_power_of_the_depth():
    flat, bent = errors(5.0, 1, power=0.0), errors(5.0, 1, power=2.0)
    np.testing.assert_allclose(bent, 4 * flat, atol=5e-6)


@FULL
@pytest.mark.parametrize("length", [1.0, 4.0, 200.0])
def test_what_a_field_does_to_sums_is_the_variance_of_draws(length):
    # Of many correlation lengths a smoother field stands in.
    row, col = map(np.ravel, np.indices(SHAPE))
    u, v = (row - 24) / 24, (col - 32) / 32
    score = np.stack([np.ones_like(u), u, u * v]) / row.size
    used = (row > 4) & (col < 50)
    field = ij.CorrelatedNoise(ij.ConstantNoise(1.0), 0.001, length, 1.0).bias.fields[0]
    given = jnp.float32(score * used), jnp.float32(DEPTH.ravel()), row, col
    found = np.asarray(jax.jit(field.score_covariance)(*given))
    distance = (row[:, None] - row) ** 2 + (col[:, None] - col) ** 2
    kernel = 0.002**2 * np.exp(-distance / (2 * length**2))
    if field.is_grain:
        # `sigma` counts what each reading errs by.
        kernel -= 0.002**2 * np.eye(row.size)
    wanted = (score * used) @ kernel @ (score * used).T
    np.testing.assert_allclose(found, wanted, atol=0.06 * np.abs(wanted).max())


@pytest.mark.parametrize("length", [3.0, 30.0])
def test_a_reading_scatters_by_grain_and_not_by_a_warp(length):
    sensor = ij.CorrelatedNoise(ij.ConstantNoise(0.003), 0.002, length, power=1)
    depth = np.array([2.0, np.inf, 0.0], np.float32)
    sigma = jax.jit(sensor.sigma)(depth, np.ones_like(depth))
    wanted = 0.005 if length < 10 else 0.003
    np.testing.assert_allclose(sigma, [wanted, np.inf, np.inf], rtol=1e-6)


@pytest.mark.parametrize("lines", ["rows", "columns"])
def test_readings_of_a_line_err_alike(lines):
    sensor = ij.LineNoise(ij.ConstantNoise(1e-7), 0.001, lines, power=1)
    found = (readings(sensor, DEPTH) - DEPTH) / 0.002
    found = found if lines == "rows" else np.swapaxes(found, 1, 2)
    of_lines = found.mean(axis=2)
    np.testing.assert_allclose(
        found, of_lines[..., None] * np.ones_like(found), atol=1e-3
    )
    # Four standard errors of as many independent lines.
    assert np.mean(of_lines**2) == pytest.approx(1, abs=4 * np.sqrt(2 / of_lines.size))


@pytest.mark.parametrize("lines", ["rows", "columns"])
def test_what_lines_do_to_sums_is_the_variance_of_draws(lines):
    row, col = map(np.ravel, np.indices(SHAPE))
    score = np.stack([np.ones(row.size), row - 24.0, (row - 24) * (col - 32.0)])
    score = np.where(col < 50, score / 1e4, 0)
    field = ij.LineNoise(ij.ConstantNoise(1.0), 0.001, lines, 1.0).bias.fields[0]
    given = jnp.float32(score), jnp.float32(DEPTH.ravel()), row, col
    found = jax.jit(field.score_covariance)(*given)
    line = row if lines == "rows" else col
    kernel = 0.002**2 * ((line[:, None] == line) & ~np.eye(row.size, dtype=bool))
    wanted = score @ kernel @ score.T
    np.testing.assert_allclose(found, wanted, atol=1e-4 * np.abs(wanted).max())


def test_bad_values_are_named():
    noise = ij.ConstantNoise(0.001)
    with pytest.raises(ValueError, match="lines must be one of rows, columns; got 'x'"):
        ij.LineNoise(noise, 0.001, "x")
    with pytest.raises(ValueError, match="length must be at least 1"):
        ij.CorrelatedNoise(noise, 0.001, 0.5)
    with pytest.raises(ValueError, match="deviation must be 0 or positive"):
        ij.CorrelatedNoise(noise, -0.001, 5.0)
    with pytest.raises(ValueError, match="length must be concrete"):
        jax.jit(lambda x: ij.CorrelatedNoise(noise, 0.001, x).deviation)(5.0)


def test_a_field_is_said_to_a_fit():
    noise = ij.ConstantNoise(0.001)
    sensor = ij.FlyingPixels(
        ij.CorrelatedNoise(ij.CorrelatedNoise(noise, 0.001, 3), 0.002, 90)
    )
    assert [field.length for field in sensor.bias.fields] == [3, 90]
    assert sensor.bias.edge_reach == 1
