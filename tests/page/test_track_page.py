"""What a page of tracks holds."""

import base64

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.page import track_page
from impostor_jax.page.track_page import TrackPage
from impostor_jax.viewer.video import color_of
from tests.fit.scenes import CAMERA
from tests.groups import SMALL_IMAGES
from tests.page.scenes import SHAPES, scene_of, track_of
from tests.track.scenes import can, frame, moved

pytestmark = SMALL_IMAGES

LARGE = ij.PinholeCamera(525.0, 525.0, 319.5, 239.5, 640, 480)


def floats(text):
    return np.frombuffer(base64.b64decode(text), "<f4").astype(float)


def page_of(*images, camera=CAMERA, depth=None):
    """A page of images with tracks, 0.1 s apart."""
    page = TrackPage()
    for k, tracks in enumerate(images):
        shown = frame([can()], k) if depth is None else depth
        page.add(shown, camera, tracks, 0.1 * k)
    return page


def depths_of(image):
    """Depths that a page makes of a picture; 0 where there is no reading."""
    data = base64.b64decode(image["picture"].partition(",")[2])
    level = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert level.ndim == 2
    near, far = image["ends"]
    inverse = 1 / far + (level.astype(float) - 1) / 253 * (1 / near - 1 / far)
    return np.where(level > 0, 1 / inverse, 0), far**2 * (1 / near - 1 / far) / 253


def test_readings_are_where_the_camera_read_them_but_for_a_level():
    depth = frame([can()])
    depth[0, :5] = 0, np.nan, np.inf, -1, 0
    camera = moved(0.3)
    page = page_of([track_of(1, can(x=0.3))], camera=camera, depth=depth)
    scene = scene_of(page.html)
    (image,) = scene["images"]
    told, level = depths_of(image)
    is_read = np.isfinite(depth) & (depth > 0)
    np.testing.assert_array_equal(told > 0, is_read)
    assert level < 0.01
    # But for the farthest and the nearest, which share a level.
    near, far = image["ends"]
    inside = is_read & (depth > near) & (depth < far)
    assert inside.mean() > 0.9
    np.testing.assert_allclose(told[inside], depth[inside], atol=level)
    # The page begins in the camera's frame, around the can, which is in its middle.
    rays = floats(scene["rays"]).reshape(120, 160, 3)
    axes, place = np.reshape(image["pose"][:9], (3, 3)), np.array(image["pose"][9:])
    np.testing.assert_allclose(axes, np.eye(3), atol=1e-6)
    np.testing.assert_allclose(place, [0, 0, -0.5], atol=1e-6)
    seen = place + told[60, 80] * rays[60, 80] @ axes
    np.testing.assert_allclose(seen, [0, 0, -0.04], atol=0.01)
    (shape,) = image["shapes"]
    np.testing.assert_allclose(shape[:3], 0, atol=1e-6)
    np.testing.assert_allclose(shape[6:], [0.04, 0.12])


def test_each_image_tells_its_tracks():
    first, second = SHAPES["can"], can(x=0.1, radius=0.03)
    page = page_of(
        [track_of(3, first, "new")],
        [track_of(3, first, "lost"), track_of(11, second, "new")],
    )
    scene = scene_of(page.html)
    assert scene["identities"] == [3, 11]
    b, g, r = color_of(3)
    assert scene["colors"][0] == f"#{r:02x}{g:02x}{b:02x}"
    before, after = scene["images"]
    assert [one["status"] for one in before["tracks"]] == ["new"]
    lost, new = after["tracks"]
    assert (lost["number"], lost["status"]) == (0, "lost")
    assert lost["reason"] == "something hides it"
    assert (new["number"], new["status"]) == (1, "new")
    assert after["seconds"] == 0.1
    pairs = zip(new["values"][::2], new["values"][1::2], strict=True)
    told = {
        name: (*pair, unit)
        for (name, unit), pair in zip(scene["rows"], pairs, strict=True)
    }
    assert told["radius"] == ("30.0", "2.0", "mm")
    assert told["height"][1] == "not determined"
    assert told["center x"] == ("100.0", "3.0", "mm")
    assert told["speed"] == ("0.100", "0.020", "m/s")
    assert told["images"][0] == "4"
    # An outline has a dozen corners or two, and not a thousand.
    assert 8 < new["outline"].count("L") < 60


def test_what_is_too_much_is_left_out_and_said(monkeypatch):
    images = 7 * [[track_of(1, can())]]
    page = page_of(*images, depth=frame([can()]))
    scene = scene_of(page.html)
    assert (scene["count"], scene["every"], scene["everyPicture"]) == (7, 1, 1)
    size = len(scene["images"][0]["picture"])
    monkeypatch.setattr(track_page, "MOST_OF_PICTURES", 3 * size)
    scene = scene_of(page.html)
    assert (len(scene["images"]), scene["everyPicture"]) == (7, 3)
    shown = [one["picture"] is not None for one in scene["images"]]
    assert shown == [True, False, False, True, False, False, True]
    of_tracks = page._images[0].size
    monkeypatch.setattr(track_page, "MOST_OF_TRACKS", 4 * of_tracks)
    scene = scene_of(page.html)
    assert (scene["every"], scene["count"]) == (2, 7)
    assert [one["number"] for one in scene["images"]] == [0, 2, 4, 6]


def test_what_a_page_tells_is_as_large_as_is_counted():
    page = page_of([track_of(1, can()), track_of(2, SHAPES["can"])])
    (image,) = scene_of(page.html)["images"]
    told = len(str({**image, "picture": None}))
    assert told / 1.3 < page._images[0].size < 1.3 * told


def test_of_a_large_image_the_picture_is_small():
    depth = np.full((480, 640), 0.8) + 0.001 * np.random.default_rng(0).normal(
        size=(480, 640)
    )
    scene = scene_of(page_of([], camera=LARGE, depth=depth).html)
    assert scene["grid"] == [160, 120]
    assert scene["size"] == [640, 480]
    (image,) = scene["images"]
    told, _ = depths_of(image)
    assert told.shape == (120, 160)
    # Between the pixels that are left out.
    rays = floats(scene["rays"]).reshape(120, 160, 3)
    np.testing.assert_allclose(525 * rays[0, 0, :2] + [319.5, 239.5], 2, atol=1e-3)


def test_without_a_track_there_is_a_page_and_without_an_image_there_is_none():
    scene = scene_of(page_of([], depth=np.zeros((120, 160))).html)
    assert scene["identities"] == []
    assert scene["radius"] > 0
    with pytest.raises(ValueError, match="must have an image"):
        _ = TrackPage().html
