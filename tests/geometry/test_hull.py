"""Hulls of discs and balls, against what can be written down."""

import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.geometry.hull import BallHull, DiscHull
from impostor_jax.numerics import eps


def disc(center, axis, radius):
    return DiscHull(*(jnp.asarray([x], float) for x in (center, axis, radius)))


@pytest.mark.parametrize(
    ("axis", "half"),
    [
        pytest.param((0, 0, 1), (2, 2, 0), id="across z"),
        pytest.param((0.6, 0, 0.8), (1.6, 2, 1.2), id="turned about y"),
        # Its last component is lost in 1 - (axis . z)^2.
        pytest.param((1e-4, 0, 1 - 5e-9), (2, 2, 2e-4), id="nearly across z"),
    ],
)
def test_box_of_a_disc(axis, half, dtype):
    low, high = disc((1, -2, 4), axis, 2).box()
    within = eps(dtype, 40) * 6
    np.testing.assert_allclose(low, np.array((1, -2, 4)) - half, atol=within)
    np.testing.assert_allclose(high, np.array((1, -2, 4)) + half, atol=within)


def test_ball_goes_through_the_farthest_rims(dtype):
    ends = (jnp.array([0.0, 0, 4]), jnp.array([0.0, 0, 10]))
    hull = DiscHull.of_ends(
        *ends, jnp.array([0.0, 0, 1]), *map(jnp.asarray, (1.0, 4.0))
    )
    center, radius = hull.ball()
    np.testing.assert_array_equal(center, (0, 0, 7))
    np.testing.assert_allclose(radius, 5, rtol=eps(dtype, 64))


def test_image_of_a_disc_seen_head_on_and_edge_on(dtype):
    sides, nearest, farthest = disc((1, 0, 4), (0, 0, 1), 2).reach()
    np.testing.assert_allclose(sides, (0.25, 0.5, 0.75, 0.5), rtol=eps(dtype, 8))
    np.testing.assert_array_equal((nearest, farthest), (4, 4))
    # In the plane through the camera across y: a line as wide as the tangents to it.
    sides, nearest, farthest = disc((0, 0, 5), (0, 1, 0), 3).reach()
    np.testing.assert_allclose(sides, (0.75, 0, 0.75, 0), atol=eps(dtype, 8))
    np.testing.assert_array_equal((nearest, farthest), (2, 8))


def test_image_of_a_ball(dtype):
    ball = BallHull(jnp.array([0.0, 0, 5]), jnp.asarray(3.0))
    sides, nearest, farthest = ball.reach()
    np.testing.assert_allclose(sides, 0.75 * np.ones(4), rtol=eps(dtype, 8))
    np.testing.assert_array_equal((nearest, farthest), (2, 8))
    assert not np.any(BallHull(jnp.array([0.0, 0, 1]), jnp.asarray(3.0)).reach()[0])


def test_corners_of_a_cuboid_are_where_its_faces_meet():
    rng = np.random.default_rng(0)
    skew = np.linalg.qr(rng.normal(size=(3, 3)))[0] + 0.1 * rng.normal(size=(3, 3))
    ends = jnp.sort(jnp.asarray(rng.normal(size=(2, 3))), axis=0)
    shift = jnp.asarray(rng.normal(size=3))
    points = DiscHull.of_cuboid(*ends, jnp.asarray(skew), shift).centers
    own = np.asarray((points - shift[None]) @ skew)
    for k in range(3):
        found = np.sort(own[:, k]).reshape(2, 4).T
        np.testing.assert_allclose(found, np.tile(ends[:, k], (4, 1)), atol=1e-5)
    assert len(np.unique(np.round(own, 3), axis=0)) == 8
