"""Planes of noisy images."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.planes import planes_of, primitives_of
from tests.checks import angle_between
from tests.find.scenes import CAMERA, CAMERAS, ORTHOGRAPHIC, SIGMA, WALL, image_of, seen

TABLE = ij.Plane((0.0, 0.12, 0.5), (0.0, -0.8, -0.6))
TRUNK = ij.Cylinder((0.0, 0.0, 0.8), (0.0, 1.0, 0.0), 0.3, 4.0)


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_table_and_a_wall_are_found(camera):
    camera = CAMERAS[camera]
    image = image_of([TABLE, WALL], camera)
    view = seen(image.depth, camera)
    found = planes_of(view, view.valid)
    points, normals = primitives_of(view, found)
    assert len(points) == 2
    for truth, owner in ((TABLE, 0), (WALL, 1)):
        own = image.owner == owner
        number = np.bincount(found.labels[own]).argmax()
        assert np.mean(found.labels[own] == number) > 0.95
        assert np.mean(own[found.labels == number]) > 0.95
        unit = np.asarray(truth.unit_normal)
        # Of its side too: it faces the camera.
        assert normals[number - 1] @ unit > 0
        assert angle_between(normals[number - 1], unit) < 0.2
        assert abs((points[number - 1] - np.asarray(truth.point)) @ unit) < SIGMA / 3
    assert found.noise == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("camera", [CAMERA, ORTHOGRAPHIC])
def test_a_wide_trunk_is_no_plane(camera):
    image = image_of([TRUNK], camera)
    view = seen(image.depth, camera)
    assert (planes_of(view, view.valid).labels > 0).mean() < 0.02


def test_noise_that_is_larger_than_said_is_estimated():
    image = image_of([TABLE, WALL], sigma=2 * SIGMA)
    view = seen(image.depth)
    found = planes_of(view, view.valid)
    assert found.noise == pytest.approx(2, rel=0.1)
    assert (found.labels > 0).mean() > 0.95


def test_what_lies_at_the_horizon_has_no_weight_of_its_own():
    # The reciprocal of its variance was infinite, and nothing else counted.
    image = image_of([TABLE, WALL])
    depth = image.depth.copy()
    depth[:2, :5] = 1e17
    view = seen(depth)
    found = planes_of(view, view.valid)
    assert (found.labels > 0).mean() > 0.95
    assert found.noise == pytest.approx(1, abs=0.1)


def test_an_empty_image_has_no_planes():
    view = seen(np.zeros((120, 160), np.float32))
    found = planes_of(view, view.valid)
    assert not found.labels.any()
    points, normals = primitives_of(view, found)
    assert points.shape == normals.shape == (0, 3)


@pytest.mark.parametrize("distance", [0.6, 600.0])
def test_a_wall_without_noise_is_found(distance):
    """Its deviations are rounding errors, whose sum of squares was less than 0."""
    view = seen(np.full((120, 160), distance, np.float32), sigma=SIGMA)
    found = planes_of(view, view.valid)
    np.testing.assert_array_equal(found.labels, 1)
    assert found.noise == 1


def test_a_can_is_no_plane_and_does_not_cut_the_table():
    can = ij.Cylinder((0.0, 0.02, 0.5), (0.0, -0.8, -0.6), 0.04, 0.12)
    image = image_of([can, TABLE, WALL])
    view = seen(image.depth)
    labels = planes_of(view, view.valid).labels
    assert (labels[image.owner == 0] > 0).mean() < 0.15
    assert (labels[image.owner > 0] > 0).mean() > 0.95


@pytest.mark.parametrize("is_box", [False, True])
def test_a_cap_is_no_plane_that_is_taken_away(is_box):
    # Large ones were, and with them the cans below a camera.
    camera = ij.PinholeCamera(260.0, 260.0, 160.0, 120.0, 320, 240)
    can = ij.Cylinder((0.05, 0.0, 0.4), (0.0, 0.0, 1.0), radius=0.06, height=0.1)
    box = ij.Box((0.05, 0.0, 0.4), np.eye(3), (0.11, 0.11, 0.1))
    image = image_of([box if is_box else can, WALL], camera)
    view = seen(image.depth, camera)
    is_top = (image.owner == 0) & (np.abs(image.normal[..., 2]) > 0.9)
    taken = (planes_of(view, view.valid).labels > 0)[is_top].mean()
    assert taken > 0.8 if is_box else taken == 0
