"""Departures from a cylinder, told from noise."""

import dataclasses

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.deformation import bending, deformation, wall_readings
from impostor_jax.find.evidence import weighed
from tests.find.scenes import (
    CAMERA,
    CAMERAS,
    SIGMA,
    image_of,
    scene_of,
    wall_of,
)

CAN = ij.Cylinder((0.01, 0.0, 0.35), (0.3, 0.92, 0.25), 0.05, 0.14)


def departure(image, wall, camera=CAMERA):
    """Of what an image shows, from a wall; and half of the length that is seen."""
    scene = scene_of(image, camera, free=image.owner >= 0)
    evidence = weighed(scene, wall)
    low, high = evidence.ends
    readings = wall_readings(scene, evidence)
    return deformation(wall.axis, readings, scene.shared), (high - low) / 2


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("seed", range(4))
def test_a_cylinder_has_none(camera, seed):
    camera = CAMERAS[camera]
    found, _ = departure(image_of([CAN], camera, seed=seed), wall_of(CAN), camera)
    limit = np.maximum(4 * found.deviation, 0.03)
    assert np.all(np.abs(found.value) < limit)
    assert found.seam is None


def test_a_cone_shows_its_taper():
    slope, half, radius = np.tan(np.radians(4)), 0.07, 0.05
    center, axis = np.asarray(CAN.center, float), np.asarray(CAN.axis, float)
    cone = ij.Frustum(
        center - half * axis, center + half * axis,
        radius - half * slope, radius + half * slope,
    )  # fmt: skip
    found, half = departure(image_of([cone]), wall_of(CAN))
    assert abs(found.value[0] - slope * half / radius) < 3 * found.deviation[0]
    assert found.value[0] > 5 * found.deviation[0]
    assert found.seam is None


def bend(image, wall):
    """Of what an image shows of a wall."""
    scene = scene_of(image, free=image.owner >= 0)
    readings = wall_readings(scene, weighed(scene, wall))
    return bending(wall.axis, readings, scene.shared)


@pytest.mark.parametrize("seed", range(4))
def test_a_wall_is_bent_and_what_is_flat_is_not(seed):
    assert bend(image_of([CAN], seed=seed), wall_of(CAN)) > 50
    flat = ij.Plane((0.0, 0.0, 0.4), (0.0, 0.0, -1.0))
    axis = np.array([0.0, 1.0, 0.0])
    touching = wall_of(ij.Cylinder((0.0, 0.0, 20.4), axis, 20.0, 0.2))
    assert bend(image_of([flat], seed=seed), touching) < 4


def test_what_goes_all_around_is_bent():
    # Out of a pipe that is seen from inside the directions have no mean.
    pipe = ij.Cylinder((0.0, 0.0, 0.5), (0.05, 0.0, 1.0), 0.1, 2.0)
    assert bend(image_of([pipe]), wall_of(pipe, side=-1.0)) == np.inf


def test_a_ball_shows_its_barrel():
    """Near its equator it is narrower by half of the square of the height, over R."""
    size, radius = 0.06, 0.057
    wall = wall_of(ij.Cylinder((0.0, 0.0, 0.3), (0.0, 1.0, 0.0), radius, 0.1))
    found, half = departure(image_of([ij.Sphere((0.0, 0.0, 0.3), size)]), wall)
    barrel = -(half**2) / 2 / size / radius
    assert abs(found.value[1] - barrel) < 3 * found.deviation[1]
    assert found.value[1] < -3 * found.deviation[1]


def test_a_bent_pipe_shows_its_bend():
    """A torus is off its tangent by half of the square of the length, over R."""
    bend, radius = 0.2, 0.03
    ring = ij.Torus((bend, 0.0, 0.4), (0.0, 0.0, 1.0), bend, radius)
    straight = ij.Cylinder((0.002, 0.0, 0.4), (0.0, 1.0, 0.0), radius, 0.12)
    image = image_of([ring])
    row, col = np.mgrid[:120, :160]
    part = (image.owner == 0) & (np.abs(row - 59.5) < 22) & (col < 105)
    depth = np.where(part, image.depth, 0)
    owner = np.where(part, 0, -1)
    found, half = departure(image._replace(depth=depth, owner=owner), wall_of(straight))
    size = np.hypot(*found.value[4:])
    deviation = np.max(found.deviation[4:])
    assert abs(size - half**2 / 2 / bend / radius) < 3 * deviation
    assert size > 5 * deviation


@pytest.mark.parametrize(
    ("radius", "aside"), [(0.047, 0.0), (0.05, 0.004)], ids=["narrower", "aside"]
)
def test_cylinders_in_line_have_a_seam(radius, aside):
    center, axis = np.asarray(CAN.center, float), np.asarray(CAN.axis, float)
    aside = aside * np.cross(axis, (0.0, 0.0, 1.0))
    one = ij.Cylinder(center - 0.035 * axis, axis, 0.05, 0.07)
    other = ij.Cylinder(center + 0.035 * axis + aside, axis, radius, 0.07)
    wall = wall_of(CAN, radius=(0.05 + radius) / 2, center=center + aside / 2)
    found, _ = departure(image_of([one, other]), wall)
    assert found.seam == pytest.approx(0, abs=0.005)


def test_of_too_few_readings_nothing_is_told():
    far = ij.Cylinder((0.0, 0.0, 4.0), (0.0, 1.0, 0.0), 0.05, 0.14)
    image = image_of([far], sigma=SIGMA)
    scene = scene_of(image, free=image.owner == 0)
    assert wall_readings(scene, weighed(scene, wall_of(far))) is None


def test_errors_that_pixels_share_leave_more_open():
    scene = scene_of(image_of([CAN]))
    wall = wall_of(CAN)
    evidence = weighed(scene, wall)
    alone, shared = (
        deformation(wall.axis, wall_readings(one, evidence), one.shared)
        for one in (scene, dataclasses.replace(scene, shared=100.0))
    )
    assert shared.vague == pytest.approx(10 * alone.vague)
