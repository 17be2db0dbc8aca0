"""Planes of a cloud."""

import numpy as np
import pytest

from impostor_jax.clouds.cloud import cloud_of
from impostor_jax.clouds.planes import planes_of
from tests.clouds.scenes import ball, floor, wall


# Or noise as large as the distance of neighbors.
@pytest.mark.parametrize("noise", [0.0005, 0.004])
def test_a_floor_is_taken_and_what_stands_on_it_is_left(noise):
    rng = np.random.default_rng(0)
    can = wall(rng, 3000, (0, 0, 0.1), (0, 0, 1), 0.04, 0.2, noise=noise)
    points = np.concatenate([floor(rng, 20000, 1.0, noise=noise), can])
    planes = planes_of(cloud_of(points, None))
    assert len(planes.points) == 1
    assert abs(planes.normals[0, 2]) == pytest.approx(1, abs=1e-4)
    assert np.mean(planes.label[:20000] == 1) > 0.97
    # But for what touches it.
    high = points[20000:, 2] > max(0.01, 6 * noise)
    assert np.mean(planes.label[20000:][high] == 1) < 0.01


def test_two_walls_that_meet_are_two_and_their_edge_is_no_one_elses():
    rng = np.random.default_rng(1)
    aside = np.array([0.5, 0, 0])
    first = floor(rng, 8000, 1.0, noise=0.001) + aside
    second = (floor(rng, 8000, 1.0, noise=0.001) + aside)[:, [2, 1, 0]]
    planes = planes_of(cloud_of(np.concatenate([first, second]), None))
    assert len(planes.points) == 2
    assert abs(planes.normals[0] @ planes.normals[1]) < 1e-2
    assert np.mean(planes.label > 0) > 0.97


@pytest.mark.parametrize("noise", [0.0005, 0.004])
def test_strips_of_a_pipe_and_a_ball_are_no_planes(noise):
    rng = np.random.default_rng(2)
    pipe = wall(rng, 20000, (0, 0, 0), (0, 1, 0.2), 0.3, 3.0, noise=noise)
    points = np.concatenate([pipe, ball(rng, 8000, (2, 0, 0), 0.4, noise)])
    planes = planes_of(cloud_of(points, None))
    assert not planes.label.any()


def test_a_cloud_without_planes_has_none():
    points = np.random.default_rng(3).uniform(-1, 1, (5000, 3))
    planes = planes_of(cloud_of(points, None))
    assert planes.points.shape == (0, 3)
    assert not planes.label.any()
