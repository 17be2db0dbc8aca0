import numpy as np
import pytest
from matplotlib.path import Path

import impostor_jax as ij
from impostor_jax.viewer.figure import fitted_outline, overlay_figure
from tests.fit.scenes import CAMERA, SIGMA, can, image_of
from tests.fit.test_frustum import cup
from tests.fit.test_sphere import ball
from tests.groups import SMALL_IMAGES


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param(can(), id="cylinder"),
        pytest.param(ball(), id="sphere"),
        pytest.param(
            ij.Cylinder((0.2, 0.25, 0.1), (0.1, 0, 1), 0.15, 1.0), id="reaching behind"
        ),
    ],
)
def test_outline_holds_the_pixels_that_show_the_shape(shape):
    outline = fitted_outline(shape, CAMERA)
    assert outline is not None
    mask = np.asarray(ij.render(shape, CAMERA, outputs=("mask",)).mask)
    row, col = np.indices(mask.shape)
    inside = Path(outline).contains_points(np.stack([col.ravel(), row.ravel()], 1))
    # All but those whose center the outline's chords may cut off.
    assert (inside.reshape(mask.shape) != mask).sum() <= 2
    assert mask.sum() > 1000
    np.testing.assert_array_equal(outline[0], outline[-1])


def test_cylinder_around_the_camera_has_no_outline():
    pipe = ij.Cylinder((0, 0, 0), (0, 0, 1), 1, 9)
    assert fitted_outline(pipe, CAMERA) is None


@SMALL_IMAGES
@pytest.mark.parametrize(
    ("function", "shape"),
    [(ij.fit_cylinder, can()), (ij.fit_frustum, cup()), (ij.fit_sphere, ball())],
    ids=["cylinder", "frustum", "sphere"],
)
def test_a_fit_of_any_shape_is_drawn_with_its_outline(function, shape):
    depth, mask = image_of(shape)
    fit = function(depth, CAMERA, mask, SIGMA)
    drawn = [
        len(axes.lines) + len(axes.collections)
        for axes in overlay_figure(fit, depth, CAMERA).axes[:2]
    ]
    # The region that was used on the left, and the outline on both.
    assert drawn == [2, 1]
