"""What is drawn: distributions, the catalogue, and scenes that keep to their preset."""

import dataclasses
import json

import numpy as np
import pytest

from data_synth.camera_draw import CameraDraw
from data_synth.capture import capture_keys
from data_synth.catalogue import draw_catalogue
from data_synth.describe import describe
from data_synth.distribution import Choice, Fixed, LogUniform, Uniform, Whole
from data_synth.draw import draw_scene
from data_synth.preset import Preset, Rules
from data_synth.presets import PRESETS, preset_named
from tests.data_synth.small import SMALL, small_dataset
from tests.groups import DATASETS, FULL

pytestmark = DATASETS
MANY = 2000


@pytest.mark.parametrize(
    ("drawn", "mean"),
    [
        (Fixed(3.0), 3.0),
        (Uniform(1.0, 4.0), 2.5),
        (LogUniform(1.0, np.e**2), (np.e**2 - 1) / 2),
        (Whole(2, 6), 4.0),
        (Choice((1.0, 5.0)), 3.0),
    ],
    ids=lambda value: type(value).__name__,
)
def test_draws_lie_within_their_ends_and_around_their_mean(drawn, mean):
    rng = np.random.default_rng(0)
    values = np.array([drawn.draw(rng) for _ in range(MANY)])
    low, high = drawn.ends
    assert low <= values.min() <= values.max() <= high
    assert abs(values.mean() - mean) <= 4 * values.std() / np.sqrt(MANY)


@pytest.mark.parametrize(
    ("kind", "arguments"),
    [
        (Uniform, (2.0, 1.0)),
        (LogUniform, (0.0, 1.0)),
        (Whole, (3, 2)),
        (Choice, ((),)),
    ],
)
def test_distributions_without_a_range_are_refused(kind, arguments):
    with pytest.raises(ValueError, match="must"):
        kind(*arguments)


def test_a_catalogue_has_the_sizes_of_its_distributions():
    rng = np.random.default_rng(0)
    items = draw_catalogue(50, Uniform(0.02, 0.05), Uniform(2.0, 3.0), rng)
    assert [item.number for item in items] == list(range(1, 51))
    for item in items:
        assert 0.02 <= item.radius <= 0.05
        # Rounded to 0.1 mm.
        assert 1.99 <= item.height / item.radius <= 3.01
        assert item.radius == round(item.radius, 4)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_the_same_after_its_record(name):
    text = json.dumps(PRESETS[name].record())
    assert Preset.from_record(json.loads(text)) == PRESETS[name]


@pytest.mark.parametrize("name", PRESETS)
def test_a_description_begins_with_the_sentence_and_names_every_field(name):
    preset = PRESETS[name]
    text = describe(preset)
    assert text.startswith(preset.sentence)
    for part in (preset, preset.camera, preset.rules, *preset.scenery):
        for field in dataclasses.fields(part):
            assert field.name == "sentence" or f"  {field.name}" in text
    for kind in preset.scenery:
        assert f"  {type(kind).__name__}\n" in text


def scenes_of(preset, count=200):
    """Scenes that were drawn, and those that a rule of drawing rejected."""
    rng = np.random.default_rng(1)
    catalogue = draw_catalogue(preset.objects, preset.radius, preset.aspect, rng)
    scenes = [draw_scene(preset, catalogue, rng) for _ in range(count)]
    return [s for s in scenes if s.failure is None], scenes


@FULL
@pytest.mark.parametrize("name", PRESETS)
def test_most_scenes_of_a_preset_find_room(name):
    # Distances of things in contact, and of many stems, take long to find.
    is_slow = PRESETS[name].is_mixed or name == "tree_scan"
    good, scenes = scenes_of(PRESETS[name], 40 if is_slow else 200)
    assert len(good) > 0.8 * len(scenes)
    for scene in good:
        count = len(scene.poses) - scene.num_clutter
        low, high = PRESETS[name].count.ends
        assert low <= count <= high
        for pose in scene.poses:
            np.testing.assert_allclose(
                pose.rotation.T @ pose.rotation, np.eye(3), atol=1e-12
            )
            assert np.linalg.det(pose.rotation) == pytest.approx(1)


def surface_points(pose, rng, count=400):
    """Points on a cylinder's surface and within it."""
    radius = pose.item.radius * np.sqrt(rng.random(count))
    angle = rng.uniform(0, 2 * np.pi, count)
    along = rng.uniform(-0.5, 0.5, count) * pose.item.height
    local = np.stack([radius * np.cos(angle), radius * np.sin(angle), along], axis=1)
    return pose.center + local @ pose.rotation.T


def inside(points, pose):
    local = (points - pose.center) @ pose.rotation
    within = np.hypot(local[:, 0], local[:, 1]) < pose.item.radius
    return within & (np.abs(local[:, 2]) < pose.item.height / 2)


