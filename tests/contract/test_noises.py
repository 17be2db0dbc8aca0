"""What every noise model promises."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.cases import CAMERAS, NOISES


@pytest.fixture(params=NOISES)
def noise(request, dtype):
    return NOISES[request.param]()


def plane(camera, dtype):
    """A wall that faces the camera, with a hole."""
    depth = jnp.full((camera.height, camera.width), 0.9, dtype)
    depth = depth.at[:4].set(jnp.inf)
    normal = jnp.zeros((*depth.shape, 3), dtype).at[..., 2].set(-1)
    return depth, normal


def test_samples_scatter_as_sigma_says(noise, dtype):
    camera = CAMERAS["pinhole"]()
    depth, normal = plane(camera, dtype)
    sample = noise.sample(jax.random.key(1), depth, normal, camera)
    hit = np.isfinite(np.asarray(depth))
    sigma = np.asarray(noise.sigma(depth, jnp.ones_like(depth)))
    score = (np.asarray(sample)[hit] - np.asarray(depth)[hit]) / sigma[hit]
    # Four standard errors of a mean and of a standard deviation of 2816 draws.
    assert abs(score.mean()) < 4 / np.sqrt(score.size)
    assert abs(score.std() - 1) < 4 / np.sqrt(2 * score.size)


def test_no_surface_gives_no_reading_and_no_weight(noise, dtype):
    camera = CAMERAS["pinhole"]()
    depth, normal = plane(camera, dtype)
    sample = noise.sample(jax.random.key(1), depth, normal, camera)
    sigma = noise.sigma(depth, jnp.ones_like(depth))
    assert np.isposinf(np.asarray(sample)[:4]).all()
    assert np.isposinf(np.asarray(sigma)[:4]).all()
    assert sample.dtype == dtype


def test_a_key_gives_the_same_image_again(noise, dtype):
    camera = CAMERAS["pinhole"]()
    scene = plane(camera, dtype)
    first, again = (noise.sample(jax.random.key(2), *scene, camera) for _ in range(2))
    np.testing.assert_array_equal(first, again)
