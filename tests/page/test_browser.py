"""What a person meets in the page of a fit."""

import itertools

import cv2
import jax
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.status import FitStatus
from impostor_jax.page.frame import page_frame
from impostor_jax.page.shown import image_view, shown_of
from tests.fit.scenes import CAMERA, image
from tests.groups import FULL, RELEASE
from tests.page.scenes import SHAPES, can_fit, fit_of

pytest.importorskip("playwright")

pytestmark = FULL

DESKTOP, PHONE = (900, 500), (360, 740)


def looked_at(page):
    """What the canvas shows, once it is drawn."""
    page.wait_for_selector("canvas[data-drawn=whole]")
    style = "#legend, #looks, #alert { display: none }"
    data = page.locator("canvas").screenshot(style=style)
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)


def middle_of(page):
    box = page.locator("canvas").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


@pytest.fixture(scope="module")
def can_page():
    return ij.view(can_fit()).html


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_begins_with_the_fit_in_the_middle(opened, can_page, scheme):
    page = opened(can_page, size=DESKTOP, color_scheme=scheme)
    shown = looked_at(page).astype(int)
    assert page.complaints == []
    assert len(page.asked) == 1  # the page itself
    ground = {"light": (243, 244, 246), "dark": (21, 24, 28)}[scheme]
    is_ground = (shown == ground).all(axis=-1)
    assert 0.02 < is_ground.mean() < 0.95
    height, width = is_ground.shape
    middle = shown[height // 2 - 40 : height // 2 + 40, width // 2 - 40 :][:, :80]
    # Residuals are of all colors.
    assert np.ptp(middle, axis=(0, 1)).min() > 100
    assert page.is_hidden("#note")
    assert page.is_hidden("#alert")
    assert "cylinder: converged" in page.inner_text("h1")
    radius = page.inner_text("table tr:has-text('radius')").split()
    assert radius[0] == "radius"
    assert radius[2:] == ["±", radius[3], "mm"]
    assert float(radius[1]) == pytest.approx(40.0, abs=0.5)


def test_hands_turn_the_scene_and_pick_a_shape(opened, can_page):
    page = opened(can_page, size=DESKTOP)
    first, (x, y) = looked_at(page), middle_of(page)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 20)
    page.mouse.up()
    turned = looked_at(page)
    assert (turned != first).any(axis=-1).mean() > 0.1
    page.mouse.wheel(0, -300)
    page.wait_for_function("view.zoom < 0.9")
    page.click("#back")
    np.testing.assert_array_equal(looked_at(page), first)
    # A tap beside everything takes the numbers away, one on the can brings them.
    page.uncheck("#points")
    page.mouse.click(5, 5)
    assert page.locator("table").count() == 0
    page.mouse.click(x, y)
    assert "chi-squared" in page.inner_text("#chosen")
    page.mouse.click(5, 5)
    page.locator("#pictures path").last.click()
    assert "chi-squared" in page.inner_text("#chosen")
    page.focus("canvas")
    for key in ("ArrowLeft", "c", "r", "n"):
        before = looked_at(page)
        page.keyboard.press(key)
        if key != "n":
            assert (looked_at(page) != before).any()
    assert page.complaints == []


@RELEASE
def test_what_is_switched_off_is_not_seen(opened, can_page):
    page = opened(can_page, size=DESKTOP)
    seen = [looked_at(page)]
    page.uncheck("#colored")
    seen.append(looked_at(page))
    assert page.is_hidden("#legend")
    page.select_option("#times", "100")
    seen.append(looked_at(page))
    page.uncheck("#wires")
    seen.append(looked_at(page))
    page.fill("#opacity", "90")
    seen.append(looked_at(page))
    page.uncheck("#points")
    seen.append(looked_at(page))
    page.get_by_label("show cylinder").uncheck()
    seen.append(looked_at(page))
    for one, other in itertools.pairwise(seen):
        assert (one != other).any()
    assert np.ptp(seen[-1], axis=(0, 1)).max() == 0
    assert page.locator("#pictures g").is_hidden()
    assert page.complaints == []


