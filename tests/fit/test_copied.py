"""Readings that were copied to several pixels, as depth that is aligned to color."""

import functools

import jax
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.copied import copies_along
from tests.fit.scenes import CAMERA, SIGMA, can, image
from tests.groups import FULL, RELEASE, SMALL_IMAGES

pytestmark = FULL

NOISE = ij.ConstantNoise(SIGMA)


@functools.cache
def aligned(scale=1.44, seed=0):
    """A can in an image that was aligned, and its mask."""
    maps = ij.render(can(), CAMERA, outputs=("depth", "normal"))
    assert maps.depth is not None
    assert maps.normal is not None
    sensor = ij.AlignedDepth(NOISE, scale)
    depth = sensor.sample(jax.random.key(seed), maps.depth, maps.normal, CAMERA)
    depth = np.asarray(depth)
    mask = np.isfinite(depth)
    return np.where(mask, depth, 0), mask


@functools.cache
def fitted(sensor):
    depth, mask = aligned()
    return ij.fit_cylinder(depth, CAMERA, mask, sensor)


def rounded(depth, step):
    return (np.round(depth / step) * step).astype(np.float32)


@pytest.mark.parametrize("scale", [1.3, 1.44, 2.0, 3.0])
@pytest.mark.parametrize("step", [1e-6, 1e-4, 1e-3])
def test_copies_are_recognized(scale, step):
    depth, mask = aligned(scale)
    found = copies_along(rounded(depth, step), mask)
    assert found == pytest.approx(scale, rel=0.4)


def test_an_image_that_was_enlarged_by_repeating_pixels_is_recognized():
    depth, mask = (np.repeat(np.repeat(x, 2, 0), 2, 1) for x in image())
    assert copies_along(depth, mask) == pytest.approx(2, rel=0.02)


@pytest.mark.parametrize("noise", [0.0, 1.0, 5.0])
@pytest.mark.parametrize("step", [1e-6, 1e-4, 1e-3, 5e-3])
def test_rounding_is_not_taken_for_copies(noise, step):
    maps = ij.render(can(), CAMERA, outputs=("depth", "mask"))
    depth, mask = np.asarray(maps.depth), np.asarray(maps.mask)
    drawn = np.random.default_rng(0).normal(0, noise * SIGMA, depth.shape)
    depth = np.where(mask, depth, 0.6) + drawn
    for region in (mask, np.ones_like(mask)):
        assert copies_along(rounded(depth, step), region) is None


def test_steps_of_a_disparity_are_not_taken_for_copies():
    depth, mask = image()
    # Depths of 1/8 of a pixel's disparity: 1 to 3 mm apart.
    steps = 150 * 0.05 * 8
    depth = (steps / np.round(steps / depth)).astype(np.float32)
    assert copies_along(depth, mask) is None


@RELEASE
@SMALL_IMAGES
def test_what_walls_lean_by_is_counted_where_it_is_recognized():
    fit = fitted(NOISE)
    assert fit.success
    share = float(fit.std_budget["alignment"].radius)
    # 0.6 pixels' width of the image.
    assert share == pytest.approx(0.6 * 0.35 / 150, rel=0.3)
    assert 0 < float(fit.cylinder.radius) - 0.04 < 1.96 * float(fit.std.radius)
    assert "native depth is better" in fit.reason
    assert str(fit).count("native depth is better") == 1
    assert "alignment" in str(fit)
    parts = fit.std_budget.of("radius")
    total = np.sqrt(sum(float(part) ** 2 for part in parts.values()))
    assert total == pytest.approx(float(fit.std.radius), rel=1e-3)


@SMALL_IMAGES
@RELEASE
def test_a_sensor_that_is_said_to_be_aligned_counts_the_same():
    found, told = fitted(NOISE), fitted(ij.AlignedDepth(NOISE, 1.44))
    assert float(told.std.radius) == pytest.approx(float(found.std.radius), rel=1e-3)
    assert float(told.cylinder.radius) == pytest.approx(float(found.cylinder.radius))


@SMALL_IMAGES
def test_native_depth_has_no_such_share():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    assert not np.any(fit.std_budget["alignment"].radius)
    assert fit.reason == "The fit converged."
