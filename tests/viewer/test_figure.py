import dataclasses

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.path import Path

import impostor_jax as ij
from impostor_jax.find.found import Found
from impostor_jax.fit.fittable import CYLINDER, no_guess
from impostor_jax.viewer.figure import (
    Drawn,
    draw_shapes,
    fitted_outline,
    found_figure,
    overlay_figure,
)
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of
from tests.fit.test_frustum import cup
from tests.fit.test_sphere import ball
from tests.groups import FULL, SMALL_IMAGES


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


@FULL
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


@SMALL_IMAGES
def test_a_fit_of_several_images_or_of_points_is_no_picture():
    depth, mask = image()
    fit = no_guess(CYLINDER, mask, mask)
    with pytest.raises(ValueError, match=r"of one image, got one of 2: ij\.view"):
        overlay_figure(fit, depth, CAMERA)
    of_points = dataclasses.replace(no_guess(CYLINDER, mask), source="points")
    with pytest.raises(ValueError, match="of one image, got a fit to points"):
        overlay_figure(of_points, depth, CAMERA)


NO_PLANES = ij.Plane(np.zeros((0, 3)), np.zeros((0, 3)))


@SMALL_IMAGES
def test_what_was_found_is_drawn_with_its_number_and_confidence():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    ones = np.ones(1)
    found = Found((fit,), mask[None], ones, 0.7 * ones, ones < 0, NO_PLANES)
    axes = found_figure(found, depth, CAMERA).axes[0]
    assert (len(axes.lines), len(axes.collections)) == (1, 1)
    assert [text.get_text() for text in axes.texts] == ["1: 0.70"]
    assert "1 found" in axes.get_title()


@pytest.mark.parametrize("reading", [0.0, np.nan, 0.5])
def test_an_image_in_which_nothing_was_found_is_drawn(reading):
    depth = np.full((CAMERA.height, CAMERA.width), reading, np.float32)
    none = np.zeros(0)
    masks = np.zeros((0, *depth.shape), bool)
    found = Found((), masks, none, none, none > 0, NO_PLANES)
    axes = found_figure(found, depth, CAMERA).axes[0]
    assert not axes.lines
    assert not axes.texts
    assert "0 found" in axes.get_title()


def test_an_orthographic_outline_is_that_of_the_rendered_mask():
    camera = ij.OrthographicCamera(400.0, 400.0, 79.5, 59.5, 160, 120)
    maps = ij.render(can(), camera, ("depth", "mask"))
    assert maps.mask is not None
    mask, axes = np.asarray(maps.mask), Figure().subplots()
    draw_shapes(axes, maps.depth, camera, [Drawn(mask, can(), "can")])
    region, outline = axes.collections
    for contour in (region, outline):
        (path,) = contour.get_paths()
        low, high = path.vertices.min(axis=0), path.vertices.max(axis=0)
        rows, cols = np.nonzero(mask)
        np.testing.assert_allclose(low, (cols.min() - 0.5, rows.min() - 0.5))
        np.testing.assert_allclose(high, (cols.max() + 0.5, rows.max() + 0.5))


def test_a_region_of_all_pixels_has_no_border():
    everywhere = np.ones((CAMERA.height, CAMERA.width), bool)
    axes = Figure().subplots()
    draw_shapes(axes, everywhere.astype(float), CAMERA, [Drawn(everywhere, None, "a")])
    assert not axes.collections
    assert len(axes.texts) == 1
