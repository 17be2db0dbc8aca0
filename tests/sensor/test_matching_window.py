import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.numerics import eps
from tests.sensor.scenes import SHAPE, bands, readings

# An error of 1e-9 m at 1 m, less than what single precision resolves, and no steps.
STILL = ij.StereoDisparity(500.0, baseline=0.1, deviation=5e-8, step=0)
TOLERANCE = eps(np.float32, 8)
SLOPE = 0.001


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_readings_lean_at_a_jump_only(axis, scale):
    # A window of 2 pixels on each side; the far half begins in the middle.
    sensor = ij.MatchingWindow(STILL, half_window=2 / scale, native_scale=scale)
    index = np.indices(SHAPE)[axis]
    depth = bands([0.8, 1.2], axis) + SLOPE * index
    found = readings(sensor, depth)[0] - depth
    edge = SHAPE[axis] // 2
    # Of a whole window the mean is its middle's; a part has its own middle.
    leaning = np.zeros(SHAPE[axis])
    for place in (0, edge):
        leaning[place : place + 2] = 1, 0.5
    for place in (edge, SHAPE[axis]):
        leaning[place - 2 : place] = -0.5, -1
    wanted = np.expand_dims(SLOPE * leaning, 1 - axis)
    np.testing.assert_allclose(found, wanted + 0 * depth, atol=2 * TOLERANCE)


def test_a_whole_window_reads_its_middle():
    sensor = ij.MatchingWindow(STILL, half_window=2)
    row, col = np.indices(SHAPE) - 20
    bulge = 1 + 1e-4 * (row**2 + col**2)
    inner = np.s_[2:-2, 2:-2]
    found = readings(sensor, bulge)[0]
    np.testing.assert_allclose(found[inner], bulge[inner], rtol=TOLERANCE)


def test_nothing_is_read_where_nothing_is_hit():
    depth = bands([0.8, np.inf], 1)
    found = readings(ij.MatchingWindow(STILL), depth)
    np.testing.assert_allclose(found[0], depth, rtol=TOLERANCE)


@pytest.mark.parametrize(
    ("sensor", "reach"),
    [
        (STILL, 0),
        (ij.MatchingWindow(STILL), 5),
        (ij.MatchingWindow(STILL, native_scale=1.88), 9),
        (ij.Dropout(ij.FlyingPixels(ij.MatchingWindow(STILL, half_window=2))), 2),
        (ij.MatchingWindow(ij.MatchingWindow(STILL, 2), 3), 5),
    ],
)
def test_a_sensor_says_how_far_its_readings_lean(sensor, reach):
    assert sensor.bias.window_reach == reach
