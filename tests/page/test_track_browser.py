"""What a person meets in the page of tracks."""

import cv2
import numpy as np
import pytest

from impostor_jax.page.track_page import TrackPage
from tests.fit.scenes import CAMERA
from tests.groups import FULL
from tests.page.scenes import track_of
from tests.track.scenes import can, frame

pytest.importorskip("playwright")

pytestmark = FULL

DESKTOP, PHONE = (900, 500), (360, 740)
RED, GREEN, LOST = (230, 25, 75), (60, 180, 75), (160, 160, 160)
"""Of the video: the first two tracks, and one that is lost."""


@pytest.fixture(scope="module")
def track_html():
    """Of four images: a can goes aside, a second one comes, the first is lost."""
    page = TrackPage()
    for k in range(4):
        tracks = [track_of(1, can(x=0.02 * k), "lost" if k == 3 else "tracked")]
        if k > 1:
            tracks.append(track_of(2, can(x=-0.1), "new" if k == 2 else "tracked"))
        shown = [one.cylinder for one in tracks]
        page.add(frame(shown, k), CAMERA, tracks, 0.1 * k)
    return page.html


def looked_at(page, number):
    """What the scene shows, once an image and its picture are drawn."""
    page.wait_for_function(f"now === {number} && canvas.dataset.image === '{number}'")
    page.wait_for_selector("canvas[data-drawn=whole]")
    style = "#looks, #time { display: none }"
    data = page.locator("#view").screenshot(style=style)
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)


def has_color(shown, color):
    """Whether something has the hue of a color, in whatever light."""
    shown = shown.astype(float)
    part = shown / np.maximum(np.linalg.norm(shown, axis=-1, keepdims=True), 1)
    near = part @ (np.array(color) / np.linalg.norm(color)) > 0.995
    return np.count_nonzero(near & (np.ptp(shown, axis=-1) > 30)) > 200


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_slider_goes_through_the_images(opened, track_html, scheme):
    page = opened(track_html, size=DESKTOP, color_scheme=scheme)
    first = looked_at(page, 0)
    assert page.is_hidden("#note")
    assert page.inner_text("h1") == "2 cylinders in 4 images"
    assert page.inner_text("#stamp") == "1 of 4, 0.00 s"
    page.evaluate("shown.points = false; shown.opacity = 1; show(0)")
    assert has_color(looked_at(page, 0), RED)
    assert not has_color(looked_at(page, 0), GREEN)
    assert page.locator("#shapes li:visible").count() == 1
    page.fill("#image", "2")
    third = looked_at(page, 2)
    assert has_color(third, RED)
    assert has_color(third, GREEN)
    assert "new, r = 40.0 ± 2.0 mm" in page.inner_text("#shapes")
    page.click("#shapes button:has-text('cylinder 1')")
    assert page.inner_text("#chosen h2") == "cylinder 1: tracked"
    assert page.inner_text("#chosen tr:has-text('speed')").split()[:2] == [
        "speed",
        "0.100",
    ]
    page.fill("#image", "3")
    assert not has_color(looked_at(page, 3), RED)
    assert page.inner_text("#chosen h2") == "cylinder 1: lost: something hides it"
    outline = page.locator("#pictures g[data-track='1'] path").last
    assert outline.get_attribute("stroke") == "#a0a0a0"
    page.get_by_label("show cylinder 2").uncheck()
    assert not has_color(looked_at(page, 3), GREEN)
    assert page.locator("#pictures g[data-track='2']").count() == 0
    assert (first != third).any()
    # The page itself, and what it holds.
    assert all(url.startswith(("file:", "data:")) for url in page.asked)
    assert page.complaints == []


def test_keys_go_to_an_image_and_play(opened, track_html):
    page = opened(track_html, size=DESKTOP)
    looked_at(page, 0)
    for where in ("body", "#view", "#image", "#points"):
        page.evaluate("show(0)")
        if where != "body":
            page.focus(where)
        for key, number in (
            ("ArrowRight", 1),
            ("ArrowRight", 2),
            ("ArrowLeft", 1),
            ("End", 3),
            ("Home", 0),
        ):
            page.keyboard.press(key)
            assert page.evaluate("now") == number, (where, key)
    page.focus("#view")
    page.keyboard.press(" ")
    page.wait_for_function("now === 3 && begun === null")
    assert page.get_attribute("#play", "aria-pressed") == "false"
    # It begins anew, and stops where it is asked to.
    page.click("#play")
    page.wait_for_function("now < 3")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("begun") is None
    view = "JSON.stringify([view.yaw, view.pitch])"
    before = page.evaluate(view)
    page.focus("#view")
    page.keyboard.press("d")
    assert page.evaluate(view) != before
    assert page.complaints == []


def test_a_picture_shows_its_depths_in_colors(opened, track_html):
    page = opened(track_html, size=DESKTOP)
    looked_at(page, 0)
    middle, corner = (
        page.evaluate(
            f"""[...document.getElementById('depth').getContext('2d')
                 .getImageData({col}, {row}, 1, 1).data]"""
        )[:3]
        for col, row in ((80, 60), (5, 5))
    )
    # The near can is dark and blue, the wall is yellow.
    assert middle[2] > middle[0]
    assert corner[0] > 200 > corner[2]


def test_a_phone_shows_scene_slider_and_numbers(opened, track_html):
    page = opened(track_html, size=PHONE, has_touch=True, is_mobile=True)
    looked_at(page, 0)
    assert page.evaluate("document.documentElement.scrollWidth") == PHONE[0]
    box = page.locator("#view").bounding_box()
    assert box["height"] < 0.7 * PHONE[1]
    slider = page.locator("#image").bounding_box()
    assert slider["y"] + slider["height"] < box["y"] + box["height"]
    page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.evaluate("show(2)")
    low = "[...document.querySelectorAll('button, label')].filter(x => x.offsetHeight)"
    assert min(page.evaluate(f"{low}.map(x => x.offsetHeight)")) >= 28
    assert page.complaints == []
