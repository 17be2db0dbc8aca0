import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.fit import uncertainty

covariance_root = jax.jit(uncertainty.covariance_root)
score_covariance = jax.jit(uncertainty.score_covariance, static_argnums=4)
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
    return jnp.asarray(row), jnp.asarray(col)


def correlated_noise(shape, rng):
    white = rng.normal(size=(shape[0] + 2, shape[1] + 2))
    windows = np.lib.stride_tricks.sliding_window_view(white, (3, 3))
    return windows.sum(axis=(2, 3)) / 3


@pytest.mark.parametrize("correlated", [False, True])
def test_score_covariance_is_that_of_repeated_draws(correlated):
    shape = (40, 50)
    row, col = pixels_of(shape)
    x, y = np.asarray(col) / 50 - 0.5, np.asarray(row) / 40 - 0.5
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
                row,
                col,
                shape,
            )
        )
        for draw in draws[:8]
    ]
    ratio = np.diag(np.mean(found, axis=0)) / np.mean(scores**2, axis=0)
    # 400 draws are good to 7 percent, the mean of eight estimates to 10.
    assert (ratio > 0.75).all()
    assert (ratio < 1.3).all()


def test_a_pixel_beyond_the_image_does_not_count():
    row, col = jnp.asarray([0, 0, 9]), jnp.asarray([0, 1, 0])
    gradient, residual = jnp.ones((3, 1)), jnp.asarray([1.0, 1, 0])
    with_it = score_covariance(gradient, residual, row, col, (3, 3))
    without = score_covariance(gradient[:2], residual[:2], row[:2], col[:2], (3, 3))
    # Its gradient is that of a term that does not count.
    np.testing.assert_allclose(
        score_covariance(gradient.at[2].set(0), residual, row, col, (3, 3)), without
    )
    assert float(with_it[0, 0]) >= float(without[0, 0])
