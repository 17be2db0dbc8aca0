import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.rounds import round_through
from tests.checks import angle_between
from tests.fit.scenes import CAMERA, SIGMA, camera_with, can, image, image_of


@pytest.mark.parametrize("degrees", [90.0, 60.0, 30.0])
def test_guess_is_close_enough_to_start_from(degrees):
    depth, mask = image(degrees)
    guess = CYLINDER.guesses(depth, mask, CAMERA, SIGMA)[0]
    truth = can(degrees)
    assert angle_between(guess.axis, truth.axis) < 3
    assert guess.radius == pytest.approx(0.04, rel=0.08)
    assert guess.height == pytest.approx(0.12, rel=0.15)


def test_second_guess_has_another_axis():
    depth, mask = image()
    first, second, *_ = CYLINDER.guesses(depth, mask, CAMERA, SIGMA)
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
    guesses = CYLINDER.guesses(depth, np.asarray(maps.mask), CAMERA, 0.005)
    assert min(angle_between(g.axis, truth.axis) for g in guesses) < 10


@pytest.mark.parametrize("axis", [(1.0, 0.7, 0.1), (0.1, 1.0, 0.1)])
@pytest.mark.parametrize("radius", [0.004, 0.006])
def test_a_rod_may_be_as_thin_as_what_a_region_is_reduced_by(radius, axis):
    truth = ij.Cylinder((0.0, 0.0, 0.5), axis, radius, 0.6)
    depth, mask = image_of(truth)
    guess = CYLINDER.guesses(depth, mask, CAMERA, SIGMA)[0]
    assert angle_between(guess.axis, truth.axis) < 1
    assert guess.radius == pytest.approx(radius, rel=0.5)


def test_longest_direction_of_a_rod_comes_before_its_noisy_normals():
    truth = ij.Cylinder((0.01, 0.02, 0.5), (0.6, 0.8, 0.1), 0.006, 0.1)
    maps = ij.render(truth, CAMERA)
    noise = np.random.default_rng(0).normal(0, 0.005, maps.depth.shape)
    depth = np.where(maps.mask, maps.depth + noise, 0)
    guess = CYLINDER.guesses(depth, np.asarray(maps.mask), CAMERA, 0.005)[0]
    assert angle_between(guess.axis, truth.axis) < 3


def arc(count):
    """Points on a third of a circle whose radius grows, and their places along it."""
    rng = np.random.default_rng(0)
    along, angle = rng.uniform(0.5, 0.7, count), rng.uniform(0, 2, count)
    radius = 0.04 + 0.2 * (along - 0.6)
    points = np.array([0.3, -0.2])[:, None] + radius * [np.cos(angle), np.sin(angle)]
    return points[None], along[None]


def test_circle_that_grows_is_found_among_outliers():
    points, along = arc(200)
    points[:, :, ::20] += 0.01
    found = round_through(points, np.ones(along.shape, bool), along)
    np.testing.assert_allclose(found.center, [[0.3, -0.2]], atol=1e-6)
    np.testing.assert_allclose(found.slope, 0.2, atol=1e-4)
    np.testing.assert_allclose(
        found.radius + found.slope * (0.6 - found.place), 0.04, atol=1e-6
    )


def test_too_few_points_make_no_circle():
    points, _ = arc(200)
    for count, is_circle in ((9, False), (10, True)):
        among = np.arange(200)[None] < count
        assert np.isfinite(round_through(points, among).radius) == is_circle


def test_row_of_pixels_gives_no_error():
    region = np.zeros((120, 160), bool)
    region[60, 20:140] = True
    CYLINDER.guesses(np.where(region, 0.5, 0), region, CAMERA, SIGMA)


def test_guess_sees_through_a_lens():
    camera = camera_with(distortion=(-0.3, 0.1, 0.002, 0.001, 0.0))
    maps = ij.render(can(), camera)
    noise = np.random.default_rng(0).normal(0, SIGMA, maps.depth.shape)
    depth = np.where(maps.mask, maps.depth + noise, 0)
    guess = CYLINDER.guesses(depth, np.asarray(maps.mask), camera, SIGMA)[0]
    assert angle_between(guess.axis, can().axis) < 3
    assert guess.radius == pytest.approx(0.04, rel=0.08)


def test_no_readings_give_no_guess():
    region = np.ones((120, 160), bool)
    assert not CYLINDER.guesses(np.zeros((120, 160)), region, CAMERA, SIGMA)


def test_the_far_end_of_a_pipe_is_seen_in_few_pixels():
    # One pixel in a hundred shows its cap; of most readings it would end at half of it.
    pipe = ij.Cylinder((0.0, 0.0, 1.5), (0.04, 0.03, 1.0), radius=0.2, height=5.0)
    maps = ij.render(pipe, CAMERA, outputs=("depth", "mask"))
    noise = np.random.default_rng(0).normal(0, SIGMA, maps.depth.shape)
    depth = (np.asarray(maps.depth) + noise).astype(np.float32)
    around = CYLINDER.guesses(depth, np.asarray(maps.mask), CAMERA, SIGMA)[1]
    far = around.center[2] + abs(around.axis[2]) * around.height / 2
    assert abs(far - 4.0) < 0.2
