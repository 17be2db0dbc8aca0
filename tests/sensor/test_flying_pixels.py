import numpy as np
import pytest

from impostor_jax.numerics import eps
from impostor_jax.sensor.flying_pixels import FlyingPixels
from impostor_jax.sensor.quantization import StereoDisparity
from tests.sensor.scenes import SHAPE, bands, readings

# An error of 1e-9 m at 1 m, less than what single precision resolves, and no steps.
STILL = StereoDisparity(500.0, baseline=0.1, deviation=5e-8, step=0)
NEAR, FAR = 0.8, 1.2
# A depth and its disparity are each rounded.
TOLERANCE = eps(np.float32, 4)


@pytest.mark.parametrize("axis", [0, 1])
def test_readings_mix_both_sides_at_a_jump_only(axis):
    depth = bands([NEAR, FAR], axis)
    sample = readings(FlyingPixels(STILL, probability=0.3), depth)
    own = np.isclose(sample, depth[None], rtol=TOLERANCE, atol=0)
    sample, own = (np.moveaxis(image, axis - 2, 0) for image in (sample, own))
    edge = SHAPE[axis] // 2
    assert own[: edge - 1].all()
    assert own[edge + 1 :].all()
    for line in (edge - 1, edge):
        # 4.5 standard errors of 768 draws or more.
        flies = ~own[line]
        assert abs(flies.mean() - 0.3) < 4.5 * np.sqrt(0.3 * 0.7 / flies.size)
        share = (sample[line][flies] - NEAR) / (FAR - NEAR)
        assert share.min() > 0
        assert share.max() < 1
        # Uniform: a mean of 1/2 and a variance of 1/12, whose own is 1/180 / n.
        assert abs(share.mean() - 0.5) < 4.5 / np.sqrt(12 * share.size)
        assert abs(share.var() - 1 / 12) < 4.5 / np.sqrt(180 * share.size)


@pytest.mark.parametrize(
    ("depths", "jump"),
    [
        pytest.param([1.0, 1.02], 0.03, id="a step, no jump"),
        pytest.param([1.0, np.inf], 0.03, id="nothing to mix with"),
        pytest.param([1.0, 1.5], 0.6, id="a larger jump asked for"),
        pytest.param([4.0, 4.1], 0.03, id="the jump is a fraction of the depth"),
    ],
)
def test_other_edges_are_read_as_they_are(depths, jump):
    depth = bands(depths, 1)
    sample = readings(FlyingPixels(STILL, 1, jump), depth)
    np.testing.assert_allclose(sample[0], depth, rtol=TOLERANCE)


@pytest.mark.parametrize(("probability", "share"), [(0, 0.0), (1, 1.0)])
def test_all_or_nothing(probability, share):
    depth = bands([NEAR, FAR], 1)
    sample = readings(FlyingPixels(STILL, probability), depth)
    flies = ~np.isclose(sample, depth[None], rtol=TOLERANCE, atol=0)
    # Once in 10,000 draws the weight leaves less than the tolerance.
    assert abs(flies[..., SHAPE[1] // 2].mean() - share) < 0.01


def test_a_pixel_mixes_with_the_neighbor_that_differs_most():
    # Pixels with jumps of 0.1, 0.2, 0.3 and 0.4 m around them.
    depth = np.full(SHAPE, 1.0)
    row, col = (index.ravel() for index in np.mgrid[4:44:4, 4:60:4])
    depth[row, col - 1], depth[row, col + 1] = 1.1, 1.2
    depth[row - 1, col], depth[row + 1, col] = 1.3, 1.4
    sample = readings(FlyingPixels(STILL, 1), depth)[:, row, col]
    assert sample.min() > 1 - 1e-6
    # Uniform up to the largest, and 4.5 standard errors of 2240 draws.
    assert abs(sample.mean() - 1.2) < 4.5 * 0.4 / np.sqrt(12 * sample.size)
    assert 1.39 < sample.max() < 1.4 + 1e-6


def test_the_sensor_reads_the_mixture_with_its_own_steps():
    sample = readings(FlyingPixels(StereoDisparity(525.0), 1), bands([NEAR, FAR], 1))
    steps = 525.0 * 0.05 * 32 / sample.astype(float)
    np.testing.assert_allclose(steps, np.rint(steps), rtol=TOLERANCE)
