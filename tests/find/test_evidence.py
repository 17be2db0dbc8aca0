"""What an image says for and against a wall."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.evidence import shown, weighed
from tests.find.scenes import (
    CAMERA,
    CAMERAS,
    SIGMA,
    WALL,
    ends_of,
    image_of,
    scene_of,
    wall_of,
)
from tests.fit.scenes import can

POST = ij.Cylinder((0.0, 0.0, 0.4), (0.8, 0.6, 0.0), 0.03, 0.2)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("shape", [POST, can(70)], ids=["across", "oblique"])
def test_the_true_wall_explains_its_pixels_and_ends_where_it_does(shape, camera):
    camera = CAMERAS[camera]
    image = image_of([shape, WALL], camera)
    scene = scene_of(image, camera)
    found = weighed(scene, wall_of(shape))
    axis, center = np.asarray(shape.axis, float), np.asarray(shape.center, float)
    on_wall = image.owner == 0
    on_wall &= np.abs(image.normal @ axis) < 0.5
    assert np.mean(on_wall.ravel()[found.pixels]) > 0.97
    assert found.explained > 0.9 * np.count_nonzero(on_wall)
    assert found.behind + found.other < 0.05 * found.explained
    # A reading may be a third of a pixel aside, too, which where it grazes is most.
    assert 0.5 < found.misfit < 1.2
    assert np.radians(120) < found.arc < np.radians(190)
    # Within a pixel; of what is seen aslant a pixel is longer.
    pixel = float(scene.view.width(center[2]))
    pixel /= max(np.sqrt(1 - axis[2] ** 2), 0.1)
    np.testing.assert_allclose(found.ends, ends_of(shape), atol=1.5 * pixel)


def test_what_shows_a_wall_is_its_mask():
    image = image_of([POST, WALL])
    scene = scene_of(image)
    mask = shown(scene, weighed(scene, wall_of(POST)), scene.free, mixed=False)
    truth = image.owner == 0
    assert np.count_nonzero(mask & truth) / np.count_nonzero(mask | truth) > 0.9


def test_parts_beside_an_occluder_are_one_wall():
    box = ij.Box((0.0, 0.0, 0.3), np.eye(3), (0.06, 0.3, 0.02))
    image = image_of([POST, box])
    scene = scene_of(image, free=image.owner == 0)
    found = weighed(scene, wall_of(POST))
    np.testing.assert_allclose(found.ends, ends_of(POST), atol=0.006)
    assert found.explained > 0.9 * np.count_nonzero(image.owner == 0)
    assert found.behind == 0
    col = found.pixels % 160
    assert (col < 50).any()
    assert (col > 110).any()


@pytest.mark.parametrize(
    "changes",
    [
        {"radius": 0.045},
        # It touches the front of the true one, and there is nothing beside that.
        {"radius": 0.045, "center": np.array([0.0, 0.0, 0.415])},
        {"center": np.array([0.024, -0.032, 0.4])},
        {"center": np.array([0.0, 0.0, 0.37])},
        {"axis": np.array([0.6, 0.8, 0.0])},
        {"side": -1.0},
    ],
    ids=["too large", "too large behind", "aside", "before", "turned", "from inside"],
)
def test_free_space_and_other_surfaces_refute_a_wrong_wall(changes):
    image = image_of([POST, WALL])
    scene = scene_of(image)
    true = weighed(scene, wall_of(POST))
    wrong = weighed(scene, wall_of(POST, **changes))
    if wrong is not None:
        gain = wrong.explained - 2 * wrong.behind - wrong.other
        assert gain < 0.4 * true.explained


def test_nothing_is_for_a_wall_in_free_space():
    image = image_of([WALL])
    assert (
        weighed(scene_of(image, free=np.ones((120, 160), bool)), wall_of(POST)) is None
    )
    assert weighed(scene_of(image), wall_of(POST)) is None


def test_missing_readings_are_neither_for_nor_against_a_wall():
    image = image_of([POST, WALL])
    holes = np.random.default_rng(1).random(image.depth.shape) < 0.4
    image.depth[holes] = 0
    found = weighed(scene_of(image, free=image.owner == 0), wall_of(POST))
    np.testing.assert_allclose(found.ends, ends_of(POST), atol=0.006)
    assert found.explained > 0.9 * np.count_nonzero((image.owner == 0) & ~holes)
    assert found.behind + found.other < 0.01 * found.explained


def test_an_orthographic_camera_sees_as_a_pinhole_far_away_does():
    """Counts and ends agree within a few pixels."""
    far, zoom = 40.0, 400.0
    pinhole = ij.PinholeCamera(zoom * far, zoom * far, 79.5, 59.5, 160, 120)
    shape = ij.Cylinder((0.01, 0.0, far), (0.6, 0.64, 0.48), 0.05, 0.2)
    both = []
    for camera in (pinhole, CAMERAS["orthographic"]):
        image = image_of([shape], camera)
        scene = scene_of(image, camera, free=np.ones((120, 160), bool))
        both.append(weighed(scene, wall_of(shape)))
    one, other = both
    assert one.explained == pytest.approx(other.explained, rel=0.01)
    np.testing.assert_allclose(one.ends, other.ends, atol=1.5 / zoom)
    assert one.arc == pytest.approx(other.arc, abs=np.radians(6))


def test_a_pipe_is_explained_from_inside():
    pipe = ij.Cylinder((0.02, 0.01, 1.0), (0.1, 0.05, 0.99), 0.2, 6.0)
    image = image_of([pipe], CAMERA, SIGMA)
    found = weighed(scene_of(image), wall_of(pipe, -1.0))
    assert found.arc > np.radians(350)
    # But for what is far away, where a pixel sees much of it.
    assert found.explained > 0.95 * np.count_nonzero(image.exact < 1)
    assert weighed(scene_of(image), wall_of(pipe, 1.0)) is None
