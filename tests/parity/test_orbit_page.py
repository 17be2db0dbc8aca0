"""What a person meets in the page that turns a traced scene around."""

import base64
import itertools

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.glsl.orbit_page import orbit_page
from impostor_jax.io.color_image import srgb
from tests.groups import FULL

pytest.importorskip("playwright")

pytestmark = FULL

CAMERA = ij.PinholeCamera(54.0, 54.0, 31.5, 23.5, width=64, height=48)
LIGHTS = [ij.AmbientLight(0.2), ij.PointLight((1.0, -2.0, 1.0), (0.9, 0.8, 0.7))]
SKY = (0.2, 0.3, 0.5)
SCENE = [
    ij.Sphere((-0.2, 0.1, 2.0), 0.4),
    ij.Box((0.5, 0.1, 2.4), np.eye(3), (0.4, 0.8, 0.3)),
    ij.Plane((0.0, 0.5, 0.0), (0.0, -1.0, 0.0)),
]
MADE = [
    ij.Material((0.9, 1.0, 0.9), 60.0, 0.1, 0.7, 1.4),
    ij.Material((0.9, 0.2, 0.1), 20.0, 0.4),
    ij.Material((0.8, 0.7, 0.6)),
]
MIDDLE = (32, 24)


def looked_at(page):
    """What the window shows, without the note, once all of it is drawn."""
    page.wait_for_selector("canvas[data-drawn=whole]")
    return decoded(page.screenshot(style="#note { display: none }"))


def decoded(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)


def turned_around(page, right, down, button="left"):
    page.mouse.move(*MIDDLE)
    page.mouse.down(button=button)
    page.mouse.move(MIDDLE[0] + right, MIDDLE[1] + down)
    page.mouse.up(button=button)
    return looked_at(page)


def levels_of(picture):
    return np.rint(255 * srgb(picture)).astype(int)


@pytest.mark.parametrize("kind", ["perspective", "orthographic", "posed"])
def test_page_begins_with_the_picture_of_the_camera(browser, opened, kind):
    camera = CAMERA
    if kind == "orthographic":
        camera = ij.OrthographicCamera(30.0, 30.0, 31.5, 23.5, 64, 48)
    if kind == "posed":
        c, s = np.cos(0.3), np.sin(0.3)
        pose = [[1, 0, 0, 0.1], [0, c, -s, 0.6], [0, s, c, 0], [0, 0, 0, 1]]
        camera = ij.PinholeCamera(
            54.0, 54.0, 31.5, 23.5, 64, 48, None, False, np.array(pose)
        )
    given = (SCENE, camera, LIGHTS, MADE, SKY, 2)
    # No extension, so that phones without float targets show it, too.
    page = opened(
        orbit_page(*given), "WebGL2RenderingContext.prototype.getExtension = () => null"
    )
    shown = looked_at(page).astype(int)
    assert page.complaints == []
    assert np.ptp(shown) > 80
    drawn = levels_of(browser.trace(*given))
    assert np.abs(shown - drawn).max() <= 1
    assert page.inner_text("#note").startswith("Drag: turn.")
    assert len(page.asked) == 1  # the page itself


def test_a_hand_turns_the_picture_and_brings_it_back(opened):
    page = opened(orbit_page(SCENE, CAMERA, LIGHTS, MADE, SKY))
    first = looked_at(page)
    seen = [
        first,
        turned_around(page, 10, 4),
        turned_around(page, 5, 5, "right"),
    ]
    page.mouse.wheel(0, -300)
    page.wait_for_function("view.zoom < 1")
    seen.append(looked_at(page))
    page.keyboard.press("ArrowUp")
    seen.append(looked_at(page))
    for one, other in itertools.pairwise(seen):
        assert (one != other).any(axis=-1).mean() > 0.2
    assert page.is_hidden("#note")
    page.keyboard.press("r")
    np.testing.assert_array_equal(looked_at(page), first)
    turned_around(page, -7, 0)
    page.mouse.dblclick(*MIDDLE)
    np.testing.assert_array_equal(looked_at(page), first)
    assert page.complaints == []


@pytest.mark.parametrize("kind", [ij.PinholeCamera, ij.OrthographicCamera])
def test_what_is_dragged_moves_as_the_mouse_does(opened, kind):
    focal = 54.0 if kind is ij.PinholeCamera else 20.0
    camera = kind(focal, focal, 31.5, 23.5, 64, 48)
    # The pivot is between the two balls, of which the near one is red.
    balls = [ij.Sphere((0, 0, 1.5), 0.2), ij.Sphere((0, 0, 2.5), 0.2)]
    made = [ij.Material((1, 0, 0)), ij.Material((0, 0, 1))]
    page = opened(orbit_page(balls, camera, [ij.AmbientLight(1.0)], made))

    def middle_of(picture, channel):
        return np.argwhere(picture[..., channel] > 128).mean(axis=0)[::-1]

    near = middle_of(looked_at(page), 0)
    shown = turned_around(page, 5, 3)
    assert (middle_of(shown, 0) - near > 1).all()
    assert (middle_of(shown, 2) - near < -1).all()
    page.keyboard.press("r")
    looked_at(page)
    between = middle_of(turned_around(page, 6, -3, "right"), 0) - near
    # Of a perspective camera the near ball moves by 2 / 1.5 of what the pivot does.
    scale = 4 / 3 if kind is ij.PinholeCamera else 1
    np.testing.assert_allclose(between, np.array([6, -3]) * scale, atol=1)
    page.keyboard.press("r")
    size = np.count_nonzero(looked_at(page)[..., 0] > 128)
    page.mouse.wheel(0, -200)
    page.wait_for_function("view.zoom < 1")
    assert np.count_nonzero(looked_at(page)[..., 0] > 128) > 1.3 * size


