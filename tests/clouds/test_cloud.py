"""A cloud that is searched: thinned, with normals."""

import numpy as np
import pytest

from impostor_jax.clouds.cloud import cloud_of, spread_seeds
from tests.clouds.scenes import floor, wall


def test_few_points_stay_as_they_are():
    points = floor(np.random.default_rng(0), 500, 1.0) + np.array([5e5, 4e6, 100])
    cloud = cloud_of(points, None)
    np.testing.assert_array_equal(cloud.representative, np.arange(500))
    np.testing.assert_allclose(cloud.points + cloud.middle, points, atol=1e-9)


def test_many_points_are_thinned_evenly_and_each_has_its_own_stand_in():
    rng = np.random.default_rng(1)
    # Ten times as dense in one half.
    dense = floor(rng, 20000, 1.0) * [0.5, 1, 1] - [0.25, 0, 0]
    sparse = floor(rng, 2000, 1.0) * [0.5, 1, 1] + [0.25, 0, 0]
    points = np.concatenate([dense, sparse])
    cloud = cloud_of(points, None, most=1000)
    assert 500 < len(cloud) <= 1000
    left = np.count_nonzero(cloud.points[:, 0] + cloud.middle[0] < 0)
    assert left == pytest.approx(len(cloud) / 2, rel=0.2)
    away = points - (cloud.points + cloud.middle)[cloud.representative]
    # No farther than a voxel's diagonal.
    edge = np.sqrt(1.0 / len(cloud))
    assert np.linalg.norm(away, axis=1).max() < 2 * edge
    assert cloud.spacing == pytest.approx(edge, rel=0.5)


def test_normals_are_across_the_surface_and_face_the_origin():
    rng = np.random.default_rng(2)
    origin = np.array([0.0, 3.0, 0.0])
    points = wall(rng, 4000, (0, 0, 0), (0, 0, 1), 0.2, 1.0, (-1.2, 1.2), 0.001)
    origins = np.broadcast_to(origin, points.shape)
    cloud = cloud_of(points, origins)
    out = points * [1, 1, 0]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    cosine = np.sum(out * cloud.normals, axis=1)
    # In noise of a quarter of their spacing, 4 mm, they err by some degrees.
    assert np.degrees(np.arccos(np.median(cosine))) < 5
    assert np.mean(cosine > np.cos(np.radians(15))) > 0.97
    told = cloud_of(points, None, normals=-3 * out)
    np.testing.assert_allclose(told.normals, -out)


def test_noise_widens_the_neighborhood_of_a_normal():
    rng = np.random.default_rng(3)
    points = floor(rng, 20000, 1.0, noise=0.01)
    cloud = cloud_of(points, None)
    off = np.degrees(np.arccos(np.abs(cloud.normals[:, 2])))
    # Points are 7 mm apart: of the nearest 16 the plane would err by 30 degrees.
    assert np.median(off) < 8
    # What its neighbors scatter by is the noise.
    assert np.median(cloud.rough) == pytest.approx(0.01, rel=0.1)


def test_seeds_are_spread_over_all_places():
    rng = np.random.default_rng(4)
    lump = rng.normal(0, 0.01, (5000, 3))
    around = rng.uniform(-1, 1, (500, 3))
    seeds = spread_seeds(np.concatenate([lump, around]), 200, seed=0)
    assert 50 < len(seeds) <= 200
    assert np.mean(seeds < 5000) < 0.1
