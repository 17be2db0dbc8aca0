import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from impostor_jax.fit.between_views import disagreement, moved_by_views
from tests.fit.test_agreement import COORDINATES, ROWS, products


def between(move, noise=1.0, count=200):
    """Statistics of linear fits to three views, of which one says something else."""
    rng = np.random.default_rng(1)
    jacobian = rng.normal(size=(3, COORDINATES, ROWS))
    # The last tells a hundredth of what the others do.
    jacobian[2] /= 10
    covariance = np.linalg.inv(np.einsum("vik,vjk->ij", jacobian, jacobian))
    root = jnp.asarray(np.linalg.cholesky(covariance))
    moved = np.zeros((3, COORDINATES))
    moved[1, 0] = move * np.sqrt(covariance[0, 0])
    found = []
    for _ in range(count):
        data = noise * rng.normal(size=(3, ROWS))
        data += np.einsum("vik,vi->vk", jacobian, moved)
        estimate = covariance @ np.einsum("vik,vk->i", jacobian, data)
        left = data - np.einsum("vik,i->vk", jacobian, estimate)
        parts = [
            jnp.asarray(products(a, one, True))
            for a, one in zip(jacobian, left, strict=True)
        ]
        given = jnp.zeros(COORDINATES), jnp.ones(()), root
        found.append(float(disagreement(moved_by_views(parts, *given))))
    return np.array(found)


def test_views_of_one_object_agree():
    # A view with half of the information moves the estimate by half a deviation.
    found = between(0.0)
    assert found.max() < stats.chi2(COORDINATES).isf(1e-5)
    assert np.mean(found) > COORDINATES / 2


def test_a_view_of_something_else_moves_the_estimate():
    # It is twenty deviations away. The estimate goes half of that way, and half of what
    # is left is what it pulls by: 4 * 5^2, beside what noise does.
    assert np.median(between(20.0)) == pytest.approx(100, rel=0.1)
