"""Fits of the objects of a label image, and what is no mask of one object."""

import functools

import jax
import numpy as np
import pytest

import impostor_jax as ij
from tests.fit.scenes import CAMERA, SIGMA
from tests.groups import FULL, SMALL_IMAGES

pytestmark = SMALL_IMAGES

RADII = (0.03, 0.04)


@functools.cache
def two_cans():
    """Depth of two cans before a wall, and their labels, 2 and 5."""
    cans = ij.Scene(
        [
            ij.Cylinder((-0.08, 0.0, 0.35), (0.2, 1, 0.3), RADII[0], 0.1),
            ij.Cylinder((0.08, 0.0, 0.4), (-0.3, 1, 0.4), RADII[1], 0.12),
        ]
    )
    maps = ij.render(cans, CAMERA, outputs=("depth", "index"))
    depth = np.minimum(np.asarray(maps.depth), 0.6)
    noise = np.random.default_rng(0).normal(0, SIGMA, depth.shape)
    labels = np.array([0, 2, 5], np.uint8)[np.asarray(maps.index) + 1]
    return (depth + noise).astype(np.float32), labels


def test_each_label_is_fitted_by_itself():
    depth, labels = two_cans()
    labels = labels.copy()
    # An object of a few pixels fails alone.
    labels[:3, :3] = 4
    fits = ij.fit_labels(depth, CAMERA, labels, sigma=SIGMA)
    assert list(fits) == [2, 4, 5]
    assert fits[4].status == "no_first_guess"
    for label, radius in zip((2, 5), RADII, strict=True):
        assert fits[label].success
        assert abs(float(fits[label].cylinder.radius) - radius) < 4 * float(
            fits[label].std.radius
        )
        assert int(fits[label].num_pixels) == np.count_nonzero(labels == label)


@FULL
def test_labels_can_be_of_another_shape():
    depth, labels = two_cans()
    fits = ij.fit_labels(
        depth, CAMERA, 1 * (labels == 2), ij.fit_sphere, sigma=SIGMA, effort="fast"
    )
    assert isinstance(fits[1].shape, ij.Sphere)


def test_a_label_image_is_no_mask_of_one_object():
    depth, labels = two_cans()
    with pytest.raises(ValueError, match="got 2 values up to 5: is it a label image"):
        ij.fit_cylinder(depth, CAMERA, labels, SIGMA)


@pytest.mark.parametrize("value", [1, 255])
def test_a_mask_of_one_integer_is_a_mask(value):
    depth, labels = two_cans()
    mask = np.where(labels == 2, value, 0).astype(np.uint8)
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    expected = ij.fit_cylinder(depth, CAMERA, labels == 2, SIGMA)
    assert float(fit.cylinder.radius) == float(expected.cylinder.radius)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda labels: labels * 1.0, "labels must be integers of the camera's shape"),
        (lambda labels: labels[1:], r"got uint8 of shape \(119, 160\)"),
        (lambda labels: labels * 0, "labels must hold at least one that is not 0"),
    ],
)
def test_bad_labels_are_refused(change, message):
    depth, labels = two_cans()
    with pytest.raises(ValueError, match=message):
        ij.fit_labels(depth, CAMERA, change(labels))


def test_labels_are_fitted_by_fits_alone():
    depth, labels = two_cans()
    with pytest.raises(ValueError, match="fit must be one of fit_cylinder, fit_frus"):
        ij.fit_labels(depth, CAMERA, labels, ij.render)
    with pytest.raises(ValueError, match="must be concrete"):
        jax.jit(lambda depth: ij.fit_labels(depth, CAMERA, labels)[2].rms)(depth)


def test_labels_are_of_one_image():
    depth, labels = two_cans()
    with pytest.raises(ValueError, match=r"camera must be one camera.*, got list"):
        ij.fit_labels(depth, [CAMERA], labels)
    with pytest.raises(ValueError, match=r"depth must be one image.*, got list"):
        ij.fit_labels([depth], CAMERA, labels)