def test_the_picture_stays_upright_however_far_it_is_dragged(opened):
    # A camera that looks down by 17 degrees: the floor's normal stays upright.
    c, s = np.cos(0.3), np.sin(0.3)
    pose = [[1, 0, 0, 0], [0, c, -s, 0.3], [0, s, c, 0], [0, 0, 0, 1]]
    camera = ij.PinholeCamera(
        54.0, 54.0, 31.5, 23.5, 64, 48, None, False, np.array(pose)
    )
    page = opened(orbit_page(SCENE, camera, LIGHTS))
    looked_at(page)
    for down in (40, -40, 3):
        turned_around(page, 11, down)
        right = np.array(page.evaluate("view.inScene([1, 0, 0])"))
        upwards = np.array(page.evaluate("view.inScene([0, -1, 0])"))
        up = -np.array(pose)[:3, 1]
        assert abs(right @ up) < 1e-6
        assert upwards @ up > 0.01


def test_a_slow_machine_draws_coarsely_while_something_moves(opened):
    page = opened(orbit_page(SCENE, CAMERA, LIGHTS, MADE, SKY), size=(128, 96))
    whole = looked_at(page)
    assert whole.shape == (96, 128, 3)
    state, url = page.evaluate(
        "coarse = 4; drawCoarsely(); [canvas.dataset.drawn, canvas.toDataURL()]"
    )
    assert state == "coarsely"
    coarse = decoded(base64.b64decode(url.split(",")[1])).astype(int)
    # The same picture, but for its edges.
    assert np.median(np.abs(coarse - whole)) <= 1
    steps = [
        np.abs(np.diff(seen.astype(int), axis=1)).max() for seen in (coarse, whole)
    ]
    assert steps[0] < 0.7 * steps[1]
    # A pause, and it is drawn in full.
    np.testing.assert_array_equal(looked_at(page), whole)


def test_two_fingers_come_nearer(opened):
    page = opened(orbit_page(SCENE, CAMERA, LIGHTS))
    first = looked_at(page)
    fingers = page.context.new_cdp_session(page)
    for kind, reach in (("touchStart", 5), ("touchMove", 10), ("touchEnd", None)):
        points = [] if reach is None else [{"x": 32 + reach}, {"x": 32 - reach}]
        points = [{**at, "y": 24, "id": k} for k, at in enumerate(points)]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    page.wait_for_function("view.zoom < 0.6")
    assert (looked_at(page) != first).any()
    assert page.evaluate("[view.zoom, view.yaw, hands.held.size]") == [0.5, 0, 0]


def test_the_window_shows_all_of_the_image_and_more(opened):
    text = orbit_page(SCENE, CAMERA, LIGHTS, MADE, SKY)
    first = looked_at(opened(text))
    page = opened(text)
    looked_at(page)
    page.set_viewport_size({"width": 100, "height": 48})
    page.wait_for_function("canvas.width === 100")
    wide = looked_at(page)
    assert np.abs(wide[:, 18:82].astype(int) - first).max() <= 1


def test_a_scene_without_lights_is_lit_from_the_camera(browser, opened):
    ball = ij.Sphere((0.0, 0.0, 2.0), 0.4)
    page = opened(orbit_page(ball, CAMERA))
    first = looked_at(page)
    lights = [ij.AmbientLight(0.2), ij.PointLight((0, 0, 0), 0.8)]
    drawn = levels_of(browser.trace(ball, CAMERA, lights))
    assert np.abs(first.astype(int) - drawn).max() <= 1
    # The light goes along: a ball looks the same from all sides.
    behind = turned_around(page, 30, 0)
    assert np.percentile(np.abs(behind.astype(int) - first), 98) <= 1


@pytest.mark.parametrize(
    ("shapes", "pivot"),
    [
        ([ij.Sphere((0.2, 0, 2), 0.1), ij.Sphere((0, 0, 3), 0.1)], (0.1, 0, 2.5)),
        # What has no end, is around the camera or out of sight does not count.
        (
            [
                ij.Plane((0, 0, 5), (0, 0, 1)),
                ij.Sphere((0, 0, 1), 9.0),
                ij.Sphere((9, 0, 1), 1.0),
                ij.Sphere((0, 0, 2), 0.1),
            ],
            (0, 0, 2),
        ),
        ([ij.Plane((0, 0, 5), (0, 0, 1))], (0.05, 0.05, 5)),
        ([ij.Plane((0, 0, -5), (0, 0, 1))], (0.01, 0.01, 1)),
    ],
)
def test_the_picture_turns_about_what_is_looked_at(opened, shapes, pivot):
    camera = ij.PinholeCamera(50.0, 50.0, 31.5, 23.5, 64, 48)
    page = opened(orbit_page(shapes, camera))
    np.testing.assert_allclose(page.evaluate("scene.pivot"), pivot, atol=1e-4)


def test_page_needs_nothing_from_the_network():
    text = orbit_page(SCENE, CAMERA, LIGHTS, MADE, SKY)
    for word in ("http", "src=", "href=", "import(", "fetch("):
        assert word not in text


def test_a_browser_without_webgl_says_so(opened):
    page = opened(
        orbit_page(SCENE, CAMERA, LIGHTS),
        "HTMLCanvasElement.prototype.getContext = () => null",
    )
    page.wait_for_function("note.textContent.includes('has no WebGL2')")
    assert page.is_visible("#note")
    assert page.complaints == []
