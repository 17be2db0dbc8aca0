"""Solutions beside the best: their weights, what they widen, and what a reader sees."""

import dataclasses

import equinox as eqx
import jax
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.weighing import best_of
from tests.fit.bodies import body_of
from tests.fit.scenes import CAMERA, SIGMA, can, image, program_of
from tests.groups import SMALL_IMAGES

MOVED = 0.004
"""By which a rival's radius and center differ from the best's, in meters."""


def assessed(start, **options):
    """What is said of the can from a start, as a fit does."""
    return program_of(start, **options).fit(body_of(start))


@pytest.fixture(scope="module")
def best():
    """What is said of the can from a start at the truth."""
    return assessed(can())


def rival_of(best, share, moved=MOVED):
    """A solution with so much of the best's probability, elsewhere."""
    shape = eqx.tree_at(
        lambda c: (c.radius, c.center),
        best.fit.shape,
        (best.fit.shape.radius + moved, best.fit.shape.center + moved),
    )
    cost = best.cost - best.repeats * np.log(share).astype(np.float32)
    return best._replace(fit=dataclasses.replace(best.fit, shape=shape), cost=cost)


@SMALL_IMAGES
def test_two_likely_solutions_are_ambiguous_and_deviations_cover_both(best):
    fit = best_of([rival_of(best, 0.25), best])
    assert fit.status is ij.FitStatus.AMBIGUOUS
    assert not fit.success
    assert fit.is_shape
    np.testing.assert_allclose(fit.alternatives.weight, [0.2, 0], rtol=1e-3)
    other = fit.alternatives.shape
    assert float(other.radius[0] - fit.cylinder.radius) == pytest.approx(MOVED, 1e-3)
    assert float(other.radius[1]) == float(fit.cylinder.radius)
    expected = np.sqrt(float(best.fit.std.radius) ** 2 + 0.2 * MOVED**2)
    assert float(fit.std.radius) == pytest.approx(expected, rel=1e-3)
    part = float(fit.std_budget["alternatives"].radius)
    assert part == pytest.approx(0.2**0.5 * MOVED, rel=1e-3)
    at = fit.coordinates.index("radius")
    assert float(fit.covariance[at, at]) == pytest.approx(expected**2, rel=1e-3)
    expected = np.sqrt(np.asarray(best.fit.std.center) ** 2 + 0.2 * MOVED**2)
    np.testing.assert_allclose(fit.std.center, expected, rtol=1e-3)


@SMALL_IMAGES
def test_a_radius_below_a_pixel_has_no_size(best):
    start = can()
    thin = ij.Cylinder(start.center, start.axis, 1e-6, start.height)
    assert bool(best.is_possible)
    assert not bool(assessed(thin, fixed=("radius",)).is_possible)


@SMALL_IMAGES
def test_a_solution_without_a_size_is_none(best):
    none = rival_of(best, 0.25)._replace(is_possible=np.array(False))
    fit = best_of([none, best])
    assert fit.success
    assert not np.asarray(fit.alternatives.weight).any()


@SMALL_IMAGES
def test_an_unlikely_solution_widens_a_success(best):
    fit = best_of([best, rival_of(best, 0.02)])
    assert fit.status is ij.FitStatus.CONVERGED
    assert float(fit.alternatives.weight[0]) == pytest.approx(0.02 / 1.02, rel=1e-3)
    assert fit.std.radius > 1.5 * best.fit.std.radius


@SMALL_IMAGES
@pytest.mark.parametrize(
    ("share", "moved", "agreeing"),
    [
        pytest.param(1e-5, MOVED, 1, id="improbable"),
        pytest.param(0.5, 1e-6, 2, id="the same within its deviations"),
    ],
)
def test_no_other_solution_leaves_a_fit_as_it_is(best, share, moved, agreeing):
    fit = best_of([best, rival_of(best, share, moved)])
    assert fit.status is ij.FitStatus.CONVERGED
    assert not np.asarray(fit.alternatives.weight).any()
    assert int(fit.num_agreeing) == agreeing
    assert float(fit.std.radius) == float(best.fit.std.radius)


@SMALL_IMAGES
def test_readings_whose_errors_are_shared_tell_less(best):
    rival = rival_of(best, 1e-4)
    fit = best_of([best._replace(repeats=4 * best.repeats), rival])
    assert float(fit.alternatives.weight[0]) == pytest.approx(0.1 / 1.1, rel=1e-2)


@SMALL_IMAGES
def test_an_ambiguous_fit_tells_and_writes_its_alternatives(best):
    fit = best_of([best, rival_of(best, 0.25)])
    text = fit.summary()
    assert text.startswith("ambiguous: Two solutions explain the readings.")
    assert "or with 20.0 %: center" in text
    assert "radius 43.9" in text
    (told,) = fit.to_dict()["alternatives"]
    assert told["weight"] == pytest.approx(0.2, rel=1e-3)
    assert told["radius_m"] == pytest.approx(0.044, abs=1e-3)


@SMALL_IMAGES
def test_a_clear_can_takes_one_start_and_has_no_alternatives():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    assert int(fit.num_starts) == 1
    assert not np.asarray(fit.alternatives.weight).any()
    assert "or with" not in str(fit)


@SMALL_IMAGES
def test_alternatives_are_stacked_and_mapped():
    depth, mask = image()
    fits = ij.fit_cylinders(np.stack([depth] * 2), CAMERA, [mask] * 2, SIGMA)
    assert fits.alternatives.weight.shape == (2, 2)
    assert fits.alternatives.shape.center.shape == (2, 2, 3)

    def weights(depth):
        fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA, initial=can())
        return fit.alternatives.weight

    assert not np.asarray(jax.jit(jax.vmap(weights))(depth[None])).any()
