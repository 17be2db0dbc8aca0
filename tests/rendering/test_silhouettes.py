"""Silhouettes: each shape as if alone, and beyond the image's border."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from tests.groups import FULL

WIDTH, HEIGHT = 45, 37
CAMERA = ij.PinholeCamera(40.0, 42.0, 21.3, 18.2, WIDTH, HEIGHT)
MARGIN = (HEIGHT, WIDTH)
WIDE = ij.PinholeCamera(40.0, 42.0, 21.3 + WIDTH, 18.2 + HEIGHT, 3 * WIDTH, 3 * HEIGHT)


def cylinders():
    """One in view, one across the border, one behind, one that reaches behind."""
    center = jnp.array([[0.0, 0, 1], [0.6, 0.1, 1.1], [0, 0, -2.0], [0.3, 0.5, 1]])
    axis = jnp.array([[0.2, 1.0, 0.1], [1.0, 0.3, 0.2], [0, 1.0, 0], [0.5, 0.2, 1]])
    radius, height = jnp.array([0.1, 0.15, 0.2, 0.1]), jnp.array([0.5, 0.7, 1.0, 6.0])
    return ij.Cylinder(center, axis, radius, height)


def alone(shapes, camera):
    masks = [
        ij.render(jax.tree.map(lambda x, k=k: x[k], shapes), camera, ("mask",)).mask
        for k in range(shapes.batch_shape[0])
    ]
    return np.stack(masks)


def test_silhouettes_are_the_masks_of_each_shape_alone():
    shapes = cylinders()
    found = ij.silhouettes(shapes, CAMERA)
    expected = alone(shapes, CAMERA)
    np.testing.assert_array_equal(found.mask, expected)
    np.testing.assert_array_equal(found.count, expected.sum(axis=(1, 2)))
    assert list(found.count > 0) == [True, True, False, True]


@FULL
def test_a_margin_counts_what_the_border_cuts_off():
    shapes = cylinders()
    found = ij.silhouettes(shapes, CAMERA, MARGIN)
    wide = alone(shapes, WIDE)
    np.testing.assert_array_equal(found.mask, alone(shapes, CAMERA))
    np.testing.assert_array_equal(found.count, wide.sum(axis=(1, 2)))
    for k in (0, 1, 3):
        row, col = np.nonzero(wide[k])
        box = jax.tree.map(lambda x, k=k: int(x[k]), found.box)
        assert (box.first_row, box.last_row) == (row.min() - HEIGHT, row.max() - HEIGHT)
        assert (box.first_col, box.last_col) == (col.min() - WIDTH, col.max() - WIDTH)
    assert found.box.last_row[2] < found.box.first_row[2]


def test_what_reaches_behind_the_camera_is_counted_in_the_whole_margin():
    found = ij.silhouettes(cylinders(), CAMERA, MARGIN)
    assert found.count[3] > found.mask[3].sum() > 0


@FULL
def test_a_lens_bends_the_image_and_not_its_margin():
    lens = ij.PinholeCamera(
        40.0, 42.0, 21.3, 18.2, WIDTH, HEIGHT, distortion=(-0.2, 0.05, 0, 0, 0)
    )
    shapes = cylinders()
    found, straight = (ij.silhouettes(shapes, c, MARGIN) for c in (lens, CAMERA))
    np.testing.assert_array_equal(found.mask, alone(shapes, lens))
    inside = [np.asarray(s.mask).sum(axis=(1, 2)) for s in (found, straight)]
    np.testing.assert_array_equal(found.count - inside[0], straight.count - inside[1])
    assert (inside[0] != inside[1]).any()


def test_silhouettes_of_a_posed_camera():
    turn = ij.RigidTransform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.1, 0, 0])
    posed = ij.PinholeCamera(
        40.0, 42.0, 21.3, 18.2, WIDTH, HEIGHT, camera_from_world=turn
    )
    shapes = cylinders()
    found = ij.silhouettes(shapes, posed)
    np.testing.assert_array_equal(found.mask, alone(shapes, posed))


@pytest.mark.parametrize("margin", [(-1, 0), (0, -3)])
def test_a_negative_margin_is_refused(margin):
    with pytest.raises(ValueError, match="margin must not be negative"):
        ij.silhouettes(cylinders(), CAMERA, margin)


def test_a_single_shape_has_one_silhouette():
    several = ij.silhouettes(cylinders(), CAMERA)
    one = ij.silhouettes(jax.tree.map(lambda x: x[0], cylinders()), CAMERA)
    jax.tree.map(lambda x, y: np.testing.assert_array_equal(x, y[0]), one, several)


def test_a_batch_of_two_axes_is_refused():
    square = jax.tree.map(lambda x: x.reshape(2, 2, *x.shape[1:]), cylinders())
    with pytest.raises(ValueError, match=r"shapes must be primitives, single ones or"):
        ij.silhouettes(square, CAMERA)
