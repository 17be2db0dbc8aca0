import jax
import numpy as np
import pytest

from impostor_jax.numerics import eps
from impostor_jax.sensor.dropout import Dropout
from impostor_jax.sensor.gaussian import ConstantNoise
from impostor_jax.sensor.lateral import LateralNoise
from tests.checks import QUICKLY
from tests.sensor.scenes import COUNT, SHAPE, bands, readings


@jax.jit(compiler_options=QUICKLY)
def probability_at(noise, cosine):
    return noise.probability(cosine)


SENSOR = ConstantNoise(0.002)


def test_share_of_missing_readings_is_that_of_the_law():
    degrees = (0, 60, 80, 88)
    noise = Dropout(SENSOR, rate=0.1)
    sample = readings(noise, 1.0, np.radians(bands(degrees, 0)))
    missing = (sample == 0).reshape(COUNT, 4, 12, -1).mean(axis=(0, 2, 3))
    cosine = np.cos(np.radians(degrees)).astype(np.float32)
    expected = np.asarray(probability_at(noise, cosine))
    # 4.5 standard errors of 12288 draws.
    spread = np.sqrt(expected * (1 - expected) / (sample.size / 4))
    assert (abs(missing - expected) < 4.5 * spread).all()
    # What is there is read by the sensor: six deviations of its noise.
    assert (abs(sample[sample != 0] - 1) < 6 * 0.002).all()


def test_probability_rises_from_the_rate_to_one(dtype):
    noise = Dropout(SENSOR, rate=0.2, cutoff=np.radians(60))
    cosine = np.linspace(0, 1, 101, dtype=dtype)
    probability = np.asarray(probability_at(noise, cosine))
    assert probability[0] == 1
    assert (np.diff(probability) <= eps(dtype, 2)).all()
    np.testing.assert_allclose(probability[50:], 0.2, rtol=eps(dtype, 16))
    # Halfway in the cosine it is halfway between both.
    assert float(probability[25]) == pytest.approx(0.6, rel=eps(dtype, 16))


@pytest.mark.parametrize(("rate", "share"), [(0, 0.0), (1, 1.0)])
def test_all_or_nothing(rate, share):
    sample = readings(Dropout(SENSOR, rate), 1.0, 0.1)
    assert (sample == 0).mean() == share


def test_nothing_hit_is_not_a_missing_reading():
    assert np.isposinf(readings(Dropout(SENSOR, 1), np.inf)).all()


def test_what_a_shifted_pixel_reads_beside_an_object_is_kept():
    # Its own ray hits nothing: an incidence of 90 degrees would drop it for sure.
    sample = readings(Dropout(LateralNoise(SENSOR), rate=0), bands([1.0, np.inf], 1))
    assert np.isfinite(sample[..., SHAPE[1] // 2]).any()
    assert not (sample == 0).any()
