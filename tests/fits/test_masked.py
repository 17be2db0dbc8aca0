"""NumPy's masked arrays: what they mask is no reading, and no object."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.calibrate.request import checked_images, checked_masks
from impostor_jax.fit.matte import checked_matte
from impostor_jax.fit.request import checked_depth, checked_mask
from impostor_jax.io.depth_image import read_depth, write_depth_tiff
from tests.fit.scenes import CAMERA, SIGMA, image
from tests.groups import FULL, OF_POINTS

pytestmark = OF_POINTS


@pytest.fixture(scope="module")
def masked():
    """A can's depth, all else masked, with numbers of a wall below the mask."""
    depth, mask = image()
    return np.ma.MaskedArray(depth, mask=~mask), mask


def test_masked_depth_is_no_reading(masked):
    depth, mask = masked
    given = checked_depth(depth, CAMERA)
    assert type(given) is np.ndarray
    np.testing.assert_array_equal(given, np.where(mask, depth.data, 0))
    np.testing.assert_array_equal(checked_images(depth, CAMERA), given[None])
    with pytest.raises(ValueError, match="depth must be floating-point meters"):
        checked_depth(np.ma.MaskedArray(mask.astype(int), mask=~mask), CAMERA)


def test_a_masked_pixel_of_a_mask_is_none(masked):
    _, mask = masked
    everything = np.ma.MaskedArray(np.ones_like(mask), mask=~mask)
    assert type(checked_mask(everything, CAMERA)) is np.ndarray
    np.testing.assert_array_equal(checked_mask(everything, CAMERA), mask)
    np.testing.assert_array_equal(checked_mask(everything * 255, CAMERA), mask)
    one = checked_masks("mask", everything, (1, *mask.shape))
    np.testing.assert_array_equal(one[0], mask)
    coverage = np.ma.MaskedArray(np.full(mask.shape, 0.9), mask=~mask)
    matte = checked_matte(coverage, CAMERA, 0.05)
    np.testing.assert_array_equal(matte.covered > 0, mask)


@FULL
def test_a_masked_depth_is_fitted_as_one_with_holes(masked):
    depth, mask = masked
    everything = np.ones_like(mask)
    hole = np.where(mask, depth.data, 0)
    of_hole = ij.fit_cylinder(hole, CAMERA, mask=everything, sigma=SIGMA)
    fit = ij.fit_cylinder(depth, CAMERA, mask=everything, sigma=SIGMA)
    assert fit.success
    np.testing.assert_array_equal(fit.cylinder.radius, of_hole.cylinder.radius)
    some = ij.fit_cylinders(depth[None], CAMERA, everything[None], SIGMA)
    np.testing.assert_array_equal(some.shape.radius[0], of_hole.cylinder.radius)
    labels = np.ma.MaskedArray(np.full(mask.shape, 7), mask=~mask)
    fits = ij.fit_labels(depth, CAMERA, labels, sigma=SIGMA)
    assert list(fits) == [7]
    assert float(fits[7].cylinder.radius) == pytest.approx(0.04, abs=5e-4)


def test_masked_points_are_refused():
    points = np.ma.masked_less(np.random.default_rng(0).normal(size=(60, 3)), -1.5)
    count = np.ma.count_masked(points)
    assert count
    with pytest.raises(ValueError, match=f"points must hold no .* got {count}: leave"):
        ij.fit_cylinder_to_points(points, (0, 0, 5.0))


def test_masked_depth_is_written_as_no_reading(tmp_path, masked):
    depth, mask = masked
    path = tmp_path / "depth.tiff"
    write_depth_tiff(path, depth)
    np.testing.assert_array_equal(read_depth(path, None) > 0, mask)
