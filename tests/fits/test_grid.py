"""The grid that coordinates were rounded to."""

import itertools

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fits.grid import rounding_of
from tests.groups import FULL, OF_POINTS, RELEASE

pytestmark = OF_POINTS


def cloud(count=500):
    return np.random.default_rng(0).uniform(-3, 3, (count, 3))


@pytest.mark.parametrize("step", [0.00025, 0.001, 0.01])
def test_a_grid_is_found(step):
    points = np.round(cloud() / step) * step + np.array([0.5, 12.0, 3.0])
    assert rounding_of(points, points.dtype) == pytest.approx(step / np.sqrt(12))
    # Stored in single precision, too.
    rounded = points.astype(np.float32)
    found = rounding_of(rounded.astype(float), rounded.dtype)
    assert found == pytest.approx(step / np.sqrt(12), rel=0.02)


def test_without_a_grid_there_is_the_spacing_of_the_type():
    points = cloud()
    assert rounding_of(points, np.dtype(np.float64)) < 1e-15
    found = rounding_of(points, np.dtype(np.float32))
    assert found == pytest.approx(3 * 2**-23 / np.sqrt(12), rel=0.1)


def test_few_points_show_no_grid():
    points = np.round(cloud(15), 3)
    assert rounding_of(points, points.dtype) < 1e-15


def stem(random, count=3000):
    """Near half of a stem of 0.18 m, 10 m away, and where it is seen from."""
    origin, center, radius = np.array([0, 0, 1.7]), np.array([4.0, 9.0, 1.5]), 0.18
    axis = np.array([0.03, -0.02, 1.0]) / np.linalg.norm([0.03, -0.02, 1.0])
    normal = random.normal(size=(3 * count, 3))
    normal -= (normal @ axis)[:, None] * axis
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = random.uniform(-1.5, 1.5, (3 * count, 1))
    points = center + height * axis + radius * normal
    faces = np.sum((points - origin) * normal, axis=1) < 0
    points = points[faces][:count]
    ray = (points - origin) / np.linalg.norm(points - origin, axis=1, keepdims=True)
    return points + ray * random.normal(0, 0.003, (len(points), 1)), ray, origin


@FULL
@pytest.mark.parametrize(
    "kind", ["grid", "all directions", pytest.param("beam", marks=RELEASE)]
)
def test_points_that_err_across_their_rays(kind):
    random = np.random.default_rng(3)
    points, ray, origin = stem(random)
    if kind == "grid":
        points, across = np.round(points, 3), 0.001 / np.sqrt(12)
    else:
        across = 0.003 if kind == "all directions" else 0.001
        off = random.normal(0, across, points.shape)
        points = points + off - np.sum(off * ray, axis=1, keepdims=True) * ray
    fit = ij.fit_cylinder_to_points(points, origin, sigma=0.003)
    assert fit.success
    std = float(fit.std.radius)
    assert std < 0.0005
    assert abs(float(fit.cylinder.radius) - 0.18) < 3 * std
    assert float(fit.across.deviation) == pytest.approx(across, rel=0.15)


@FULL
def test_a_grid_adds_to_what_a_sensor_is_said_to_err_by():
    # Taken for exact, the points of a sensor with exact rays were 0.25 mm off.
    points, _, origin = stem(np.random.default_rng(3))
    sensor = ij.ConstantNoise(0.003, across=0.0)
    fit = ij.fit_cylinder_to_points(np.round(points, 3), origin, sigma=sensor)
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.18) < 3 * float(fit.std.radius) < 3e-4
    assert float(fit.across.deviation) == pytest.approx(0.001 / np.sqrt(12), rel=1e-3)


@FULL
@pytest.mark.parametrize("sigma", [None, 0.003])
def test_points_far_off_in_single_precision_are_on_a_grid(sigma):
    # Of 3.9 mm. The least noise that can be told was taken for 95 mm there, and radii
    # came out wrong by nine of their deviations.
    points, _, origin = stem(np.random.default_rng(4))
    offset = np.array([5e4, 0.0, 0.0])
    far = (points + offset).astype(np.float32)
    for given in ((far,), (far, origin + offset)):
        fit = ij.fit_cylinder_to_points(*given, sigma=sigma)
        assert fit.success
        std = float(fit.std.radius)
        assert abs(float(fit.cylinder.radius) - 0.18) < 4 * std < 0.002


def test_what_a_file_rounded_is_told_though_it_was_widened():
    # In coordinates of a map 0.5 m remain: 3 of 16 stems came out wrong by 1e4 and more
    # of their deviations.
    points = (stem(np.random.default_rng(4))[0] + [5e5, 5.4e6, 300]).astype(np.float32)
    for given, sigma in itertools.product(
        (points, points.astype(float)), (0.003, None)
    ):
        with pytest.raises(ValueError, match=r"float32 rounds by 0\.64 m"):
            ij.fit_cylinder_to_points(given, sigma=sigma)
