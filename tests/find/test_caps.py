"""Caps, told by their rims."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.caps import Caps, caps_of, doming, inner_of
from impostor_jax.find.evidence import Evidence
from impostor_jax.find.search import MOST_MISFIT
from tests.find.scenes import (
    CAMERAS,
    SIGMA,
    WALL,
    ends_of,
    image_of,
    scene_of,
    seen,
    wall_of,
)

UPRIGHT = ij.Cylinder((0.05, 0.01, 0.45), (0.1, 0.05, 0.9937), 0.07, 0.1)


def known(shape, side=1.0):
    """A wall of which nothing is known but its ends."""
    nothing = np.zeros(0, int)
    return Evidence(
        wall_of(shape, side), ends_of(shape), nothing, 0.0, 0.0, 0.0, 0.0, 1.0
    )


def caps(scene, shape, side=1.0):
    """Those of a wall of which nothing is known but its ends."""
    return caps_of(scene, known(shape, side))


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_rim_of_a_cap_is_seen_all_around(camera):
    camera = CAMERAS[camera]
    image = image_of([UPRIGHT, WALL], camera)
    found = caps(scene_of(image, camera), UPRIGHT)
    # Where the wall can be seen, it goes on beyond the rim.
    assert found.rim > np.radians(250)
    axis = np.asarray(UPRIGHT.axis)
    cap = (image.owner == 0) & (np.abs(image.normal @ axis) > 0.9)
    assert np.mean(cap.ravel()[found.pixels]) > 0.95
    assert len(found.pixels) > 0.9 * np.count_nonzero(cap)


def test_a_lid_with_a_rim_is_one_for_a_good_sensor():
    sigma = SIGMA / 4
    image = image_of([UPRIGHT, WALL], sigma=sigma)
    axis, radius = np.asarray(UPRIGHT.axis), float(UPRIGHT.radius)
    # The middle of a flat lid lies deeper than its rim.
    cap = (image.owner == 0) & (np.abs(image.normal @ axis) > 0.9)
    off = seen(image.depth, sigma=sigma).points - np.asarray(UPRIGHT.center)
    deeper = cap & (np.linalg.norm(np.cross(off, axis), axis=-1) < 0.85 * radius)
    depth = image.depth + np.float32(0.03 * radius) * deeper
    found = caps(scene_of(image._replace(depth=depth), sigma=sigma), UPRIGHT)
    assert found.rim > np.radians(250)
    assert found.misfit < MOST_MISFIT


def test_a_round_patch_of_a_table_has_no_rim():
    image = image_of([WALL])
    disc = ij.Cylinder((0.02, 0.01, 0.65), (0.0, 0.0, 1.0), 0.08, 0.1)
    found = caps(scene_of(image), disc)
    assert found.rim == 0
    assert len(found.pixels) == 0


def test_a_disc_inside_of_a_box_has_no_rim():
    box = ij.Box((0.0, 0.0, 0.45), np.eye(3), (0.14, 0.14, 0.1))
    disc = ij.Cylinder((0.0, 0.0, 0.45), (0.0, 0.0, 1.0), 0.045, 0.1)
    image = image_of([box, WALL])
    assert caps(scene_of(image), disc).rim == 0


def test_a_pipe_from_inside_has_no_caps():
    image = image_of([UPRIGHT, WALL], sigma=SIGMA)
    assert caps(scene_of(image), UPRIGHT, -1.0).rim == 0


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_cap_is_flat_and_a_round_end_is_domed(camera):
    camera = CAMERAS[camera]

    def domed(*shapes):
        """How far the middle stands out, of all that is seen of the last one."""
        image = image_of([WALL, *shapes], camera)
        pixels = np.flatnonzero(image.owner == len(shapes))
        scene, wall = scene_of(image, camera), known(UPRIGHT)
        inner = inner_of(scene, wall, Caps(pixels, np.pi))
        return doming(wall, inner, scene.shared)

    axis = np.asarray(UPRIGHT.axis)
    near = np.asarray(UPRIGHT.center) - 0.05 * axis
    disc = ij.Cylinder(near + 0.002 * axis, axis, 0.07, 0.004)
    assert domed(disc) < 0.02
    assert 0.2 < domed(UPRIGHT, ij.Sphere(near, 0.07)) < 0.8
