"""Outlines on the picture of a page."""

import re

import numpy as np

import impostor_jax as ij
from impostor_jax.page.picture import outline_path
from tests.fit.scenes import CAMERA


def curves(path):
    """Points (u, v) of each closed curve of a path."""
    return [
        np.array([point.split() for point in part.split("L")], float)
        for part in re.findall(r"M([^MZ]*)Z", path)
    ]


def test_outline_of_a_mask_runs_between_its_pixels_and_the_others():
    box = ij.Box((0.02, 0.01, 0.5), np.eye(3), (0.2, 0.1, 0.1))
    mask = np.asarray(ij.render(box, CAMERA, outputs=("mask",)).mask)
    (curve,) = curves(outline_path(box, CAMERA))
    rows, cols = np.nonzero(mask)
    assert curve[:, 0].min() == cols.min() - 0.5
    assert curve[:, 0].max() == cols.max() + 0.5
    assert curve[:, 1].min() == rows.min() - 0.5
    assert curve[:, 1].max() == rows.max() + 0.5


def test_outline_closes_where_a_shape_leaves_the_image():
    wall = ij.Box((0.0, 0.0, 1.0), np.eye(3), (9.0, 0.2, 0.1))
    (curve,) = curves(outline_path(wall, CAMERA))
    assert curve[:, 0].min() == -0.5
    assert curve[:, 0].max() == CAMERA.width - 0.5


def test_a_shape_that_is_not_seen_has_no_outline():
    behind = ij.Box((0.0, 0.0, -1.0), np.eye(3), (0.2, 0.1, 0.1))
    assert outline_path(behind, CAMERA) == ""
