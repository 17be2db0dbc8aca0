"""Which pixels may show a cylinder that is expected somewhere."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.track.sight import NO_PLANES, sight_of
from tests.find.scenes import image_of
from tests.fit.scenes import CAMERA, SIGMA
from tests.track.scenes import WALL, can

UP = np.array([0.0, -0.8, -0.6])
FOOT = np.array([0.0, 0.05, 0.5])
TABLE = ij.Plane(FOOT, UP)
NOISE = ij.ConstantNoise(SIGMA)


def looked(shape, image, planes=NO_PLANES):
    values = (shape.center, shape.axis, [shape.radius], [shape.height])
    values = np.concatenate([np.asarray(x, float) for x in values])
    return sight_of(values, image, CAMERA, NOISE, planes)


@pytest.mark.parametrize("aside", [0.0, 0.001, -0.002, 0.004])
def test_no_pixel_of_the_table_is_taken_for_what_stands_on_it(aside):
    # One, at an outline, moved the radius of a fit by six standard deviations.
    truth = ij.Cylinder(FOOT + 0.05 * UP, UP, 0.035, 0.1)
    image = image_of([TABLE, truth])
    planes = np.array([[*UP, UP @ FOOT]])
    expected = ij.Cylinder(FOOT + 0.05 * UP + [aside, 0, 0], UP, 0.035, 0.1)
    sight = looked(expected, image.depth, planes)
    near = np.isfinite(sight.gap)
    owner = image.owner[sight.window]
    assert not (near & (owner == 0)).any()
    # But for what is beside the foot all of the can is taken.
    assert (near & (owner == 1)).sum() > 0.85 * (image.owner == 1).sum()
    without = np.isfinite(looked(expected, image.depth).gap)
    assert (without & (owner == 0)).any()


def test_counts_tell_what_is_seen_what_is_hidden_and_what_is_gone():
    shape = can()
    shown = looked(shape, image_of([WALL, shape]).depth)
    assert shown.explained > 0.99 * shown.expected
    gone = looked(shape, image_of([WALL]).depth)
    assert (gone.explained, gone.empty) == (0, gone.expected)
    box = ij.Box((0.0, 0.0, 0.3), np.eye(3), (0.12, 0.2, 0.02))
    hidden = looked(shape, image_of([WALL, shape, box]).depth)
    assert hidden.explained + hidden.empty < 0.1 * hidden.expected
    nothing = looked(shape, np.zeros((120, 160), np.float32))
    assert nothing.explained + nothing.empty == 0


def test_what_is_out_of_the_image_has_no_pixels():
    sight = looked(can(x=2.0), np.ones((120, 160), np.float32))
    assert (sight.expected, sight.gap.size) == (0, 0)
