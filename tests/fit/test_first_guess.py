import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.initialize import first_guesses
from impostor_jax.fit.segment import nearest_object
from tests.checks import angle_between
from tests.fit.scenes import CAMERA, SIGMA, can, image


@pytest.mark.parametrize("only_one", [False, True])
@pytest.mark.parametrize("degrees", [90.0, 60.0, 30.0])
def test_guess_is_close_enough_to_start_from(degrees, only_one):
    depth, mask = image(degrees)
    guess = first_guesses(depth, mask, CAMERA, SIGMA, only_one=only_one)[0]
    truth = can(degrees)
    assert angle_between(guess.axis, truth.axis) < 3
    assert guess.radius == pytest.approx(0.04, rel=0.08)
    assert guess.height == pytest.approx(0.12, rel=0.15)


def test_second_guess_has_another_axis():
    depth, mask = image()
    first, second, *_ = first_guesses(depth, mask, CAMERA, SIGMA)
    assert angle_between(first.axis, second.axis) > 9


@pytest.mark.parametrize(
    ("radius", "height"),
    [pytest.param(0.006, 0.1, id="rod"), pytest.param(0.06, 0.02, id="disc")],
)
def test_image_shows_an_axis_that_noise_hides_from_the_normals(radius, height):
    truth = ij.Cylinder((0.01, 0.02, 0.5), (0.6, 0.8, 0.1), radius, height)
    maps = ij.render(truth, CAMERA)
    noise = np.random.default_rng(0).normal(0, 0.005, maps.depth.shape)
    depth = np.where(maps.mask, maps.depth + noise, 0)
    guesses = first_guesses(depth, np.asarray(maps.mask), CAMERA, 0.005)
    assert min(angle_between(g.axis, truth.axis) for g in guesses) < 10


def test_row_of_pixels_gives_no_error():
    region = np.zeros((120, 160), bool)
    region[60, 20:140] = True
    first_guesses(np.where(region, 0.5, 0), region, CAMERA, SIGMA)


def test_guess_sees_through_a_lens():
    camera = ij.PinholeCamera(
        150.0, 150.0, 79.5, 59.5, 160, 120, distortion=(-0.3, 0.1, 0.002, 0.001, 0.0)
    )
    maps = ij.render(can(), camera)
    noise = np.random.default_rng(0).normal(0, SIGMA, maps.depth.shape)
    depth = np.where(maps.mask, maps.depth + noise, 0)
    guess = first_guesses(depth, np.asarray(maps.mask), camera, SIGMA)[0]
    assert angle_between(guess.axis, can().axis) < 3
    assert guess.radius == pytest.approx(0.04, rel=0.08)


def test_no_readings_give_no_guess():
    region = np.ones((120, 160), bool)
    assert not first_guesses(np.zeros((120, 160)), region, CAMERA, SIGMA)


def test_nearest_object_is_found_before_a_wall_and_a_farther_object():
    depth, mask = image()
    depth = depth.copy()
    # Farther away, in front of the wall, and larger.
    depth[:, :30] = 0.5
    # Nearer, but a speck.
    depth[2:5, 100:103] = 0.1
    found = nearest_object(depth, SIGMA, 1 / 150, 50)
    assert (found & mask).sum() > 0.97 * (found | mask).sum()


def test_what_is_seen_through_a_hole_is_not_in_front():
    depth = np.full((120, 160), 0.4, np.float32)
    depth[40:80, 60:100] = 0.8
    found = nearest_object(depth, SIGMA, 1 / 150, 50)
    assert not found[60, 80]
    assert found[10, 10]
