"""What stands out of a wall through its middle, and what is only in front of it."""

import numpy as np

import impostor_jax as ij
from impostor_jax.find.bulge import bulging
from impostor_jax.find.evidence import weighed
from tests.find.scenes import WALL, image_of, scene_of, wall_of

POST = ij.Cylinder((0.0, 0.0, 0.4), (0.0, 1.0, 0.0), 0.03, 0.12)


def beside(x, z, radius=0.015):
    return ij.Cylinder((x, 0.0, z), (0.0, 1.0, 0.0), radius, 0.12)


def bulge_of(shapes, wall=POST):
    image = image_of([*shapes, WALL])
    scene = scene_of(image, free=image.owner < len(shapes))
    return bulging(scene, weighed(scene, wall_of(wall)))


def test_the_edge_of_a_box_stands_out_of_the_wall_through_its_faces():
    turned = np.sqrt(0.5) * np.array([[1.0, 0, 1], [0, 2**0.5, 0], [-1, 0, 1]])
    box = ij.Box((0.0, 0.0, 0.4), turned, (0.05, 0.12, 0.05))
    assert 0.1 < bulge_of([box]) < 0.5


def test_a_post_has_no_bulge_whatever_is_in_front_of_it():
    near = ij.Box((0.0, 0.0, 0.3), np.eye(3), (0.02, 0.02, 0.02))
    assert bulge_of([POST]) == 0
    assert bulge_of([POST, near]) == 0


def test_a_hoop_around_a_post_is_no_bulge():
    hoop = ij.Cylinder((0.0, 0.0, 0.4), (0.0, 1.0, 0.0), 0.036, 0.03)
    assert bulge_of([POST, hoop]) == 0


def test_what_touches_a_post_on_one_side_or_both_is_no_bulge_of_it():
    # Between it and the camera, so that the post is hidden from where they touch.
    left, right = (
        beside(0.045 * np.sin(a), 0.4 - 0.045 * np.cos(a)) for a in (-0.9, 0.9)
    )
    assert bulge_of([POST, left]) < 0.03
    assert bulge_of([POST, left, right]) < 0.03
