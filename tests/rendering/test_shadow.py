"""The shadow that a projector beside the camera leaves."""

import numpy as np
import pytest

import impostor_jax as ij
from tests.groups import FULL

CAMERA = ij.PinholeCamera(80.0, 80.0, 31.5, 23.5, 64, 48)
WALL = ij.Plane((0, 0, 2.0), (0, 0, -1))
BASELINE = 0.1


def seen_by(camera, *shapes):
    scene = ij.Scene(shapes)
    maps = ij.render(scene, camera, outputs=("depth", "index"))
    return scene, maps.depth, np.asarray(maps.index)


def test_a_sphere_before_a_wall_throws_the_shadow_of_similar_triangles():
    sphere = ij.Sphere((0.0, 0.0, 1.0), 0.1)
    scene, depth, index = seen_by(CAMERA, sphere, WALL)
    light = np.asarray(ij.lit(scene, CAMERA, depth, (BASELINE, 0, 0)))
    # On the wall, rays of the projector that touch the sphere's image.
    col = np.arange(64)
    x = 2.0 * (col - 31.5) / 80.0
    towards = np.array([0.0, 0.0, 1.0]) - [BASELINE, 0, 0]
    for row in range(48):
        y = 2.0 * (row - 23.5) / 80.0
        ray = np.stack([x - BASELINE, np.full(64, y), np.full(64, 2.0)], axis=-1)
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        off = np.linalg.norm(np.cross(ray, towards), axis=-1)
        wall = index[row] == 1
        np.testing.assert_array_equal(light[row][wall], off[wall] > 0.1)
    assert (~light).sum() > 20
    # All but the sphere's far side.
    assert light[index == 0].mean() > 0.9


@FULL
def test_a_projector_in_the_camera_leaves_no_shadow():
    cylinder = ij.Cylinder((0.1, 0, 1), (0.3, 1, 0.5), 0.1, 0.4)
    scene, depth, index = seen_by(CAMERA, cylinder, WALL)
    light = ij.lit(scene, CAMERA, depth, (0, 0, 0))
    np.testing.assert_array_equal(light, index >= 0)


@FULL
def test_the_shadow_moves_with_a_posed_camera():
    turn = ij.RigidTransform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.1, 0.2, 0.3])
    posed = ij.PinholeCamera(80.0, 80.0, 31.5, 23.5, 64, 48, camera_from_world=turn)
    cylinder = ij.Cylinder((0.1, 0, 1), (0.3, 1, 0.5), 0.1, 0.4)
    moved = [shape.transformed(turn.inverse()) for shape in (cylinder, WALL)]
    scene, depth, _ = seen_by(CAMERA, cylinder, WALL)
    away, away_depth, _ = seen_by(posed, *moved)
    one = np.asarray(ij.lit(scene, CAMERA, depth, (BASELINE, 0, 0)))
    other = np.asarray(ij.lit(away, posed, away_depth, (BASELINE, 0, 0)))
    assert (one != other).mean() < 0.005
    assert (~one).any()


def test_what_is_behind_the_projector_gets_no_light():
    near, far = ij.Plane((0, 0, 1.0), (0.3, 0, -1)), WALL
    scene, depth, _ = seen_by(CAMERA, near, far)
    light = np.asarray(ij.lit(scene, CAMERA, depth, (0, 0, 1.0)))
    assert not light[np.asarray(depth) < 1].any()
    assert light[np.asarray(depth) > 1.02].all()


def test_a_projector_beyond_a_plane_lights_nothing():
    floor = ij.Plane((0, 0.5, 0), (0, 1, 0))
    scene, depth, index = seen_by(CAMERA, ij.Sphere((0, 0, 1), 0.2), floor)
    below = np.asarray(ij.lit(scene, CAMERA, depth, (0, 0.6, 0)))
    assert not below.any()
    above = np.asarray(ij.lit(scene, CAMERA, depth, (0, 0.4, 0)))
    assert above[index == 1].mean() > 0.5


def test_a_plane_that_holds_camera_and_projector_hides_nothing():
    place, rng = np.array([0.1, 0.7, 0.3]), np.random.default_rng(0)
    turn = ij.RigidTransform(np.eye(3), place)
    camera = ij.PinholeCamera(80.0, 80.0, 31.5, 23.5, 64, 48, camera_from_world=turn)
    for _ in range(30):
        # Rounding puts them on either side of some, 3e-8 m away.
        projector, other = rng.uniform(-0.3, 0.3, 3), rng.uniform(-1, 1, 3)
        plane = ij.Plane(other - place, np.cross(projector, other))
        scene, depth, index = seen_by(camera, WALL, plane)
        light = np.asarray(ij.lit(scene, camera, depth, projector))
        assert light[index == 0].all()


def test_a_plane_hides_nothing_from_itself_at_a_grazing_view():
    floor = ij.Plane((0, 0.5, 0), (0, 1, 0))
    camera = ij.PinholeCamera(80.0, 80.0, 31.5, 0.5, 64, 48)
    scene, depth, index = seen_by(camera, floor)
    light = np.asarray(ij.lit(scene, camera, depth, (BASELINE, 0, 0)))
    np.testing.assert_array_equal(light, index == 0)


def test_pixels_without_a_surface_are_not_lit():
    scene, depth, index = seen_by(CAMERA, ij.Sphere((0, 0, 1), 0.2))
    light = np.asarray(ij.lit(scene, CAMERA, depth, (0, 0, 0)))
    np.testing.assert_array_equal(light, index == 0)


def test_bad_arguments_are_refused():
    scene, depth, _ = seen_by(CAMERA, WALL)
    with pytest.raises(ValueError, match="depth must have the shape"):
        ij.lit(scene, CAMERA, depth[:4], (0, 0, 0))
    with pytest.raises(ValueError, match="projector must be meters"):
        ij.lit(scene, CAMERA, depth, (0, 0))
