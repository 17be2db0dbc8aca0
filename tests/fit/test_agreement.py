import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from impostor_jax.fit.agreement import contradiction, reduced_chi2, strays, tail

ROWS, COORDINATES = 400, 5
IS_PART = np.arange(ROWS) < 80


def contradictions(shift, offset, count=200):
    """Statistics of linear fits with noise, of estimates away from the minimum."""
    rng = np.random.default_rng(0)
    jacobian = rng.normal(size=(COORDINATES, ROWS))
    covariance = np.linalg.inv(jacobian @ jacobian.T)
    noise = rng.normal(size=(count, ROWS)) + shift * IS_PART * jacobian[0]
    fitted = noise - (noise @ jacobian.T @ covariance + offset) @ jacobian
    pulls = fitted @ jacobian.T
    parts = np.stack([products(jacobian, one) for one in fitted])
    run = jax.jit(jax.vmap(contradiction, in_axes=(0, 0, None)))
    return np.asarray(run(*map(jnp.asarray, (parts, pulls, covariance))))


def products(jacobian, residual, is_part=IS_PART):
    """Products of the part's terms of Jacobian and residual."""
    terms = np.concatenate([jacobian, residual[None]]) * is_part
    return terms @ terms.T


@pytest.mark.parametrize("offset", [0.0, 0.1], ids=["at the minimum", "beside it"])
def test_a_part_that_agrees_contradicts_by_chi_squared(offset):
    # An estimate two deviations from its minimum must not look like a contradiction.
    found = contradictions(shift=0.0, offset=offset)
    assert stats.kstest(found, stats.chi2(COORDINATES).cdf).pvalue > 1e-3


def test_a_part_of_something_else_contradicts():
    assert np.median(contradictions(shift=1.0, offset=0.0)) > 20


def test_rows_that_are_all_of_the_part_contradict_nothing():
    jacobian = np.random.default_rng(0).normal(size=(2, 50))
    covariance = np.linalg.inv(jacobian @ jacobian.T)
    part = products(jacobian, np.ones(50), is_part=1)
    given = map(jnp.asarray, (part, jacobian @ np.ones(50), covariance))
    assert float(contradiction(*given)) == 0


@pytest.mark.parametrize("chi2", [0.9, 0.97, 1.0, 1.03, 1.2])
def test_tail_is_that_of_chi_squared(chi2):
    found = tail(jnp.asarray(chi2), jnp.asarray(3000.0))
    assert float(found) == pytest.approx(stats.chi2(3000).sf(3000 * chi2), abs=1e-3)


def test_chi_squared_of_normal_residuals_within_three_deviations_is_one():
    draws = np.random.default_rng(0).normal(size=200000)
    within = draws[np.abs(draws) < 3]
    found = reduced_chi2(jnp.asarray(np.sum(within**2)), jnp.asarray(1.0 * len(within)))
    assert float(found) == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize(
    ("at_border", "within", "expected"),
    [(0.0, 0.0, False), (0.2, 0.0, True), (0.2, 0.1, False), (0.1, 0.1, False)],
)
def test_outliers_all_over_are_no_sign_of_a_border(at_border, within, expected):
    beside = np.arange(1000) < 300
    off = np.arange(1000) % 10 < 10 * np.where(beside, at_border, within)
    used = jnp.ones(1000, bool)
    found = strays(jnp.asarray(~off), used, jnp.asarray(beside, float))
    assert bool(found) is expected
