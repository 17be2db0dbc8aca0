from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.numerics import eps
from tests.cases import CAMERAS
from tests.checks import all_finite, central_difference
from tests.rendering import exact
from tests.rendering.test_coverage import MORE, SHAPES


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


@pytest.mark.parametrize("name", [*SHAPES, *MORE])
def test_distance_is_that_of_the_silhouette(name, dtype):
    points, expected = points_and_distances(name)
    found, slopes, normal = distance_and_slopes(
        ij.Cylinder(*{**SHAPES, **MORE}[name]),
        CAMERAS["pinhole"](),
        jnp.asarray(points, dtype),
    )
    assert found.dtype == dtype
    # What the polygon's edges cut off, and image coordinates rounded to 4e-6 px.
    np.testing.assert_allclose(found, expected, atol=5e-4 + eps(dtype, 1024))
    assert all_finite(slopes)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, rtol=eps(dtype, 32))


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("camera_name", ["pinhole", "distorted"])
def test_derivative_is_that_of_central_differences(camera_name):
    camera = CAMERAS[camera_name]()
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


def test_without_an_outline_the_distance_is_infinite():
    camera = CAMERAS["pinhole"]()
    points = jnp.ones((200, 2))
    pipe = ij.Cylinder((0, 0, 0), (0, 0.2, 1), 1.0, 50.0)
    behind = ij.Cylinder((0.1, 0.1, -2.0), (0, 0.2, 1), 0.5, 1.0)
    for cylinder, expected in ((pipe, -np.inf), (behind, np.inf)):
        found, *slopes = distance_and_slopes(cylinder, camera, points)
        assert (np.asarray(found) == expected).all()
        assert all_finite(slopes)
