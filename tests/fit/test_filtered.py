"""Depth that was filtered, of which a caller tells the noise of single readings."""

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of
from tests.groups import FULL, SMALL_IMAGES

pytestmark = SMALL_IMAGES

FILTERS = {
    "bilateral": lambda depth: cv2.bilateralFilter(depth, 7, 0.03, 3),
    "gaussian": lambda depth: cv2.GaussianBlur(depth, (0, 0), 1.0),
}


@pytest.mark.parametrize("name", FILTERS)
def test_errors_that_a_filter_shares_are_measured(name):
    # Radii came out up to 42 of their deviations too small.
    depth, mask = image()
    # Beside its border both blur the object and what is behind.
    mask = cv2.erode(mask.view(np.uint8), np.ones((5, 5))) > 0
    fit = ij.fit_cylinder(FILTERS[name](depth), CAMERA, mask, SIGMA)
    assert fit.success
    assert fit.asked.measured.startswith("Neighbors err alike")
    assert "Neighbors err alike" in str(fit)
    assert abs(float(fit.cylinder.radius) - 0.04) < 3 * float(fit.std.radius)


@FULL
@pytest.mark.parametrize(
    "shape",
    [None, ij.Frustum((-0.03, -0.04, 0.35), (0.05, 0.05, 0.35), 0.042, 0.036)],
    ids=["can", "cone"],
)
def test_white_noise_is_what_was_told(shape):
    depth, mask = image() if shape is None else image_of(shape)
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    assert not fit.asked.measured


@pytest.mark.parametrize("sigma", [2 * SIGMA, ij.ConstantNoise(2 * SIGMA)])
def test_noise_that_is_told_too_large_is_measured(sigma):
    # Told twice, noise of 5 mm bent radii by four deviations on the mean.
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask, sigma)
    assert fit.asked.measured.startswith("Readings scatter by 0.5 of sigma")
    assert 0.8 < float(fit.chi2) < 1.2


def test_noise_that_does_not_grow_towards_grazing_is_measured():
    # What is said to graze with so much more bent a radius by 1.5 deviations.
    depth, mask = image()
    sensor = ij.StructuredLight(floor=SIGMA, growth=0.0, grazing=0.0005)
    fit = ij.fit_cylinder(depth, CAMERA, mask, sensor)
    assert fit.asked.measured.startswith("Readings of slanted surfaces scatter by 0.")
    assert abs(float(fit.cylinder.radius) - 0.04) < 2 * float(fit.std.radius)


def test_what_grazes_may_scatter_by_more_of_a_noise_that_is_told_too_large():
    # It speaks for rays that err beside the rest alone, which was told twice too large:
    # of a guided filter's image radii were 8 and 13 deviations off.
    scene = ij.Scene([can(), ij.Plane((0, 0, 0.6), (0, 0, -1.0))])
    maps = ij.render(scene, CAMERA, outputs=("depth", "normal", "index"))
    depth, normal = np.asarray(maps.depth), np.asarray(maps.normal)
    mask = np.asarray(maps.index) == 0
    ray = np.asarray(CAMERA.rays(*CAMERA.frame.pixels(), depth.dtype).direction.stack())
    cosine = np.abs(np.sum(normal * ray, axis=-1)) / np.linalg.norm(ray, axis=-1)
    noise = np.random.default_rng(0).normal(size=depth.shape)
    noise *= 0.15 * SIGMA * (1 + 1 / np.maximum(cosine, 0.1))
    depth = (depth + noise).astype(np.float32)
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    assert fit.asked.measured.startswith("Readings scatter by 0.4")
    assert abs(float(fit.cylinder.radius) - 0.04) < 3 * float(fit.std.radius)


def test_an_image_without_noise_tells_none():
    maps = ij.render(can(), CAMERA)
    depth, mask = np.asarray(maps.depth), np.asarray(maps.mask)
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    assert not fit.asked.measured
    assert float(fit.std.radius) > 0


def test_a_caller_who_says_independent_is_believed():
    depth, mask = image()
    blurred = FILTERS["bilateral"](depth)
    fit = ij.fit_cylinder(blurred, CAMERA, mask, SIGMA, errors="independent")
    assert not fit.asked.measured
