import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.fit import uncertainty
from impostor_jax.fit.gather import lattice_of
from tests.groups import FULL

covariance_root = jax.jit(uncertainty.covariance_root)


@jax.jit
def score_covariance(gradient, residual, lattice):
    """Of one fit, with another's residuals beside it."""
    several = jnp.stack([residual, 2 * residual])
    found, of_other = uncertainty.score_covariance(gradient, several, lattice)
    return (found + of_other / 4) / 2


propagated = jax.jit(uncertainty.propagated)


def random_jacobian(dtype=np.float64, columns=7):
    values = np.random.default_rng(0).normal(size=(200, columns))
    return jnp.asarray(values, dtype)


@pytest.mark.usefixtures("double")
def test_covariance_is_the_inverse_of_the_information():
    jacobian = random_jacobian()
    root, _, free = covariance_root(jacobian.T @ jacobian)
    expected = np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(root @ root.T, expected, rtol=1e-9)
    assert not np.asarray(free).any()


def test_coordinate_without_effect_is_free_and_the_others_are_not(dtype):
    jacobian = random_jacobian(dtype).at[:, 6].set(0)
    root, directions, free = covariance_root(jacobian.T @ jacobian)
    assert np.asarray(free).sum() == 1
    found, observed = propagated(jnp.eye(7, dtype=dtype), root, directions, free)
    assert np.asarray(observed).tolist() == [True] * 6 + [False]
    expected = np.linalg.inv(np.asarray(jacobian[:, :6].T @ jacobian[:, :6], float))
    np.testing.assert_allclose(found[:6, :6], expected, rtol=1e-3)


def test_what_a_free_coordinate_moves_by_a_little_is_free_too(dtype):
    # A place across a pole that leans: a ten-thousandth of the place along it.
    jacobian = random_jacobian(dtype, 4).at[:, 2:].set(0)
    change = jnp.asarray([[1, 0, 1e-4, 0], [0, 1, 0, 0], [1, 1, 1e-8, 1e-8]], dtype)
    change = change.at[2, 2:].multiply(jnp.finfo(dtype).eps / 1e-7)
    _, observed = propagated(change, *covariance_root(jacobian.T @ jacobian))
    assert np.asarray(observed).tolist() == [False, True, True]


def test_only_the_sum_of_two_coordinates_is_determined(dtype):
    jacobian = random_jacobian(dtype, 2)
    jacobian = jacobian.at[:, 1].set(jacobian[:, 0])
    change = jnp.asarray([[1.0, 0], [0, 1], [1, 1], [1, -1]], dtype)
    _, observed = propagated(change, *covariance_root(jacobian.T @ jacobian))
    assert np.asarray(observed).tolist() == [False, False, True, False]


def test_a_sandwich_has_no_negative_variance():
    rng = np.random.default_rng(0)
    # What is hardly told, and correlations that no errors have.
    jacobian = rng.normal(size=(200, 3)) @ [[1, 1, 1], [0, 0.03, 0], [0, 0, 0.1]]
    jacobian = jnp.asarray(jacobian, jnp.float32)
    root, directions, free = covariance_root(jacobian.T @ jacobian)
    middle = jnp.asarray(np.diag([1, 2, 3]) - 3 * np.ones((3, 3)), jnp.float32)
    whole = uncertainty.sandwich_root(root, middle, 0.25)
    found, observed = propagated(jnp.eye(3), whole, directions, free)
    assert np.asarray(observed).all()
    floor = 0.25 * np.asarray(root @ root.T)
    assert (np.diagonal(found) >= 0.99 * np.diagonal(floor)).all()
    np.testing.assert_allclose(found, found.T, rtol=1e-5)


def pixels_of(shape):
    row, col = (x.ravel() for x in np.mgrid[0 : shape[0], 0 : shape[1]])
    return row, col


def correlated_noise(shape, rng):
    white = rng.normal(size=(shape[0] + 2, shape[1] + 2))
    windows = np.lib.stride_tricks.sliding_window_view(white, (3, 3))
    return windows.sum(axis=(2, 3)) / 3


@FULL
@pytest.mark.parametrize("correlated", [False, True])
def test_score_covariance_is_that_of_repeated_draws(correlated):
    shape = (40, 50)
    row, col = pixels_of(shape)
    x, y = col / 50 - 0.5, row / 40 - 0.5
    gradient = np.stack([np.ones_like(x), x, y], axis=1)
    rng = np.random.default_rng(0)
    draws = [
        correlated_noise(shape, rng) if correlated else rng.normal(size=shape)
        for _ in range(400)
    ]
    scores = np.stack([gradient.T @ draw.ravel() for draw in draws])
    fitted = gradient @ np.linalg.pinv(gradient)
    found = [
        np.asarray(
            score_covariance(
                jnp.asarray(gradient, jnp.float32),
                jnp.asarray(draw.ravel() - fitted @ draw.ravel(), jnp.float32),
                lattice_of(row, col, shape),
            )
        )
        for draw in draws[:8]
    ]
    ratio = np.diag(np.mean(found, axis=0)) / np.mean(scores**2, axis=0)
    # 400 draws are good to 7 percent, the mean of eight estimates to 10.
    assert (ratio > 0.75).all()
    assert (ratio < 1.3).all()


