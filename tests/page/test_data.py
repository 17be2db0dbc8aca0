"""What a page of a fit holds."""

import base64
import html

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import impostor_jax as ij
from impostor_jax.find.found import Found
from impostor_jax.fit.status import FitStatus
from impostor_jax.page.readings import readings_of
from impostor_jax.page.shown import image_view, shown_of
from impostor_jax.page.told import notes_of, numbers_of
from impostor_jax.page.wires import wires_of
from tests.fit.scenes import CAMERA, can, image
from tests.groups import FULL, SMALL_IMAGES
from tests.page.scenes import SHAPES, STD, can_fit, fit_of, scene_of

pytestmark = SMALL_IMAGES

POSE = np.array([[0, -1, 0, 0.1], [1, 0, 0, 5.0], [0, 0, 1, -2.0], [0, 0, 0, 1.0]])
INTRINSICS = {"fx": 150.0, "fy": 150.0, "cx": 79.5, "cy": 59.5}
SIZE = {"width": 160, "height": 120}


def floats(text):
    return np.frombuffer(base64.b64decode(text), "<f4").astype(float)


@FULL
@pytest.mark.parametrize("kind", ["plain", "posed", "lens", "orthographic"])
def test_points_are_where_the_camera_read_them(kind):
    lens = (-0.2, 0.05, 0.002, -0.001, 0.01) if kind == "lens" else None
    camera = ij.PinholeCamera(**INTRINSICS, **SIZE, distortion=lens)
    if kind == "posed":
        camera = ij.PinholeCamera(**INTRINSICS, **SIZE, camera_from_world=POSE)
    if kind == "orthographic":
        camera = ij.OrthographicCamera(400.0, 400.0, 79.5, 59.5, **SIZE)
    depth = image()[0].copy()
    depth[0, :5] = 0, np.nan, np.inf, -1, 0
    (told,) = scene_of(ij.view(can_fit(), depth, camera).html)["views"]
    # The frame of the page is the camera's, but for the origin.
    points = floats(told["places"]).reshape(-1, 3) - told["taken_from"]
    row, col = np.nonzero(np.isfinite(depth) & (depth > 0))
    assert len(points) == depth.size - 5
    np.testing.assert_allclose(points[:, 2], depth[row, col], atol=1e-6)
    pixels = np.asarray(camera.project(jnp.asarray(points, jnp.result_type(float))))
    np.testing.assert_allclose(pixels, np.stack([col, row], -1), atol=0.01)


def test_readings_have_the_residuals_of_the_fit_that_used_them():
    fit = can_fit()
    (told,) = scene_of(ij.view(fit).html)["views"]
    depth = image()[0]
    used = np.asarray(fit.region)[depth > 0]
    np.testing.assert_array_equal(floats(told["owners"]), used)
    residual = np.where(used, np.asarray(fit.residual)[depth > 0], 0)
    np.testing.assert_allclose(floats(told["residuals"]), residual, rtol=1e-6)
    assert np.count_nonzero(residual) > 1000


def test_of_a_large_image_the_readings_of_the_fits_are_kept():
    fit = can_fit()
    view = image_view(shown_of(fit), image()[0], CAMERA)
    many = int(np.count_nonzero(fit.region))
    readings = readings_of(view, most=2 * many)
    assert many < len(readings.owner) <= 2 * many
    assert np.count_nonzero(readings.owner) == many
    few = readings_of(view, most=400)
    assert 200 < len(few.owner) <= 400
    assert 100 <= np.count_nonzero(few.owner) <= 300
    # A pixel is seen under 1 / fx, whatever the distance.
    np.testing.assert_allclose(readings.footprint, (0, 1 / CAMERA.fx), rtol=1e-4)


@pytest.mark.parametrize("times", [1.96, -1.96])
@pytest.mark.parametrize("name", SHAPES)
def test_wires_are_of_the_sizes_at_the_ends_of_their_intervals(name, times):
    shape = SHAPES[name]
    wires = wires_of(fit_of(shape))
    assert wires is not None
    ends = (wires.place + times * wires.change).reshape(-1, 3)
    if name == "ball":
        away = np.linalg.norm(ends - np.asarray(shape.center), axis=1)
        np.testing.assert_allclose(away, 0.03 + times * STD, atol=1e-6)
        return
    if name == "cup":
        low, high = np.asarray(shape.p1, float), np.asarray(shape.p2, float)
        height, center = np.linalg.norm(high - low), (low + high) / 2
        axis, radii = (high - low) / height, {0.02, 0.035}
    else:
        held = fit_of(shape).tube if name == "pipe" else shape
        center, axis = np.asarray(held.center, float), np.asarray(held.axis, float)
        height = float(held.height)
        radii = {0.035, 0.025} if name == "pipe" else {0.03}
    along = (ends - center) @ axis
    np.testing.assert_allclose(np.abs(along), (height + times * STD) / 2, atol=1e-6)
    off = np.linalg.norm(ends - center - along[:, None] * axis, axis=1)
    expected = sorted(radius + times * STD for radius in radii)
    assert np.abs(off[:, None] - expected).min(axis=1).max() < 1e-6
    assert {int(k) for k in np.abs(off[:, None] - expected).argmin(axis=1)} == {
        *range(len(radii))
    }


