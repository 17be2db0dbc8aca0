"""The outline of a wall, which tells cups and rods with round ends from cylinders."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.outline import unevenness
from impostor_jax.fit.seen import Seen
from impostor_jax.sensor.gaussian import ConstantNoise
from tests.find.scenes import CAMERAS, image_of

CENTER, AXIS = np.array([0.01, 0.0, 0.28]), np.array([0.6, 0.75, 0.28])
AXIS = AXIS / np.linalg.norm(AXIS)
CAN = ij.Cylinder(CENTER, AXIS, 0.04, 0.12)
FAR = 2.0
BACKGROUND = ij.Plane((0, 0, FAR), (0, 0, -1))
FRONT = ij.Sphere(0.65 * (CENTER + 0.05 * AXIS), 0.04)
"""Hides an end of the can."""


def seen_of(shapes, camera, others=()):
    """Shapes before a wall, of which the others are not of the object."""
    image = image_of([*shapes, *others, BACKGROUND], CAMERAS[camera])
    region = (image.owner >= 0) & (image.owner < len(shapes))
    return Seen(np.array(image.depth), region, CAMERAS[camera], ConstantNoise(0.001))


def uneven(shapes, camera="pinhole", others=()):
    return unevenness(CAN, seen_of(shapes, camera, others), 0.001, 0.002)


def cup(slope):
    """As wide as the can in the middle."""
    grown = 0.06 * slope
    ends = CENTER - 0.06 * AXIS, CENTER + 0.06 * AXIS
    return ij.Frustum(*ends, 0.04 - grown, 0.04 + grown)


@pytest.mark.parametrize("others", [(), (FRONT,)])
@pytest.mark.parametrize("camera", ["pinhole", "lens"])
def test_a_can_is_even(camera, others):
    assert uneven([CAN], camera, others) == 0


@pytest.mark.parametrize("slope", [-0.15, 0.15])
@pytest.mark.parametrize("camera", ["pinhole", "lens"])
def test_a_cup_widens(camera, slope):
    # The radius changes by 2 * 0.06 * 0.15 from end to end, by 0.8 of it between the
    # places that are compared.
    assert 0.2 < uneven([cup(slope)], camera) < 0.45


def test_round_ends_are_narrower_than_the_middle():
    ends = [ij.Sphere(CENTER + sign * 0.02 * AXIS, 0.04) for sign in (-1, 1)]
    rod = ij.Cylinder(CENTER, AXIS, 0.04, 0.04)
    assert uneven([rod, *ends]) > 0.2


def test_what_hides_an_end_says_nothing_of_it():
    assert uneven([cup(0.15)]) > 2 * uneven([cup(0.15)], others=[FRONT])


def test_a_hole_beside_a_side_is_no_change():
    seen = seen_of([CAN], "pinhole")
    row, col = np.nonzero(seen.region)
    # Left of the middle of the can one end and half of the other side have no readings.
    hole = np.zeros_like(seen.region)
    hole[: int(row.mean()), : int(col.mean())] = True
    seen.image[hole & ~seen.region] = 0
    seen.image[hole & seen.region & (np.arange(len(hole))[:, None] < row.min() + 6)] = 0
    assert unevenness(CAN, seen, 0.001, 0.002) == 0


def test_a_camera_without_one_center_tells_nothing():
    seen = seen_of([cup(0.15)], "orthographic")
    assert unevenness(CAN, seen, 0.001, 0.002) == 0
