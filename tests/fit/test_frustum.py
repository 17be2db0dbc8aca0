import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of
from tests.groups import FULL, SMALL_IMAGES

pytestmark = SMALL_IMAGES


def cup(taper: float = 0.25) -> ij.Frustum:
    """The can, but narrower at p2."""
    half = np.asarray(can().axis) * 0.06
    center = np.asarray(can().center)
    return ij.Frustum(center - half, center + half, 0.04, 0.04 * (1 - taper))


def fit_of(shape, seed=0, **asked):
    depth, mask = image_of(shape, seed=seed)
    return ij.fit_frustum(depth, CAMERA, mask=mask, sigma=SIGMA, **asked)


def test_noisy_cup_is_recovered_within_its_deviations():
    scores, truth = [], cup()
    for seed in range(12):
        fit = fit_of(truth, seed)
        assert fit.status is ij.FitStatus.CONVERGED
        assert np.asarray(fit.ends_seen).all()
        for name in ("radius1", "radius2", "p1", "p2"):
            off = getattr(fit.frustum, name) - getattr(truth, name)
            scores += [*np.atleast_1d(np.asarray(off / getattr(fit.std, name)))]
    assert float(fit.std.radius1) < 2e-4
    assert fit.rms == pytest.approx(SIGMA, rel=0.05)
    # 96 draws, partly correlated: their own deviation is known to about 15 percent.
    assert np.abs(scores).max() < 4.5
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4


@FULL
@pytest.mark.parametrize(
    "shape",
    [
        ij.Frustum((0.0, -0.05, 0.4), (0.01, 0.05, 0.38), 0.06, 0.01),
        ij.Frustum((0.0, 0.02, 0.45), (0.01, 0.0, 0.35), 0.06, 0.03),
        ij.Frustum((0.0, 0.01, 0.35), (0.08, 0.0, 0.42), 0.05, 0.03),
        ij.Frustum((0.0, -0.05, 0.4), (0.01, 0.05, 0.38), 0.05, 0.0),
    ],
    ids=["strong taper", "narrow end ahead", "wide end ahead", "cone"],
)
def test_any_taper_and_view_is_recovered(shape):
    fit = fit_of(shape, initial=shape)
    free = fit_of(shape)
    assert fit.success
    assert fit.rms == pytest.approx(SIGMA, rel=0.05)
    # A tip, or an end behind the body, is not seen.
    assert np.asarray(fit.ends_seen).any()
    for end in np.flatnonzero(fit.ends_seen):
        for name in (f"p{end + 1}", f"radius{end + 1}"):
            off = getattr(fit.frustum, name) - getattr(shape, name)
            # Where rays run along the wall, deviations are a third too small.
            assert np.all(np.abs(off) < 5 * getattr(fit.std, name))
    # Which end is p1 is a rule of signs: the wider one is the same.
    assert free.success
    for one in (free.frustum, fit.frustum):
        widest = max(float(one.radius1), float(one.radius2))
        wanted = max(float(shape.radius1), float(shape.radius2))
        assert widest == pytest.approx(wanted, abs=1e-3)


@FULL
def test_a_view_of_the_wide_end_alone_leaves_the_wall_open():
    fit = fit_of(ij.Frustum((0.0, 0.0, 0.35), (0.0, 0.0, 0.45), 0.05, 0.02))
    assert not fit.success
    assert np.isinf(fit.std.radius2)


def test_ends_keep_the_names_that_a_start_gives_them():
    turned = ij.Frustum(cup().p2, cup().p1, cup().radius2, cup().radius1)
    for start in (cup(), turned):
        fit = fit_of(cup(), initial=start)
        np.testing.assert_allclose(fit.frustum.p1, start.p1, atol=2e-3)
        assert float(fit.frustum.radius1) == pytest.approx(
            float(start.radius1), abs=5e-4
        )


def test_a_taper_settles_whatever_the_tolerance():
    fine, coarse = (fit_of(cup(), effort=ij.Effort(tolerance=t)) for t in (0.2, 5.0))
    assert int(coarse.num_steps) == int(fine.num_steps)
    np.testing.assert_array_equal(coarse.frustum.radius2, fine.frustum.radius2)


def test_held_and_expected_radii_count():
    expected = {"radius2": (0.03, 1e-6)}
    fit = fit_of(cup(), initial=cup(), fixed=("radius1",), prior=expected)
    assert float(fit.frustum.radius1) == pytest.approx(0.04, rel=1e-6)
    assert float(fit.std.radius1) == 0
    assert float(fit.frustum.radius2) == pytest.approx(0.03, abs=5e-6)
    assert float(fit.std.radius2) == pytest.approx(1e-6, rel=0.05)
    with pytest.raises(ValueError, match="initial must be given with prior"):
        fit_of(cup(), prior=expected)


@FULL
def test_a_can_needs_no_taper_and_a_cup_does():
    for shape, is_needed in ((can(), False), (cup(0.05), True)):
        depth, mask = map(np.array, image_of(shape))
        fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
        # Of what was fitted, whatever becomes of the caller's arrays.
        mask[:] = False
        depth[:] = 0
        taper = ij.test_taper(fit)
        assert bool(taper.is_needed()) == is_needed
        # The square of the radii's difference in its deviations is another test of it.
        if is_needed:
            assert float(taper.statistic) > 100
            continue
        covariance = np.asarray(taper.frustum.covariance)[5:7, 5:7]
        variance = covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1]
        grown = taper.frustum.frustum.radius2 - taper.frustum.frustum.radius1
        wald = float(grown) ** 2 / variance
        assert float(taper.statistic) == pytest.approx(wald, rel=0.2, abs=0.3)


def test_taper_is_tested_only_of_what_a_fit_returned():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    stacked = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), fit)
    for other in (stacked, jax.jit(lambda fit: fit)(fit)):
        with pytest.raises(ValueError, match="fit must be as fit_cylinder returned it"):
            ij.test_taper(other)
    with pytest.raises(ValueError, match=r"fit must be of a cylinder .* got a frustum"):
        ij.test_taper(fit_of(cup()))
    known = ij.fit_cylinder(
        depth, CAMERA, mask=mask, sigma=SIGMA, prior={"radius": (0.04, 1e-4)}
    )
    with pytest.raises(ValueError, match="fit must leave the radius open"):
        ij.test_taper(known)


def test_the_radius_at_an_end_that_is_not_seen_is_open():
    whole = cup()
    p2 = whole.p1 + 0.6 * (whole.p2 - whole.p1)
    depth, mask = image_of(whole)
    _, upper = image_of(ij.Frustum(whole.p1, p2, 0.04, 0.034))
    fit = ij.fit_frustum(depth, CAMERA, mask=mask & upper, sigma=SIGMA)
    assert fit.success
    assert np.asarray(fit.ends_seen).tolist() == [True, False]
    assert abs(fit.frustum.radius1 - whole.radius1) < 4.5 * fit.std.radius1
    assert fit.std.radius2 == fit.std_budget["noise"].radius2 == np.inf
    # What the wall tells of its taper is there.
    variance = np.diagonal(fit.covariance)[fit.coordinates.index("radius2")]
    assert 0 < variance < 0.001**2