def test_shapes_are_where_the_renderer_sees_them(opened):
    depth, _ = image()
    fits = {name: fit_of(shape) for name, shape in SHAPES.items()}
    shown = shown_of(fits)
    frame = page_frame(shown, [image_view(shown, depth, CAMERA)])
    page = opened(ij.view(fits, depth, CAMERA).html, size=DESKTOP)
    looked_at(page)
    page.evaluate("shown.points = false; view.turnBy(0.9, 0.5); view.comeNearer(1.1)")
    axes, eye, told, seen = page.evaluate(
        """() => {
          const { width, height } = canvas, seen = [];
          const { axes, eye, uniforms } = stage.cameraOf(view, width, height);
          for (let row = 2; row < height; row += 12) {
            for (let col = 2; col < width; col += 12) {
              seen.push([row, col, stage.pick(view, shown, col, row) ?? -1]);
            }
          }
          return [axes, eye, uniforms, seen];
        }"""
    )
    axes = np.array(axes)
    pose = np.eye(4)
    pose[:3, :3] = axes @ frame.rotation
    pose[:3, 3] = axes @ (frame.translation - np.array(eye))
    width, height = map(int, told["image_size"])
    camera = ij.PinholeCamera(
        *told["focal"], *told["principal"], width, height, camera_from_world=pose
    )
    maps = ij.render(ij.Scene(list(SHAPES.values())), camera, outputs=("index",))
    row, col, number = np.array(seen).T
    expected = np.asarray(maps.index)[row, col]
    assert set(expected) == {-1, 0, 1, 2, 3}
    assert np.count_nonzero(number != expected) <= 2
    assert page.complaints == []


def test_a_phone_shows_scene_and_numbers_and_two_fingers_come_nearer(opened, can_page):
    page = opened(can_page, size=PHONE, has_touch=True, is_mobile=True)
    shown = looked_at(page)
    assert shown.shape[1] == PHONE[0]
    assert np.ptp(shown) > 100
    assert page.evaluate("document.documentElement.scrollWidth") == PHONE[0]
    box = page.locator("canvas").bounding_box()
    assert box["height"] < 0.7 * PHONE[1]
    x, y = middle_of(page)
    fingers = page.context.new_cdp_session(page)
    for kind, reach in (("touchStart", 20), ("touchMove", 60), ("touchEnd", None)):
        points = [] if reach is None else [{"x": x + reach}, {"x": x - reach}]
        points = [{**at, "y": y, "id": k} for k, at in enumerate(points)]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    page.wait_for_function("view.zoom < 0.6")
    page.touchscreen.tap(x, y)
    assert "chi-squared" in page.inner_text("#chosen")
    # All targets of a finger are as high as one.
    low = "[...document.querySelectorAll('button, label')].map(x => x.offsetHeight)"
    assert min(page.evaluate(low)) >= 28
    assert page.complaints == []


def test_a_failed_fit_is_told_and_not_drawn(opened):
    failed = can_fit().failed(FitStatus.POOR_FIT)
    page = opened(ij.view(failed, image()[0], CAMERA).html, size=DESKTOP)
    looked_at(page)
    assert "the fit failed (poor_fit), there is no shape" in page.inner_text("#alert")
    assert "failed: poor_fit" in page.inner_text("#shapes")
    assert page.is_hidden("#legend")
    page.uncheck("#points")
    assert np.ptp(looked_at(page), axis=(0, 1)).max() == 0
    assert page.complaints == []


def test_nothing_that_was_found_has_a_page(opened):
    leaves = np.zeros((0, 120, 160), bool), *3 * [np.zeros(0)]
    masks, visible, confidence, inside = leaves
    planes = jax.tree.map(lambda x: x[None][:0], ij.Plane((0, 0, 1), (0, 0, -1)))
    nothing = ij.Found((), masks, visible, confidence, inside > 0, planes)
    page = opened(ij.view(nothing, image()[0], CAMERA).html, size=DESKTOP)
    assert np.ptp(looked_at(page)) > 50
    assert page.inner_text("h1") == "Nothing was found"
    assert page.complaints == []


def test_a_browser_without_webgl_says_so(opened, can_page):
    page = opened(can_page, "HTMLCanvasElement.prototype.getContext = () => null")
    page.wait_for_function("note.textContent.includes('has no WebGL2')")
    assert page.is_visible("#note")
    assert page.complaints == []
