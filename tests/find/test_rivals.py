"""A cone and a ball, told from a cylinder by what is seen of wall and cap."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.caps import NO_CAPS, caps_of, inner_of
from impostor_jax.find.deformation import wall_readings
from impostor_jax.find.evidence import weighed
from impostor_jax.find.rivals import rivals
from tests.find.scenes import CAMERAS, SIGMA, image_of, scene_of, wall_of

RADIUS, HEIGHT = 0.05, 0.06
CENTER, AXIS = np.array([0.01, 0.0, 0.35]), np.array([0.2, -0.75, -0.63])
AXIS = AXIS / np.linalg.norm(AXIS)


def cone(degrees):
    """A short one that shows a cap; as wide as a can in its middle."""
    grown = HEIGHT / 2 * np.tan(np.radians(degrees))
    ends = CENTER - HEIGHT / 2 * AXIS, CENTER + HEIGHT / 2 * AXIS
    return ij.Frustum(*ends, RADIUS - grown, RADIUS + grown)


def compared(shape, camera="pinhole", seed=0, sigma=SIGMA):
    """A shape compared as a can, with its cap and by its wall alone."""
    image = image_of([shape], CAMERAS[camera], sigma, seed)
    scene = scene_of(image, CAMERAS[camera], sigma, free=image.owner >= 0)
    wall = wall_of(ij.Cylinder(CENTER, AXIS, RADIUS, HEIGHT))
    evidence = weighed(scene, wall)
    readings = wall_readings(scene, evidence)
    both = [caps_of(scene, evidence), NO_CAPS]
    return [
        rivals(scene, evidence, readings, inner_of(scene, evidence, caps))
        for caps in both
    ]


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("seed", range(3))
def test_a_can_has_no_slope_and_is_no_ball(camera, seed):
    found, _ = compared(cone(0.0), camera, seed)
    assert abs(found.slope) < max(3.5 * found.deviation, np.radians(0.5))
    assert found.ball < -0.5


@pytest.mark.parametrize("degrees", [-6.0, 4.0])
def test_the_cap_of_a_cone_tells_its_slope(degrees):
    found, alone = compared(cone(degrees))
    assert abs(found.slope - np.radians(degrees)) < 4 * found.deviation
    assert abs(found.slope) > 2 * found.deviation
    assert found.deviation < 0.9 * alone.deviation


def test_a_ball_is_told_from_a_can():
    found, _ = compared(ij.Sphere(CENTER, RADIUS + 0.004))
    assert found.ball > 0.1


def test_an_edge_is_told_from_a_can():
    toward = -CENTER + (CENTER @ AXIS) * AXIS
    toward /= np.linalg.norm(toward)
    aside = np.cross(AXIS, toward)
    x, y = (toward + aside) / np.sqrt(2), (toward - aside) / np.sqrt(2)
    # A can's wall is within a quarter of its radius of both faces.
    middle = CENTER + (1.25 * RADIUS - 0.05 * np.sqrt(2)) * toward
    rotation = np.stack([x, y, np.cross(x, y)], axis=1)
    box = ij.Box(middle, rotation, (0.1, 0.1, HEIGHT))
    assert compared(box, sigma=0.005)[1].edge > 0.4
    assert compared(cone(0.0), sigma=0.005)[1].edge < 0