def test_a_pixel_beyond_the_image_does_not_count():
    row, col = np.array([0, 0, 9]), np.array([0, 1, 0])
    gradient, residual = jnp.ones((3, 1)), jnp.asarray([1.0, 1, 0])
    all_three, first_two = (lattice_of(row[:n], col[:n], (3, 3)) for n in (3, 2))
    with_it = score_covariance(gradient, residual, all_three)
    without = score_covariance(gradient[:2], residual[:2], first_two)
    # Its gradient is that of a term that does not count.
    np.testing.assert_allclose(
        score_covariance(gradient.at[2].set(0), residual, all_three), without
    )
    assert float(with_it[0, 0]) >= float(without[0, 0])


def test_pixels_of_one_row_are_no_neighbors_of_the_next_row():
    # The last columns of a row, and the first of the one below: 29 columns apart.
    gradient, residual = jnp.ones((4, 1)), jnp.ones(4)
    row, col = np.array([0, 0, 1, 1]), np.array([28, 29, 0, 1])
    found = score_covariance(gradient, residual, lattice_of(row, col, (2, 30)))
    far = score_covariance(gradient, residual, lattice_of(20 * row, col, (21, 30)))
    np.testing.assert_allclose(found, far, rtol=1e-6)


def over_pairs(gradient, residual, row, col):
    """The same in double precision, pair by pair."""
    down, right = (np.subtract.outer(at, at) for at in (row, col))
    longest = uncertainty.MAX_LAG - 1
    window = np.exp(-(down**2 + right**2) / uncertainty.WINDOW**2 / 2)
    weight, counts = np.zeros(down.shape), residual != 0
    near = (np.abs(down) <= longest) & (np.abs(right) <= longest)
    for lag in np.unique(np.stack([down[near], right[near]]), axis=1).T:
        pairs = (down == lag[0]) & (right == lag[1])
        count = np.sum(pairs & counts[:, None] & counts)
        of_lag = np.sum(pairs * np.outer(residual, residual)) / max(count, 1)
        weight[pairs] = of_lag * window[pairs]
    lags = np.arange(-longest, longest + 1)
    pixels = np.sum(np.exp(-(lags**2) / uncertainty.WINDOW**2 / 2)) ** 2
    taken = min(gradient.shape[1] * pixels / np.sum(counts), uncertainty.MOST_TAKEN)
    return gradient.T @ weight @ gradient / (1 - taken)


@pytest.mark.parametrize("shape", [(3, 20), (20, 3), (17, 26)])
@pytest.mark.parametrize("step", [1, 40])
def test_score_covariance_is_the_sum_over_all_pairs(shape, step):
    # Of pixels far from each other it is found in another way.
    rng = np.random.default_rng(0)
    row, col = pixels_of(shape)
    own = rng.random(len(row)) < 0.8
    row, col = row[own], step * col[own]
    gradient = rng.normal([2, 0, 0], size=(len(row), 3))
    residual = rng.normal(size=len(row)) + 0.5
    residual[::7], gradient[::7] = 0, 0
    arrays = (jnp.asarray(x, jnp.float32) for x in (gradient, residual))
    lattice = lattice_of(row, col, (shape[0], step * shape[1]))
    expected = over_pairs(gradient, residual, row, col)
    sizes = np.sqrt(np.abs(np.outer(np.diag(expected), np.diag(expected))))
    found = score_covariance(*arrays, lattice)
    assert (np.abs(found - expected) <= 1e-5 * sizes).all()


def test_a_lattice_is_the_same_for_pixels_that_only_the_run_knows():
    row, col = pixels_of((5, 7))
    row, col = row[::2] + 3, col[::2] + 1
    residual = jnp.asarray(np.random.default_rng(0).normal(size=len(row)), float)
    gradient = jnp.stack([residual**2, jnp.ones_like(residual)], axis=1)
    of_host = lattice_of(row, col, (12, 9))
    of_run = jax.jit(lambda r, c: lattice_of(r, c, (12, 9), jnp))(row, col)
    np.testing.assert_allclose(
        score_covariance(gradient, residual, of_host),
        score_covariance(gradient, residual, of_run),
        rtol=1e-5,
    )
