"""Fits of images in which most of the object's pixels have no reading."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.sparse import spacing_of, sparse_slopes
from tests.checks import angle_between
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of
from tests.groups import FULL, SMALL_IMAGES

BALL = ij.Sphere((0.02, 0.01, 0.35), 0.05)


def kept(which, shape):
    """Pixels that keep their reading: every eighth row, or a share of all."""
    if which == "rows":
        return np.broadcast_to(np.arange(shape[0])[:, None] % 8 == 3, shape)
    return np.random.default_rng(0).random(shape) < which


@SMALL_IMAGES
@pytest.mark.parametrize("which", ["rows", 0.2, 0.05])
@pytest.mark.parametrize("shape", ["cylinder", pytest.param("sphere", marks=FULL)])
def test_a_few_readings_in_a_mask_are_fitted(shape, which):
    depth, mask = image() if shape == "cylinder" else image_of(BALL)
    depth = np.where(kept(which, depth.shape), depth, 0)
    if shape == "cylinder":
        fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
        found, truth = fit.cylinder, can()
        assert angle_between(found.axis, truth.axis) < 1.5
    else:
        fit = ij.fit_sphere(depth, CAMERA, mask, SIGMA)
        found, truth = fit.sphere, BALL
    assert fit.success
    error = abs(float(found.radius) - float(truth.radius))
    assert error < 4 * float(fit.std.radius)


@pytest.mark.parametrize("which", ["rows", 0.05, 0.2, 0.5, 0.8])
def test_guess_from_a_few_readings_is_close(which):
    depth, mask = image()
    seen = mask & kept(which, depth.shape)
    guess = CYLINDER.guesses(depth, seen, CAMERA, SIGMA)[0]
    assert angle_between(guess.axis, can().axis) < 5
    assert guess.radius == pytest.approx(0.04, rel=0.1)


def test_what_is_thin_but_dense_is_not_sparse():
    row, col = np.mgrid[:60, :80]
    line = np.abs(row - 0.5 * col - 10) < 1.5
    assert spacing_of(line) == 0
    assert spacing_of(row == 30) == 0
    # Every fourth row lies 0, 1, 2 and 1 pixels from a reading.
    assert spacing_of(row % 4 == 0) == pytest.approx(1, abs=0.1)


def test_slopes_of_scattered_readings_of_a_plane_are_its_own():
    camera = CAMERA.matrix()
    row, col = np.mgrid[:120, :160]
    normal = np.array([0.3, -0.2, -0.9])
    rays = np.stack([(col - 79.5) / 150, (row - 59.5) / 150, np.ones(row.shape)], -1)
    inverse = rays @ normal / (normal @ [0, 0, 0.5])
    inverse = np.where(kept(0.1, row.shape), inverse, np.nan)
    slopes, usable = sparse_slopes(inverse, camera, 1.6, 0.0)
    assert np.count_nonzero(usable) > 500
    expected = normal / (normal @ [0, 0, 0.5]) / [150, 150, 1]
    for found, true in zip(slopes, expected, strict=True):
        np.testing.assert_allclose(found[usable], true, atol=1e-9)