@pytest.mark.parametrize("name", ["tabletop_cans", "pipes", "hard"])
def test_cylinders_do_not_meet_each_other_or_the_camera(name):
    rng = np.random.default_rng(2)
    good, _ = scenes_of(PRESETS[name], 60)
    for scene in good:
        for k, pose in enumerate(scene.poses):
            points = surface_points(pose, rng)
            for other in scene.poses[:k]:
                assert not inside(points, other).any()
            assert not inside(np.zeros((1, 3)), pose).any()


def test_cans_stand_or_lie_on_the_table():
    good, _ = scenes_of(PRESETS["tabletop_cans"], 100)
    ways = set()
    for scene in good:
        point, up = scene.planes[0]
        for pose in scene.poses:
            upright = abs(pose.axis @ up)
            stands = upright > 0.999
            ways.add(stands)
            assert stands or upright < 1e-9
            lift = pose.item.height / 2 if stands else pose.item.radius
            assert (pose.center - point) @ up == pytest.approx(lift)
    assert ways == {True, False}


def test_a_pipe_is_around_the_camera():
    good, _ = scenes_of(PRESETS["inside_pipe"], 50)
    for scene in good:
        (pose,) = scene.poses
        assert inside(np.zeros((1, 3)), pose).all()
        assert pose.axis[2] > np.cos(np.radians(20.1))


def test_clutter_is_before_what_the_camera_looks_at():
    preset = dataclasses.replace(SMALL, clutter=Fixed(2), spread=0.01)
    good, _ = scenes_of(preset, 50)
    assert good
    for scene in good:
        point, _ = scene.planes[0]
        for pose in scene.poses[-2:]:
            assert 0.4 * point[2] - 0.02 < pose.center[2] < 0.8 * point[2] + 0.02


def test_keys_of_images_and_attempts_differ():
    import jax
    import jax.numpy as jnp

    number = jnp.array([0, 0, 1, 1], jnp.uint32)
    attempt = jnp.array([0, 1, 0, 1], jnp.uint32)
    pair = capture_keys(jax.random.key(3), number, attempt)
    data = np.concatenate([jax.random.key_data(keys) for keys in pair])
    assert len(np.unique(data, axis=0)) == 8


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"objects": 51}, "objects must be a whole number from 1 to 50"),
        ({"ground": False}, "ground must be True"),
        ({"placement": ()}, "placement must be some of"),
        ({"radius": Uniform(-0.1, 0.1)}, "radius must be positive"),
        ({"distance": Fixed(0.0)}, "distance must be positive"),
        ({"depth_scale_mm": 0.0}, "depth_scale_mm must be positive"),
        ({"clutter": Fixed(-1)}, "clutter must not be negative"),
        ({"count": Fixed(200), "clutter": Fixed(60)}, "at most 255 cylinders together"),
    ],
)
def test_bad_presets_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(SMALL, **changes)


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (CameraDraw, {"width": 0}, "width must be a whole number"),
        (CameraDraw, {"count": 0}, "count must be a whole number"),
        (Rules, {"visible_fraction": 1.5}, "visible_fraction must be"),
        (Rules, {"smallest_outline": -1}, "smallest_outline must be"),
        (Rules, {"most_attempts": 0}, "most_attempts must be"),
    ],
)
def test_bad_parts_of_a_preset_are_refused(kind, values, message):
    with pytest.raises(ValueError, match=message):
        kind(**values)


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ({}, "preset must say the kind of each part"),
        ({"kind": "Presets"}, "kind of a part of a preset must be one of"),
        ({"kind": "Fixed", "value": 1.0}, "preset must be of the kind Preset"),
        ({"kind": "Preset"}, "preset must be the record of one"),
    ],
)
def test_records_of_something_else_are_refused(record, message):
    with pytest.raises(ValueError, match=message):
        Preset.from_record(record)


def test_an_unknown_preset_is_refused():
    with pytest.raises(ValueError, match=r"preset must be one of bench.*got 'shelf'"):
        preset_named("shelf")


@pytest.mark.parametrize(
    ("changes", "rule"),
    [
        ({"rules": Rules(smallest_outline=10**6, most_attempts=3)}, "smallest_outline"),
        (
            {"rules": Rules(visible_fraction=1.0, smallest_outline=0, most_attempts=2),
             "count": Fixed(2), "spread": 0.5, "aspect": Fixed(12.0)},
            "visible_fraction",
        ),
        (
            {"count": Fixed(40), "rules": Rules(most_attempts=2)},
            "no_room",
        ),
    ],
)  # fmt: skip
def test_rules_that_reject_everything_are_an_error_and_no_endless_loop(
    tmp_path, changes, rule
):
    preset = dataclasses.replace(SMALL, **changes)
    with pytest.raises(ValueError, match=f"all scenes for image.*rejected.*{rule}"):
        small_dataset(tmp_path, preset, count=1)
    assert list((tmp_path / "train").iterdir()) == []
