"""Random numbers that sensors draw: independent, and of the law that they promise."""

import functools

import jax
import numpy as np
import pytest
from scipy import stats

from impostor_jax.sensor.draws import STRIP, chances, normal_draws
from tests.groups import FULL

DRAWS = {"chances": chances, "normals": normal_draws}


@functools.cache
def drawn(name, shape=(1000, 401), seed=1, impl=None):
    key = jax.random.key(seed, impl=impl)
    return np.asarray(DRAWS[name](key, shape, np.float32), np.float64)


@FULL
@pytest.mark.parametrize("shape", [(300, 401), (5, 1), (STRIP, 2), (STRIP + 1, 3)])
@pytest.mark.parametrize("name", list(DRAWS))
def test_there_is_one_for_each_pixel(name, shape, dtype):
    values = DRAWS[name](jax.random.key(0), shape, dtype)
    assert values.shape == shape
    assert values.dtype == dtype
    # Two of 23 bits are equal now and then, of 16 often.
    assert np.unique(values).size > 0.15 * values.size


def test_chances_are_multiples_of_2_to_the_minus_16_below_1():
    values = drawn("chances")
    np.testing.assert_array_equal(values * 2**16, np.round(values * 2**16))
    assert values.min() == 0
    assert values.max() == 1 - 2.0**-16


@pytest.mark.parametrize(
    ("name", "law"),
    # Of a chance the middle of its part of [0, 1).
    [("chances", stats.uniform(-(2.0**-17), 1)), ("normals", stats.norm())],
)
@pytest.mark.parametrize("impl", ["threefry2x32", "rbg"])
def test_they_follow_their_law(name, law, impl):
    values = drawn(name, impl=impl).ravel()
    assert stats.kstest(values, law.cdf).pvalue > 1e-3
    # The tails, which that test hardly sees: counts beyond 1 in 1000 on either side.
    for side in (values < law.ppf(1e-3), values > law.ppf(1 - 1e-3)):
        expected = 1e-3 * values.size
        assert abs(np.count_nonzero(side) - expected) < 4 * np.sqrt(expected)


@pytest.mark.parametrize("name", list(DRAWS))
def test_neighbors_and_parts_of_a_word_and_keys_are_independent(name):
    values = drawn(name, (20 * STRIP, 401))
    strips = values.reshape(20, STRIP, 401)
    pairs = [(values[:, 1:], values[:, :-1]), (values, drawn(name, values.shape, 2))]
    pairs += [
        (strips[:, step:], strips[:, :-step])
        for step in (1, STRIP // 4, STRIP // 2, STRIP * 3 // 4)
    ]
    pairs.append((strips[1:], strips[:-1]))
    for first, second in pairs:
        correlation = np.corrcoef(first.ravel(), second.ravel())[0, 1]
        assert abs(correlation) < 4 / np.sqrt(first.size)
