import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.fit.robust import KERNELS, robust_residual

# The losses as their authors write them, 2 rho or rho scaled to r^2 near 0.
LOSSES = {
    "pseudo_huber": lambda r, w: 2 * w**2 * (np.sqrt(1 + (r / w) ** 2) - 1),
    "cauchy": lambda r, w: w**2 * np.log1p((r / w) ** 2),
    "geman_mcclure": lambda r, w: r**2 / (1 + (r / w) ** 2),
    "squares": lambda r, w: r**2,
}


@pytest.mark.parametrize("kernel", KERNELS)
def test_square_is_the_loss_and_the_derivative_at_zero_is_one(kernel, dtype):
    r = jnp.asarray([-30.0, -1.0, 0.0, 1e-4, 2.0, 1e6], dtype)
    found = np.asarray(robust_residual(r, 2.0, kernel), float)
    expected = LOSSES[kernel](np.asarray(r, float), 2.0)
    # The cancellation near 0 is in the reference.
    np.testing.assert_allclose(found**2, expected, rtol=1e-5, atol=1e-14)
    slope = jax.grad(lambda r: robust_residual(r, 2.0, kernel))(jnp.zeros((), dtype))
    assert float(slope) == 1


@pytest.mark.parametrize("kernel", KERNELS)
def test_width_costs_less_than_5_percent_of_the_efficiency(kernel):
    # Variance of the location M-estimator on normal noise, E psi^2 / (E psi')^2.
    _, width = KERNELS[kernel]
    r = np.linspace(-8, 8, 4001)
    density = np.exp(-(r**2) / 2) / np.sqrt(2 * np.pi) * (r[1] - r[0])
    psi = np.gradient(LOSSES[kernel](r, width), r) / 2
    variance = np.sum(density * psi**2) / np.sum(density * np.gradient(psi, r)) ** 2
    # The slopes are differences, good to 1e-5.
    assert 1 - 1e-5 <= variance < 1.05
