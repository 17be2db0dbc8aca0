"""Errors and bounds are told in one set of coordinates."""

import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.errors import COORDINATES, bound, error
from experiments.scenes import View, make_can
from impostor_jax.evaluate import difference

STEP = 1e-5


def cup():
    return ij.Frustum((0.02, 0.01, 0.75), (0.05, 0.1, 0.85), 0.03, 0.04)


def turned(shape):
    """The same shape, told from its other end."""
    if isinstance(shape, ij.Cylinder):
        return ij.Cylinder(shape.center, -shape.axis, shape.radius, shape.height)
    return ij.Frustum(shape.p2, shape.p1, shape.radius2, shape.radius1)


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("make", [make_can, cup, lambda: ij.Sphere((0, 0, 0.8), 0.04)])
def test_error_is_the_move_whose_derivatives_make_the_bound(make):
    truth = make()
    count, moved = COORDINATES[type(truth)]
    # A frustum's last two move its ends, which are not compared.
    compared = 6 if count == 8 else count
    for k in range(compared):
        found = error(moved(truth, STEP * jnp.eye(count)[k]), truth)
        np.testing.assert_allclose(found, STEP * np.eye(compared)[k], atol=1e-3 * STEP)


@pytest.mark.parametrize("about_found", [False, True])
@pytest.mark.parametrize("make", [make_can, cup])
def test_a_shape_told_from_its_other_end_has_no_error(make, about_found):
    # The radii of a frustum's ends were exchanged.
    shape = make()
    off = difference(turned(shape), shape, about_found=about_found)
    np.testing.assert_allclose(off, 0, atol=1e-7)


def test_bound_is_what_few_readings_of_a_ball_tell():
    ball = ij.Sphere((0, 0, 0.8), 0.04)
    row, col = np.mgrid[0:480, 0:640]
    near = (row - 239.5) ** 2 + (col - 319.5) ** 2 < 10**2
    view = View(ball, np.zeros((480, 640), np.float32), near, 0.001)
    whole, part = bound(view), bound(view, least_cosine=0.98)
    assert np.all(part > whole)
    half = View(ball, view.depth, near, 0.0005)
    np.testing.assert_allclose(bound(half), whole / 2, rtol=1e-9)
    assert np.all(bound(view, reachable=True) >= whole)
