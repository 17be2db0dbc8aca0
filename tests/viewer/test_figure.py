import numpy as np

import impostor_jax as ij
from impostor_jax.viewer.figure import fitted_outline
from tests.fit.scenes import CAMERA, can


def test_outline_runs_along_the_edge_of_the_mask():
    outline = fitted_outline(can(), CAMERA)
    assert outline is not None
    mask = np.asarray(ij.render(can(), CAMERA, outputs=("mask",)).mask)
    rows, cols = np.nonzero(mask)
    assert abs(outline[:, 0].min() - cols.min()) < 1
    assert abs(outline[:, 1].max() - rows.max()) < 1
    np.testing.assert_array_equal(outline[0], outline[-1])


def test_cylinder_around_the_camera_has_no_outline():
    pipe = ij.Cylinder((0, 0, 0), (0, 0, 1), 1, 9)
    assert fitted_outline(pipe, CAMERA) is None
