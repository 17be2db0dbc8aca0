"""What is no number is no success, and JAX's check for NaN finds none."""

import jax
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import impostor_jax as ij
from impostor_jax.find.confidence import FACTS, confidence
from impostor_jax.numerics import nan_where
from tests.fit.scenes import CAMERA, SIGMA, can, image
from tests.groups import FULL, RELEASE, SMALL_IMAGES

pytestmark = SMALL_IMAGES


@pytest.fixture
def debug_nans():
    """JAX raises where what it returns is NaN."""
    jax.config.update("jax_debug_nans", True)
    yield
    jax.config.update("jax_debug_nans", False)


@RELEASE
@pytest.mark.usefixtures("debug_nans")
def test_fits_and_searches_run_where_jax_checks_for_nan():
    depth, mask = image()
    found = ij.find_cylinders(depth, CAMERA, sigma=SIGMA)
    assert [bool(fit.success) for fit in found.fits] == [True]
    # No noise that could be measured: the p-value is not known.
    clean = np.asarray(ij.render(can(), CAMERA).depth)
    fit = ij.fit_cylinder(np.where(mask, clean, 0), CAMERA, mask)
    assert fit.success
    assert np.isnan(float(fit.p_value))
    # A wall, of which several starts lead to nothing.
    flat = np.full_like(depth, 0.6)
    assert not ij.fit_cylinder(flat, CAMERA, mask, sigma=SIGMA).success


@pytest.mark.usefixtures("debug_nans")
def test_what_is_not_known_is_nan_where_jax_checks_for_nan():
    values = nan_where(jax.numpy.array([True, False]), jax.numpy.array([1.0, 2.0]))
    np.testing.assert_array_equal(values, [np.nan, 2])


def test_a_fact_that_is_no_number_makes_nothing_sure():
    facts = np.zeros(len(FACTS))
    # A whole rim makes a cylinder sure of which nothing else is known.
    facts[list(FACTS).index("rim")] = 1.0
    assert confidence(facts) > 0.9
    facts[1] = np.nan
    assert confidence(facts) == 0


scenes = st.fixed_dictionaries(
    {
        "radius": st.floats(0.003, 0.3),
        "height": st.floats(0.02, 0.5),
        "depth": st.floats(0.3, 2.0),
        "tilt": st.floats(0.0, 1.57),
        "turn": st.floats(0.0, 3.14),
        "noise": st.floats(0.0, 8.0),
        "seed": st.integers(0, 99),
    }
)


def check(scene):
    """A fit of a random can, and noise that may be far from what is told of it."""
    tilt, turn = scene["tilt"], scene["turn"]
    axis = np.array(
        [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)]
    )
    center = (0.0, 0.01, scene["depth"] + scene["radius"])
    truth = ij.Cylinder(center, axis, scene["radius"], scene["height"])
    maps = ij.render(truth, CAMERA, outputs=("depth", "mask"))
    mask = np.asarray(maps.mask)
    assume(mask.sum() > 50)
    rng = np.random.default_rng(scene["seed"])
    noise = scene["noise"] * SIGMA * rng.normal(size=mask.shape)
    depth = np.where(mask, np.asarray(maps.depth), 0) + np.where(mask, noise, 0)
    fit = ij.fit_cylinder(
        depth.astype(np.float32), CAMERA, mask, sigma=SIGMA, errors="correlated"
    )
    weights = np.asarray(fit.alternatives.weight)
    others = np.asarray(fit.alternatives.shape.radius)[weights > 0]
    assert (others > 0.2 * scene["depth"] / CAMERA.fx).all()
    if not fit.success:
        return
    assert float(fit.cylinder.radius) > 0
    for leaf in jax.tree.leaves((fit.shape, fit.rms, fit.chi2)):
        assert np.isfinite(leaf).all()
    for std in jax.tree.leaves((fit.std, fit.std_budget)):
        assert (np.asarray(std) >= 0).all()
    assert np.isfinite(fit.std.radius)
    known = np.asarray(fit.observed.coordinates)
    covariance = np.asarray(fit.covariance, float)[np.ix_(known, known)]
    size = np.sqrt(np.maximum(np.diagonal(covariance), 1e-30))
    values = np.linalg.eigvalsh(covariance / np.outer(size, size))
    assert values.min() > -1e-4


@FULL
@settings(max_examples=4)
@given(scenes)
def test_a_success_is_made_of_numbers(scene):
    check(scene)


@RELEASE
@settings(max_examples=150)
@given(scenes)
def test_many_successes_are_made_of_numbers(scene):
    check(scene)
