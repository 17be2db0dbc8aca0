"""Readings, rays and blocks of pixels."""

import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.view import dense_stride, view_of
from tests.find.scenes import CAMERA, CAMERAS, seen

ROW, COL = np.mgrid[:120, :160]


def depths(seed=0):
    return np.random.default_rng(seed).uniform(0.5, 2, (120, 160)).astype(np.float32)


@pytest.mark.parametrize("name", CAMERAS)
def test_points_lie_on_the_rays_of_the_camera(name):
    camera, depth = CAMERAS[name], depths()
    view = seen(depth, camera)
    rays = camera.rays(jnp.asarray(ROW), jnp.asarray(COL), jnp.float32)
    origin, direction = (
        np.stack(np.broadcast_arrays(v.x, v.y, v.z), axis=-1)
        for v in (rays.origin, rays.direction)
    )
    np.testing.assert_allclose(
        view.points, origin + depth[..., None] * direction, atol=1e-6
    )
    unit = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    np.testing.assert_allclose(
        view.views, np.broadcast_to(unit, view.views.shape), atol=1e-6
    )


def test_nothing_is_read_where_there_is_no_reading():
    depth = depths()
    depth[10:20, 30:50] = 0
    view = seen(depth)
    np.testing.assert_array_equal(view.valid, depth > 0)
    assert not view.sigma[~view.valid].any()
    assert not view.linear[~view.valid].any()
    assert np.isfinite(view.points).all()


@pytest.mark.parametrize("name", CAMERAS)
def test_a_box_holds_projected_points_and_little_more(name):
    camera = CAMERAS[name]
    view = seen(depths(), camera)
    rng = np.random.default_rng(1)
    some = view.points[40:70, 50:90].reshape(-1, 3)[rng.permutation(1200)[:300]]
    box = view.box_around(some)
    uv = np.asarray(camera.project(jnp.asarray(some, jnp.float32)))
    inside = np.zeros(view.depth.shape, bool)
    inside[box] = True
    col, row = np.round(uv).astype(int).T
    assert inside[row, col].all()
    # A lens bends the rows and columns.
    size = (np.ptp(row) + 1) * (np.ptp(col) + 1)
    assert np.count_nonzero(inside) <= 1.3 * size


def test_a_box_around_what_is_not_in_the_image():
    view = seen(depths())
    assert view.box_around(np.array([[5.0, 0, 1]])) is None
    assert view.box_around(np.array([[0.0, 0, -1]])) is None
    whole = view.box_around(np.array([[0.0, 0, -1], [0, 0, 1]]))
    assert whole == (slice(0, 120), slice(0, 160))


@pytest.mark.parametrize(("most", "stride"), [(19_200, 1), (19_199, 2), (2_000, 4)])
def test_of_a_large_image_every_nth_pixel_is_searched(most, stride):
    depth = depths()
    view, whole = seen(depth, most_pixels=most), seen(depth)
    assert view.stride == stride
    assert view.depth.size <= most
    pick = np.s_[::stride, ::stride]
    np.testing.assert_array_equal(view.depth, depth[pick])
    np.testing.assert_array_equal(view.points, whole.points[pick])
    assert view.width(2.0) == pytest.approx(2.0 * stride / CAMERA.fx)


@pytest.mark.parametrize(("holes", "stride"), [(0.0, 1), (0.25, 1), (0.6, 2)])
def test_an_image_with_holes_is_searched_more_coarsely(holes, stride):
    rng = np.random.default_rng(0)
    depth = np.where(rng.random((90, 121)) < holes, 0, 1.0).astype(np.float32)
    depth[:, :40] = 0
    assert dense_stride(depth, 1) == stride


def test_of_a_block_another_pixel_shows_what_the_first_does_not():
    depth = np.zeros((5, 6), np.float32)
    depth[1, 2], depth[4, 5] = 2.0, 3.0
    camera = ij.PinholeCamera(100.0, 100.0, 0.0, 0.0, 6, 5)
    view = view_of(depth, camera, ij.ConstantNoise(0.001), 100, 2)
    expected = np.zeros((3, 3))
    expected[0, 1], expected[2, 2] = 2.0, 3.0
    np.testing.assert_array_equal(view.depth, expected)
    # The ray is that pixel's own.
    np.testing.assert_allclose([view.x[0, 1], view.y[0, 1]], [0.02, 0.01])
    agrees = view.agrees(np.where(depth == 0, 0.5, depth))
    assert agrees.sum() == 2
