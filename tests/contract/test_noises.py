"""What every noise model promises."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.numerics import eps
from impostor_jax.sensor.base import cos_incidence
from tests.cases import CAMERAS, NOISES
from tests.checks import QUICKLY, all_finite
from tests.groups import FULL

CAMERA = CAMERAS["pinhole"]()
SHAPE = (CAMERA.height, CAMERA.width)
# Rows without a surface.
HOLE = 18
# Pixels from the hole's edge beyond which no part looks across it: six deviations of
# the lateral shift are 5 px.
MARGIN = 6


# Compiling takes nearly all of the time: in double precision one model is read, and of
# the others it is checked that they keep the precision.
IMAGES = [*((name, "float32") for name in NOISES), ("structured light", "float64")]


@pytest.fixture(params=NOISES)
def noise(request):
    return NOISES[request.param]()


@pytest.fixture(params=IMAGES, ids=" in ".join)
def images(request):
    """Readings, their slopes and sigma: a function of seeds and a scene."""
    name, precision = request.param
    noise, dtype = NOISES[name](), np.dtype(precision)
    with jax.enable_x64(precision == "float64"):

        def run(seeds, scene):
            depth, normal = scene(dtype)
            found = read(noise, keys(*seeds), depth, normal)
            assert all(x.dtype == dtype for x in found)
            return [np.asarray(x) for x in found]

        yield run


@jax.jit(compiler_options=QUICKLY)
def read(noise, keys, depth, normal):
    """One image for each key, their slope in depth, and sigma."""

    def images(depth):
        sample = jax.vmap(lambda key: noise.sample(key, depth, normal, CAMERA))(keys)
        return jnp.sum(jnp.where(jnp.isfinite(sample), sample, 0)), sample

    slope, sample = jax.grad(images, has_aux=True)(depth)
    return sample, slope, noise.sigma(depth, cos_incidence(normal, CAMERA))


@jax.jit(compiler_options=QUICKLY)
def sigma_and_slopes(noise, depth, cosine):
    one, zero = jnp.ones_like(depth), jnp.zeros_like(depth)
    sigma, in_depth = jax.jvp(noise.sigma, (depth, cosine), (one, zero))
    backward = jax.grad(lambda *at: jnp.sum(noise.sigma(*at)), (0, 1))(depth, cosine)
    return sigma, (in_depth, backward)


def keys(*seeds):
    return jnp.stack([jax.random.key(seed) for seed in seeds])


def plane(dtype):
    """A wall that faces the camera, with a hole."""
    depth = np.full(SHAPE, 0.9, dtype)
    depth[:HOLE] = np.inf
    normal = np.zeros((*SHAPE, 3), dtype)
    normal[HOLE:, :, 2] = -1
    return depth, normal


def rough(dtype):
    """A scene that breaks formulas: jumps, holes, grazing and far surfaces."""
    rng = np.random.default_rng(0)
    depth = rng.choice([np.inf, 0.0, 1e-3, 0.4, 0.9, 5.0, 1e4], SHAPE)
    normal = rng.normal(size=(*SHAPE, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    normal[rng.uniform(size=SHAPE) < 0.2] = (0, 0, -1)
    normal[np.isinf(depth)] = 0
    return depth.astype(dtype), normal.astype(dtype)


# Of copies the nearest are kept: they scatter otherwise.
@FULL
@pytest.mark.parametrize(
    "images",
    [one for one in IMAGES if one[0] != "aligned"],
    ids=" in ".join,
    indirect=True,
)
def test_readings_that_are_there_scatter_as_sigma_says(images):
    sample, _, sigma = images((1, 2), plane)
    inner = np.s_[:, HOLE + MARGIN :]
    sample, sigma = sample[inner], np.broadcast_to(sigma, sample.shape)[inner]
    used = sample > 0
    assert used.mean() > 0.8
    score = (sample[used] - 0.9) / sigma[used]
    # Four standard errors of a mean and of a standard deviation of about 3000 draws.
    assert abs(score.mean()) < 4 / np.sqrt(score.size)
    assert abs(score.std() - 1) < 4 / np.sqrt(2 * score.size)


@FULL
def test_no_surface_gives_no_reading_and_no_weight(images):
    sample, _, sigma = images((1, 2), plane)
    assert np.isposinf(sample[:, : HOLE - MARGIN]).all()
    assert np.isposinf(sigma[:HOLE]).all()
    assert np.isfinite(sigma[HOLE:]).all()


def test_readings_are_no_less_than_zero_and_have_derivatives(images):
    sample, slope, _ = images((1, 2), rough)
    assert (sample >= 0).all()
    assert np.isfinite(slope).all()


def test_a_key_gives_its_image_in_any_batch(images):
    first, again = images((1, 2), plane)[0], images((2, 3), plane)[0]
    np.testing.assert_array_equal(first[1], again[0])
    assert (first[0] != first[1])[HOLE:].mean() > 0.5


def test_sigma_has_finite_derivatives_everywhere(noise, dtype):
    depths = [-1, 0, 1e-30, 1e-3, 0.4, 0.9, 10, 1e10, np.inf]
    cosines = [0, 1e-8, 0.17, 0.1736481777, 0.5, 0.999, 1 - eps(dtype), 1, 1 + 1e-6]
    at = np.meshgrid(np.array(depths, dtype), np.array(cosines, dtype))
    sigma, slopes = sigma_and_slopes(noise, *at)
    sigma = np.asarray(sigma)
    assert (sigma >= 0).all()
    assert np.isposinf(sigma[:, [0, 1, -1]]).all()
    assert np.isfinite(sigma[:, 2:-1]).all()
    assert all_finite(slopes)


@FULL
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.usefixtures("double")
def test_the_precision_of_the_depth_is_kept_where_double_is_on(noise, precision):
    depth, normal = rough(np.dtype(precision))
    found = jax.eval_shape(read, noise, keys(1), depth, normal)
    assert {x.dtype for x in found} == {depth.dtype}
    # A number that no jit has turned into an array is another case.
    bare = jax.eval_shape(lambda z: noise.sigma(z, z), depth)
    assert bare.dtype == depth.dtype


def test_the_plain_call_agrees_with_jit_and_vmap():
    noise = NOISES["dropout"]()
    depth, normal = (jnp.asarray(x) for x in plane(np.float32))
    plain = noise.sample(jax.random.key(2), depth, normal, CAMERA)
    mapped, *_ = read(noise, keys(1, 2), depth, normal)
    np.testing.assert_allclose(plain, mapped[1], rtol=eps(np.float32, 8))