def test_a_box_is_drawn_by_its_edges():
    turn = Rotation.from_rotvec([0.4, 0.7, 0.2]).as_matrix()
    box = ij.Box((0.1, 0.05, 0.55), turn, (0.06, 0.04, 0.1))
    fit = fit_of(box, size=(STD, np.inf, STD))
    wires = wires_of(fit)
    assert wires is not None
    assert wires.place.shape == (12, 2, 3)
    own = (wires.place + 2 * wires.change - np.asarray(box.center)) @ turn
    half = np.array([0.03 + STD, 0.02, 0.05 + STD])
    np.testing.assert_allclose(np.abs(own), np.broadcast_to(half, own.shape), atol=1e-6)
    along = np.sort(np.abs(own[:, 1] - own[:, 0]), axis=1)
    np.testing.assert_allclose(along[:, :2], 0, atol=1e-6)
    assert wires.most == pytest.approx(0.06 / STD)
    told = {name: rest for name, *rest in numbers_of(shown_of(fit)[0])}
    assert told["size x"][0] == "60.0"
    assert told["size y"][1] == "not determined"
    assert told["edge x"][0].startswith("0.7")
    assert wires_of(fit_of(box, size=(np.inf, 0.0, np.inf))) is None


def test_wires_grow_by_what_is_determined_alone():
    wires = wires_of(fit_of(SHAPES["can"], height=np.inf))
    assert wires is not None
    axis = np.asarray(SHAPES["can"].axis, float)
    np.testing.assert_allclose(wires.change @ axis, 0, atol=1e-9)
    assert np.isclose(wires.most, 0.03 / STD)
    assert wires_of(fit_of(SHAPES["ball"], radius=0.0)) is None


def test_numbers_have_the_digits_that_are_known():
    fit = fit_of(can(), radius=0.0000123, height=np.inf, center=(0.0, 0.002, 0.03))
    told = {name: rest for name, *rest in numbers_of(shown_of(fit)[0])}
    assert told["radius"] == ["40.000", "0.012", "mm"]
    assert told["height"] == ["120.000", "not determined", "mm"]
    assert told["center x"] == ["10.000", "held", "mm"]
    assert told["center y"][:2] == ["5.0", "2.0"]
    assert told["center z"][:2] == ["350", "30"]
    assert told["pixels used"][0] == str(int(fit.num_pixels))


def test_a_search_is_shown_with_its_confidence():
    depth, mask = image()
    fits, ones = (can_fit(),), np.ones(1)
    planes = ij.Plane(np.zeros((0, 3)), np.zeros((0, 3)))
    found = Found(fits, mask[None], 0.5 * ones, 0.75 * ones, ones < 0, planes)
    (shape,) = scene_of(ij.view(found).html)["shapes"]
    assert shape["name"] == "cylinder 1"
    assert shape["numbers"][:2] == [
        ["confidence", "0.75", "", ""],
        ["visible", "0.50", "", ""],
    ]
    none = Found((), mask[:0][None][:0], ones[:0], ones[:0], ones[:0] > 0, planes)
    assert scene_of(ij.view(none, depth, CAMERA).html)["shapes"] == []
    with pytest.raises(ValueError, match="nothing was found"):
        ij.view(none)


def test_a_failed_fit_has_no_shape():
    failed = can_fit().failed(FitStatus.POOR_FIT)
    scene = scene_of(ij.view(failed, image()[0], CAMERA).html)
    (shape,), (seen,) = scene["shapes"], scene["views"]
    assert shape["drawn"] is shape["wires"] is None
    assert not shape["isGood"]
    assert shape["status"] == "poor_fit"
    assert shape["notes"] == notes_of(shown_of(failed)[0])
    assert [name for name, *_ in shape["numbers"]] == ["pixels used"]
    assert seen["outlines"] == [""]
    assert np.isinf(floats(seen["residuals"])).sum() == int(failed.num_pixels)


def test_an_image_without_readings_has_a_page():
    nothing, failed = np.zeros((120, 160)), can_fit().failed(FitStatus.POOR_FIT)
    scene = scene_of(ij.view(failed, nothing, CAMERA).html)
    assert scene["views"][0]["places"] == ""
    assert scene["radius"] > 0


def test_what_a_name_holds_is_no_part_of_the_page():
    name = "</script><!--<script>&"
    page = ij.view({name: can_fit()}, image()[0], CAMERA)
    assert name not in page.html
    assert scene_of(page.html)["shapes"][0]["name"] == name


def test_a_notebook_shows_the_page_and_a_file_holds_it(tmp_path):
    page = ij.view(can_fit())
    frame = page._repr_html_()
    start = frame.index('srcdoc="') + len('srcdoc="')
    assert html.unescape(frame[start : frame.index('"', start)]) == page.html
    page.save(tmp_path / "fit.html")
    assert (tmp_path / "fit.html").read_text() == page.html
    for word in ("http:", "https:", "src=", "@import", "fetch("):
        assert word not in page.html.replace("http://www.w3.org/2000/svg", "")


def stacked():
    return jax.tree.map(lambda x: jnp.stack([x, x]), can_fit())


@pytest.mark.parametrize(
    ("result", "given", "message"),
    [
        (lambda: 3.0, {}, "result must be a fit, .* got float"),
        (stacked, {}, "result must be a single, concrete fit"),
        (lambda: can_fit().failed(FitStatus.POOR_FIT).cylinder, {}, "got Cylinder"),
        (lambda: jax.tree.map(lambda x: x, can_fit()), {}, "does not hold its image"),
        (can_fit, {"camera": CAMERA}, "depth and camera must be given together"),
        (can_fit, {"depth": np.ones((3, 4)), "camera": CAMERA}, "the camera's shape"),
        (can_fit, {"depth": np.ones((120, 160)), "camera": 3}, "must be a camera"),
        (
            can_fit,
            {
                "depth": np.ones((4, 6)),
                "camera": ij.PinholeCamera(5.0, 5.0, 2.5, 1.5, 6, 4),
            },
            "must be the image that was fitted",
        ),
    ],
)
def test_what_is_no_fit_of_an_image_is_refused(result, given, message):
    with pytest.raises(ValueError, match=message):
        ij.view(result(), **given)
