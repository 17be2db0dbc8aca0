from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.oracle.outline import outline_distance
from impostor_jax.numerics import eps
from tests.cases import CAMERAS
from tests.checks import all_finite, central_difference
from tests.groups import FULL
from tests.rendering import exact
from tests.rendering.test_coverage import MORE, SHAPES, traced


@eqx.filter_jit
def distance_and_slopes(cylinder, camera, points):
    """Distances, and their derivatives in the cylinder and in their own points."""

    def twice(cylinder, shift):
        distance = ij.signed_distance(cylinder, camera, points + shift[None])
        return distance, distance

    (slopes, normal), distance = jax.jacfwd(twice, (0, 1), has_aux=True)(
        cylinder, jnp.zeros_like(points[0])
    )
    return distance, slopes, normal


@cache
def points_and_distances(name, camera_name="pinhole"):
    """Points all over and around the image, near the outline and on it."""
    shape, camera = {**SHAPES, **MORE}[name], CAMERAS[camera_name]()
    if camera.ray_field is None:
        polygon = exact.silhouette(shape, camera, 1600)
    else:
        polygon = exact.through_lens(exact.silhouette(shape, count=1600), camera, 1.0)
    rng = np.random.default_rng(0)
    everywhere = rng.uniform((-10, -10), (74, 58), (100, 2))
    vertices = polygon[rng.integers(0, len(polygon), 200)]
    seen = vertices[(np.abs(vertices - (32, 24)) < (40, 30)).all(1)]
    noise = rng.normal(size=seen.shape) * rng.choice([0, 0.01, 0.5], (len(seen), 1))
    points = np.concatenate([everywhere, seen + noise])
    # As many for each shape, for one compiled function; representable in float32.
    points = points[np.arange(200) % len(points)].astype(np.float32).astype(float)
    return points, exact.signed_distance(polygon, points)


@FULL
@pytest.mark.parametrize("name", [*SHAPES, *MORE])
def test_distance_is_that_of_the_silhouette(name, dtype):
    points, expected = points_and_distances(name)
    found, slopes, normal = distance_and_slopes(
        ij.Cylinder(*{**SHAPES, **MORE}[name]),
        traced(CAMERAS["pinhole"]()),
        jnp.asarray(points, dtype),
    )
    assert found.dtype == dtype
    # What the polygon's edges cut off, and image coordinates rounded to 4e-6 px.
    np.testing.assert_allclose(found, expected, atol=5e-4 + eps(dtype, 1024))
    assert all_finite(slopes)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, rtol=eps(dtype, 32))


@FULL
@pytest.mark.parametrize(
    ("center", "axis", "radius", "height", "focal"),
    [
        pytest.param((0.2, 0.1, 3), (0.3, 0.8, 0.2), 0.5, 1.0, 60, id="ordinary"),
        pytest.param((1.1, 0.5, 1e4), (0.3, 0.8, 0.2), 1, 2, 1e5, id="afar, long lens"),
        pytest.param((0.2, 0.1, 3), (0.3, 0.1, 0.9), 1, 1e-4, 60, id="disc"),
        pytest.param((0, 0.1, 3), (1e-7, 1, 0), 1, 1e-4, 60, id="disc, edge on"),
        pytest.param((0.2, 0.1, 3), (0.3, 0.8, 0.2), 1e-3, 2, 60, id="wire"),
        pytest.param((0.1, 0.2, 3), (1e-7, 0, 1), 0.5, 2, 60, id="end on"),
        pytest.param((1e-6, 0, 2e-6), (0.3, 1, 0), 1e-6, 3e-6, 30, id="micrometers"),
        pytest.param((0, 1e6, 3e6), (0.3, 1, 0), 1e6, 3e6, 60, id="megameters"),
    ],
)
def test_distance_at_the_extremes_is_the_oracles(
    center, axis, radius, height, focal, dtype
):
    camera = ij.PinholeCamera(focal, focal, 31.5, 23.5, 64, 48)
    shape = ij.Cylinder(center, axis, radius, height)
    place = np.array(camera.project(shape.center[None]))[0]
    shifts = np.random.default_rng(0).normal(size=(200, 2)) * 10
    points = jnp.asarray(place + shifts, dtype)
    found, slopes, _ = distance_and_slopes(shape, traced(camera), points)
    assert all_finite(slopes)
    fields = (shape.center, shape.axis, shape.radius, shape.height)
    fields = [np.asarray(field, float) for field in fields]
    for point, distance in list(zip(points, found, strict=True))[:3]:
        seen = (np.asarray(point, float) - (31.5, 23.5)) / focal
        exact = focal * float(outline_distance(seen, *fields))
        # Rounding of the points, and of a center afar as the lens enlarges it.
        spacing = eps(dtype, 8) * max(64, focal)
        assert float(distance) == pytest.approx(exact, abs=spacing)


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("camera_name", ["pinhole", "distorted"])
def test_derivative_is_that_of_central_differences(camera_name):
    camera = traced(CAMERAS[camera_name]())
    points, expected = points_and_distances("oblique", camera_name)
    points, at = jnp.asarray(points), ij.Cylinder(*SHAPES["oblique"])
    across = jnp.asarray(exact.tangents(at.axis)[1])
    tangent = ij.Cylinder((0.2, -0.3, 0.5), across, 0.3, 0.4)
    distance, slopes, _ = distance_and_slopes(at, camera, points)
    np.testing.assert_allclose(distance, expected, atol=1e-3)
    found = sum(
        (slope * t[None]).reshape(len(points), -1).sum(1)
        for slope, t in zip(
            jax.tree.leaves(slopes), jax.tree.leaves(tangent), strict=True
        )
    )
    numeric = central_difference(
        lambda c: distance_and_slopes(c, camera, points)[0], at, tangent
    )
    wrong = np.abs(found - numeric) > 1e-4 * np.abs(numeric).max()
    # On the outline's medial axis the nearest point jumps.
    assert wrong.sum() <= 1


@FULL
def test_without_an_outline_the_distance_is_infinite():
    camera = traced(CAMERAS["pinhole"]())
    points = jnp.ones((200, 2))
    pipe = ij.Cylinder((0, 0, 0), (0, 0.2, 1), 1.0, 50.0)
    behind = ij.Cylinder((0.1, 0.1, -2.0), (0, 0.2, 1), 0.5, 1.0)
    for cylinder, expected in ((pipe, -np.inf), (behind, np.inf)):
        found, *slopes = distance_and_slopes(cylinder, camera, points)
        assert (np.asarray(found) == expected).all()
        assert all_finite(slopes)


@FULL
def test_what_is_far_outside_the_image_has_a_positive_distance(dtype):
    # Its outline, pulled onto one circle around the image, once had a random sign.
    points = np.random.default_rng(0).uniform((-10, -10), (74, 58), (200, 2))
    points = jnp.asarray(points, dtype)
    for center in ((24.5, 72.8, 7.7), (0.26, -32.2, 2.94), (5e3, 0, 1.0)):
        shape = ij.Cylinder(center, (0.3, 0.2, 0.9), 1.0, 2.0)
        found, *slopes = distance_and_slopes(shape, CAMERAS["pinhole"](), points)
        assert (np.asarray(found) > 200).all()
        assert all_finite(slopes)
