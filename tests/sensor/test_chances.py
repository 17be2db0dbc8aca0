"""Numbers by which sensors decide: cheap, independent and uniform."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.sensor.base import chances


@pytest.mark.parametrize("shape", [(300, 401), (5, 1), (2, 2)])
def test_there_is_a_multiple_of_2_to_the_minus_16_for_each_depth(shape, dtype):
    values = np.asarray(chances(jax.random.key(0), jnp.ones(shape)), np.float64)
    assert values.shape == shape
    np.testing.assert_array_equal(values * 2**16, np.round(values * 2**16))
    assert 0 <= values.min() <= values.max() < 1


def test_they_are_uniform_and_the_halves_of_a_draw_independent():
    values = np.asarray(chances(jax.random.key(1), jnp.ones((500, 400))), np.float64)
    counts, _ = np.histogram(values, 64, (0, 1))
    expected = values.size / 64
    # Chi-squared of 63 degrees of freedom: below 120 but for one in 1e5.
    assert ((counts - expected) ** 2 / expected).sum() < 120
    left, right = values[:, :200], values[:, 200:]
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 4 / np.sqrt(1e5)
