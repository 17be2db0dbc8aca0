"""Deviations that are told pixel by pixel."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from tests.fit.scenes import CAMERA, SIGMA, can, image_of
from tests.groups import FULL, SMALL_IMAGES

pytestmark = [SMALL_IMAGES, FULL]

CALM, ROUGH = 0.0005, 0.003


def told(seed: int = 0):
    """An image of a can whose right half is rough, its mask, and what tells of it."""
    depth, mask = image_of(can(), seed=seed)
    sigma = np.full(depth.shape, CALM, np.float32)
    sigma[:, int(np.nonzero(mask)[1].mean()) :] = ROUGH
    rng = np.random.default_rng(100 + seed)
    truth = np.minimum(np.asarray(ij.render(can(), CAMERA).depth), 0.6)
    return (truth + rng.normal(0, sigma)).astype(np.float32), mask, sigma


def test_deviations_weigh_each_reading():
    scores = []
    for seed in range(6):
        depth, mask, sigma = told(seed)
        fit = ij.fit_cylinder(depth, CAMERA, mask, sigma)
        assert fit.success, str(fit)
        assert fit.chi2 == pytest.approx(1, abs=0.1)
        scores.append(float((fit.cylinder.radius - 0.04) / fit.std.radius))
    assert np.max(np.abs(scores)) < 4


def test_rough_readings_count_for_less_and_unknown_ones_for_nothing():
    depth, mask, sigma = told()
    fit = ij.fit_cylinder(depth, CAMERA, mask, sigma)
    # Where a deviation is not known, nothing is read.
    calm = np.where(sigma == CALM, sigma, np.nan)
    half = ij.fit_cylinder(depth, CAMERA, mask, calm)
    assert half.success
    assert half.num_inliers < 0.6 * fit.num_inliers
    # One number for all must be that of the rough ones.
    rough = ij.fit_cylinder(depth, CAMERA, mask, ROUGH, scale="fixed")
    assert float(rough.std.radius) > 1.2 * float(fit.std.radius)


def test_one_deviation_everywhere_is_that_number():
    depth, mask = image_of(can())
    number, everywhere = (
        ij.fit_cylinder(depth, CAMERA, mask, sigma)
        for sigma in (SIGMA, np.full(depth.shape, SIGMA))
    )
    for name in ("center", "axis", "radius", "height"):
        one, other = (getattr(fit.cylinder, name) for fit in (number, everywhere))
        std = float(number.std.radius) / 100
        np.testing.assert_allclose(one, other, atol=std, rtol=0)
    np.testing.assert_allclose(number.std.radius, everywhere.std.radius, rtol=1e-3)


def test_each_image_of_a_batch_has_its_own():
    depths, masks, sigmas = map(np.stack, zip(*map(told, range(2)), strict=True))
    fits = ij.fit_cylinders(depths, CAMERA, masks, sigmas)
    for k, fit in enumerate(fits):
        alone = ij.fit_cylinder(depths[k], CAMERA, masks[k], sigmas[k])
        assert fit.cylinder.radius == alone.cylinder.radius
    listed = ij.fit_cylinders(depths, CAMERA, masks, [*sigmas])
    np.testing.assert_array_equal(listed.cylinder.radius, fits.cylinder.radius)
    with pytest.raises(ValueError, match="sigma must be of 2 images, got 3"):
        ij.fit_cylinders(depths, CAMERA, masks, np.ones((3, 120, 160)))
    with pytest.raises(ValueError, match=r"masks must be 2 of shape \(H, W\)"):
        ij.fit_cylinders(depths, CAMERA, masks[0], SIGMA)


def test_what_is_searched_for_is_weighed_alike():
    depth, _, sigma = told()
    fit = ij.fit_cylinder(depth, CAMERA, sigma=sigma)
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.04) < 4 * float(fit.std.radius)


def test_a_traced_fit_takes_them():
    depth, mask, sigma = told()
    start = ij.Cylinder((0.01, 0.005, 0.352), can().axis, 0.041, 0.121)

    @jax.jit
    def radius(sigma):
        return ij.fit_cylinder(depth, CAMERA, mask, sigma, start).cylinder.radius

    alone = ij.fit_cylinder(depth, CAMERA, mask, sigma, start)
    found = float(radius(jnp.asarray(sigma)))
    assert abs(found - float(alone.cylinder.radius)) < 0.05 * float(alone.std.radius)


@pytest.mark.parametrize(
    ("sigma", "message"),
    [
        (np.ones((4, 5)), r"sigma must be .* shape \(120, 160\), got float64 of shape"),
        (np.ones((120, 160), int), "sigma must be .* floating-point meters"),
        (np.full((120, 160), -0.1), "sigma must not be negative, got -0.1"),
        (np.full((120, 160), np.nan), "sigma must be positive at some pixel"),
    ],
)
def test_other_arrays_are_refused(sigma, message):
    depth, mask = image_of(can())
    with pytest.raises(ValueError, match=message):
        ij.fit_cylinder(depth, CAMERA, mask, sigma)
