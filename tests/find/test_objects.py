"""Objects, and what creases cut them into."""

import numpy as np

import impostor_jax as ij
from impostor_jax.find.normals import normals_of
from impostor_jax.find.objects import creases, numbered, objects_of
from tests.find.scenes import image_of, seen


def box(x, z):
    return ij.Box((x, 0.0, z), np.eye(3), (0.12, 0.2, 0.1))


def test_boxes_with_a_jump_between_them_are_two_objects():
    image = image_of([box(-0.05, 0.5), box(0.05, 0.56)])
    view = seen(image.depth)
    labels = objects_of(view, view.valid, 1.0, 50)
    assert labels.max() == 2
    for owner in range(2):
        own = labels[image.owner == owner]
        number = np.bincount(own)[1:].argmax() + 1
        assert np.mean(own == number) > 0.95
    # The jump belongs to what is in front.
    assert set(labels[60][image.owner[60] == 0]) == {1}


def test_boxes_that_are_as_near_are_one_object():
    image = image_of([box(-0.05, 0.5), box(0.05, 0.5)])
    view = seen(image.depth)
    assert objects_of(view, view.valid, 1.0, 50).max() == 1


def test_a_slanted_plane_is_one_object_whatever_the_noise_is_said_to_be():
    image = image_of([ij.Plane((0.0, 0.0, 0.6), (0.7, 0.0, -0.714))], sigma=0.003)
    view = seen(image.depth)
    assert np.mean(objects_of(view, view.valid, 3.0, 50) == 1) > 0.98


def test_the_largest_is_the_first_and_small_ones_have_no_number():
    inside = np.zeros((20, 30), bool)
    inside[:3, :3] = inside[10:18, 5:15] = inside[:2, 20:22] = True
    labels = numbered(inside, 9)
    np.testing.assert_array_equal(np.unique(labels[10:18, 5:15]), 1)
    np.testing.assert_array_equal(np.unique(labels[:3, :3]), 2)
    assert np.count_nonzero(labels) == 89


def test_creases_cut_cans_that_touch():
    cans = [
        ij.Cylinder((x, 0.0, 0.4), (0.0, 1.0, 0.0), 0.05, 0.2) for x in (-0.05, 0.05)
    ]
    image = image_of(cans)
    view = seen(image.depth)
    whole = objects_of(view, view.valid, 1.0, 50)
    assert whole.max() == 1
    labels = numbered((whole > 0) & ~creases(view, normals_of(view, view.valid)), 50)
    numbers = []
    for owner in range(2):
        own = labels[image.owner == owner]
        numbers.append(np.bincount(own)[1:].argmax() + 1)
        assert np.mean(own == numbers[-1]) > 0.75
        # Nothing of the other.
        assert np.mean(image.owner[labels == numbers[-1]] == owner) > 0.99
    assert numbers[0] != numbers[1]


def test_a_can_alone_has_no_creases():
    image = image_of([ij.Cylinder((0.0, 0.0, 0.4), (0.0, 1.0, 0.0), 0.05, 0.2)])
    view = seen(image.depth)
    found = creases(view, normals_of(view, view.valid))
    assert found[image.owner == 0].mean() < 0.02
