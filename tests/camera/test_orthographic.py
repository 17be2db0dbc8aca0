import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.numerics import eps

CAMERA = ij.OrthographicCamera(100.0, 80.0, 31.5, 23.0, 64, 48)


def test_cylinder_along_the_view_is_a_disc_at_the_depth_of_its_cap(dtype):
    shape = ij.Cylinder(*(np.asarray(v, dtype) for v in (
        (0.02, -0.03, 3.0), (0, 0, 1), 0.15, 1.0)))  # fmt: skip
    maps = ij.render(shape, CAMERA)
    row, col = np.indices((48, 64))
    x, y = (col - 31.5) / 100, (row - 23.0) / 80
    inside = np.hypot(x - 0.02, y + 0.03) < 0.15
    np.testing.assert_array_equal(np.asarray(maps.mask), inside)
    depth = np.asarray(maps.depth)
    np.testing.assert_allclose(depth[inside], 2.5, rtol=eps(dtype, 4))
    np.testing.assert_allclose(np.asarray(maps.normal)[inside][:, 2], -1)


def test_distance_changes_depth_and_nothing_else(dtype):
    near, far = (
        ij.render(
            ij.Cylinder(*(np.asarray(v, dtype) for v in (
                (0.02, -0.03, z), (0.5, 0.3, 0.6), 0.1, 0.3))), CAMERA)
        for z in (1.0, 5.0)
    )  # fmt: skip
    np.testing.assert_array_equal(np.asarray(near.mask), np.asarray(far.mask))
    mask = np.asarray(near.mask)
    apart = np.asarray(far.depth)[mask] - np.asarray(near.depth)[mask]
    np.testing.assert_allclose(apart, 4.0, atol=eps(dtype, 64))


def test_box_of_the_outline_is_that_of_the_mask():
    rng = np.random.default_rng(0)
    for _ in range(20):
        shape = ij.Cylinder(
            (*rng.uniform(-0.2, 0.2, 2), 2.0), rng.normal(size=3),
            rng.uniform(0.03, 0.2), rng.uniform(0.05, 0.5),
        )  # fmt: skip
        rows, cols = np.nonzero(np.asarray(ij.render(shape, CAMERA).mask))
        box = ij.outline_box(shape, CAMERA)
        # Narrow tips may reach into a box between the centers of its last pixels.
        for found, low, high in (
            ((box.first_row, box.last_row), rows.min(), rows.max()),
            ((box.first_col, box.last_col), cols.min(), cols.max()),
        ):
            assert low - 2 <= int(found[0]) <= low
            assert high <= int(found[1]) <= high + 2


def test_what_needs_a_center_refuses_the_camera():
    shape = ij.Cylinder((0, 0, 2), (0, 1, 0), 0.1, 0.3)
    message = "camera must have a center where its rays start.*OrthographicCamera"
    with pytest.raises(ValueError, match=message):
        ij.outline(shape, CAMERA)
    with pytest.raises(ValueError, match=message):
        ij.coverage(shape, CAMERA)
    with pytest.raises(ValueError, match=message):
        ij.signed_distance(shape, CAMERA, jnp.zeros((1, 2)))


def test_bad_scale_is_named():
    with pytest.raises(ValueError, match="fx must be a positive number in pixels per"):
        ij.OrthographicCamera(0.0, 80.0, 31.5, 23.0, 64, 48)
