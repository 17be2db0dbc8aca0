import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.numerics import safe_divide, safe_norm, safe_sqrt


@pytest.mark.parametrize("x", [-1.0, 0.0, np.nan])
def test_root_of_what_is_not_positive_is_zero_with_zero_derivative(x, dtype):
    value, slope = jax.value_and_grad(safe_sqrt)(jnp.asarray(x, dtype))
    assert (float(value), float(slope)) == (0.0, 0.0)


def test_root_and_derivative_of_a_positive_number(dtype):
    value, slope = jax.value_and_grad(safe_sqrt)(jnp.asarray(4.0, dtype))
    assert (float(value), float(slope)) == (2.0, 0.25)


def test_quotient_by_zero_is_zero_with_zero_derivatives(dtype):
    one, zero = jnp.ones((), dtype), jnp.zeros((), dtype)
    value, slopes = jax.value_and_grad(safe_divide, (0, 1))(one, zero)
    assert float(value) == 0
    assert [float(s) for s in slopes] == [0.0, 0.0]


def test_length_of_the_zero_vector_has_zero_derivative(dtype):
    slope = jax.grad(safe_norm)(jnp.zeros(3, dtype))
    np.testing.assert_array_equal(slope, 0)
