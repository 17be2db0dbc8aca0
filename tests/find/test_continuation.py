"""Whether a surface goes on where the cylinder that it was taken for ends."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.continuation import continuation
from impostor_jax.find.evidence import weighed
from tests.find.scenes import CAMERAS, WALL, image_of, scene_of, wall_of

RADIUS, HEIGHT = 0.05, 0.1
CENTER, AXIS = np.array([0.01, 0.0, 0.4]), np.array([0.1, 0.97, 0.2])
AXIS = AXIS / np.linalg.norm(AXIS)
CAN = ij.Cylinder(CENTER, AXIS, RADIUS, HEIGHT)
END = CENTER + HEIGHT / 2 * AXIS


def around(shapes, camera="pinhole"):
    """What goes on around a can that some shapes are taken for, before a wall."""
    image = image_of([*shapes, WALL], CAMERAS[camera])
    on_wall = image.owner == len(shapes)
    scene = scene_of(image, CAMERAS[camera], free=(image.owner >= 0) & ~on_wall)
    return continuation(scene, weighed(scene, wall_of(CAN)))


@pytest.mark.parametrize("camera", CAMERAS)
def test_nothing_goes_on_around_a_can(camera):
    found = around([CAN], camera)
    assert found.off < 0.02
    assert found.on < 0.1


def test_a_round_end_goes_on():
    assert around([CAN, ij.Sphere(END, RADIUS)]).off > 0.04


def test_shoulders_go_on():
    shoulder = ij.Frustum(END, END + 0.05 * AXIS, RADIUS, RADIUS / 2)
    found = around([CAN, shoulder])
    assert found.off > 0.2
    assert found.on >= found.off


def test_what_stands_on_a_can_with_a_step_does_not_go_on():
    other = ij.Cylinder(END + 0.05 * AXIS, AXIS, 0.4 * RADIUS, 0.1)
    assert around([CAN, other]).off < 0.05
