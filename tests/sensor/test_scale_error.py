import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.sensor.scale_error import corrected
from tests.sensor.scenes import bands, readings

STILL = ij.ConstantNoise(1e-7)
DEPTH = bands([0.8, 1.6], 1)


@pytest.mark.parametrize(
    ("law", "wanted"),
    [("scale", DEPTH * 1.03), ("disparity", 1 / (1 / DEPTH + 0.03))],
)
def test_depths_are_off_by_the_mean_and_a_correction_takes_that_off(law, wanted):
    sensor = ij.ScaleError(STILL, deviation=0, mean=0.03, law=law)
    found = readings(sensor, DEPTH)[0]
    np.testing.assert_allclose(found, wanted, rtol=1e-5)
    straight, left = corrected(np.float32(found), sensor)
    np.testing.assert_allclose(straight, DEPTH, rtol=1e-5)
    again, _ = corrected(straight, left)
    np.testing.assert_array_equal(again, straight)


def test_parts_are_undone_in_the_order_in_which_they_read():
    inner = ij.ScaleError(STILL, 0, 0.05, "disparity")
    sensor = ij.Dropout(ij.ScaleError(inner, 0, 0.1), rate=0)
    found = readings(sensor, DEPTH)[0]
    straight, left = corrected(np.float32(found), sensor)
    np.testing.assert_allclose(straight, DEPTH, rtol=1e-5)
    assert [float(law.mean) for law in left.bias.scales] == [0, 0]


@pytest.mark.parametrize("law", ["scale", "disparity"])
def test_an_image_has_one_error_of_the_deviation_that_is_said(law):
    sensor = ij.ScaleError(STILL, 0.02, law=law)
    found = np.concatenate([readings(sensor, DEPTH, seed=seed) for seed in range(25)])
    error = found / DEPTH - 1 if law == "scale" else 1 / found - 1 / DEPTH
    assert np.ptp(error, axis=(1, 2)).max() < 1e-5
    # Four standard errors of a standard deviation.
    assert error[:, 0, 0].std() == pytest.approx(0.02, rel=4 / np.sqrt(2 * len(found)))


def test_bad_values_are_named():
    with pytest.raises(ValueError, match="law must be one of"):
        ij.ScaleError(STILL, law="offset")
    with pytest.raises(ValueError, match="deviation must be 0 or positive"):
        ij.ScaleError(STILL, deviation=-1)
