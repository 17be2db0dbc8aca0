"""Things beside cylinders: they rest, stay apart or touch, and are written and read."""

import dataclasses
import itertools
import json

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from data_synth import solid
from data_synth.catalogue import Item, draw_catalogue
from data_synth.contact import are_apart, slide_to_touch
from data_synth.distribution import Fixed, Uniform
from data_synth.draw import draw_scene
from data_synth.pose import Pose
from data_synth.presets import PRESETS
from data_synth.preview import preview
from data_synth.scenery import (
    Arms,
    Bags,
    Bottles,
    Bumps,
    Cones,
    Corners,
    Hands,
    Pillars,
    Rolls,
)
from data_synth.validate import validate
from impostor_jax.__main__ import main
from impostor_jax.io.dataset import read_dataset
from impostor_jax.primitives import PRIMITIVES
from tests.data_synth.small import HEIGHT, SMALL, WIDTH, small_dataset
from tests.groups import DATASETS, FULL, RELEASE

pytestmark = [DATASETS, FULL]
MIXED = ("mixed_table", "no_cylinders")

EMPTY = dataclasses.replace(
    SMALL,
    sentence="Scenery alone.",
    objects=0,
    count=Fixed(0),
    clutter=Fixed(0),
    scenery=(
        Pillars(Fixed(1), width=Fixed(0.2), height=Fixed(0.4), beyond=Fixed(0.3)),
        Hands(Fixed(1), length=Fixed(0.2)),
        Cones(
            Fixed(1), radius=Fixed(0.05), aspect=Fixed(2.0), half_angle=Fixed(8.0),
            inverted=0.5, lying=0.5,
        ),
        Corners(Fixed(1), beyond=Fixed(0.6)),
    ),
)  # fmt: skip


@pytest.fixture(scope="module")
def scenes():
    """Scenes of both presets, by name."""
    found = {}
    for name in MIXED:
        preset, rng = PRESETS[name], np.random.default_rng(4)
        catalogue = draw_catalogue(preset.objects, preset.radius, preset.aspect, rng)
        drawn = [draw_scene(preset, catalogue, rng) for _ in range(40)]
        found[name] = [scene for scene in drawn if scene.failure is None]
    return found


def things_of(scene):
    return [*scene.poses, *scene.scenery]


def height_over_table(scene, thing):
    """Of its lowest and its highest point."""
    point, up = scene.planes[0]
    return [(thing.farthest(way) - point) @ up for way in (-up, up)]


def ball(center, radius):
    return solid.Cluster("ball", np.array([center], float), np.array([radius]))


def upright(center, radius, height):
    return Pose(Item(1, radius, height), np.array(center, float), np.eye(3))


def lying(center, radius, height):
    turned = np.eye(3)[:, [1, 2, 0]]
    return Pose(Item(1, radius, height), np.array(center, float), turned)


BOX = solid.Cuboid("box", np.zeros(3), np.eye(3), np.array([0.2, 0.2, 0.2]))


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (ball([0, 0, 0], 0.03), ball([0, 0, 0], 0.05), 0.08),
        (ball([0, 0, 0.04], 0.02), ball([0, 0, 0], 0.06), (0.08**2 - 0.04**2) ** 0.5),
        (ball([0, 0.07, 0], 0.02), BOX, 0.12),
        (upright([0, 0, 0], 0.03, 0.1), upright([0, 0, 0.05], 0.04, 0.1), 0.07),
        (upright([0, 0.05, 0], 0.03, 0.1), BOX, 0.13),
        (lying([0, 0, 0], 0.03, 0.1), BOX, 0.15),
        # A ball of the same radius touches the middle of the wall, or the rim.
        (ball([0, 0, 0], 0.03), lying([0, 0, 0], 0.03, 0.1), 0.08),
        (upright([0, 0, 0], 0.03, 0.1), lying([0, 0.02, 0], 0.04, 0.1), 0.08),
    ],
)  # fmt: skip
def test_what_slides_stops_at_the_contact(one, other, expected):
    along, gap = np.array([1.0, 0.0, 0.0]), 5e-4
    without, with_gap = (slide_to_touch(one, other, along, g) for g in (1e-7, gap))
    assert expected < without < expected + 2e-6
    assert without + 0.9 * gap < with_gap < without + 3 * gap
    assert are_apart(one.moved(with_gap * along), other, gap - 1e-6)
    assert not are_apart(one.moved(with_gap * along), other, gap + 1e-6)
    assert not are_apart(one.moved((without - 1e-4) * along), other, 0.0)


def test_what_never_meets_needs_no_slide():
    along = np.array([1.0, 0.0, 0.0])
    assert slide_to_touch(ball([0, 0, 0.3], 0.02), BOX, along, 1e-4) == 0
    assert slide_to_touch(ball([0.3, 0, 0], 0.02), BOX, along, 1e-4) == 0


def inside(thing, points):
    """Which points are in a thing, by its fields."""
    if isinstance(thing, solid.Cluster):
        away = np.linalg.norm(points[:, None] - thing.center, axis=2)
        return (away < thing.radius).any(axis=1)
    if isinstance(thing, solid.Cuboid):
        local = (points - thing.center) @ thing.rotation
        return (np.abs(local) < thing.size / 2).all(axis=1)
    if isinstance(thing, Pose):
        half = thing.item.height / 2 * thing.axis
        ends, radii = (
            (thing.center - half, thing.center + half),
            [thing.item.radius] * 2,
        )
    else:
        ends, radii = (thing.p1, thing.p2), (thing.radius1, thing.radius2)
    axis = ends[1] - ends[0]
    share = (points - ends[0]) @ axis / (axis @ axis)
    away = np.linalg.norm(points - ends[0] - share[:, None] * axis, axis=1)
    radius = radii[0] + share * (radii[1] - radii[0])
    return (share > 0) & (share < 1) & (away < radius)


@pytest.mark.parametrize("name", MIXED)
def test_things_do_not_meet_and_rest_on_the_table(scenes, name):
    rng = np.random.default_rng(5)
    for scene in scenes[name]:
        things = things_of(scene)
        for thing in things:
            points = thing.middle + rng.uniform(-1, 1, (2000, 3)) * thing.reach
            points = points[inside(thing, points)]
            for other in things:
                assert other is thing or not inside(other, points).any()
            for point, normal in scene.planes[1:]:
                assert ((points - point) @ normal > 0).all()
            low, high = height_over_table(scene, thing)
            assert high > 0.005
            if isinstance(thing, Pose):
                assert low == pytest.approx(0, abs=1e-9) or is_stacked(scene, thing)
            elif thing.kind == "bump":
                assert low < 0.01
            else:
                assert low == pytest.approx(0, abs=1e-8)


def is_stacked(scene, pose):
    return any(stands_on(scene, pose, other) for other in scene.poses)


def stands_on(scene, pose, other):
    """Whether the lower end of one is on the upper end of another."""
    up = scene.planes[0][1]
    low = height_over_table(scene, pose)[0]
    top = height_over_table(scene, other)[1]
    offset = pose.center - other.center
    aside = np.linalg.norm(offset - offset @ up * up)
    return abs(low - top) < 1e-9 and aside < other.item.radius


def test_stacked_cans_stand_on_another_that_stands(scenes):
    found = 0
    for scene in scenes["mixed_table"]:
        up = scene.planes[0][1]
        for pose, other in itertools.permutations(scene.poses, 2):
            if pose.axis @ up > 0.999 and stands_on(scene, pose, other):
                found += 1
                assert other.axis @ up > 0.999
                assert height_over_table(scene, other)[0] == pytest.approx(0, abs=1e-9)
    assert found > 10


@pytest.mark.parametrize("name", MIXED)
def test_a_quarter_of_the_things_is_put_in_contact(scenes, name):
    """Gaps are up to 1 mm where things touch, and more than 2 mm elsewhere."""
    touching = total = 0
    kinds = set()
    for scene in scenes[name]:
        things = [t for t in things_of(scene) if t.is_convex]
        total += len(things)
        for one, other in itertools.combinations(things, 2):
            if are_apart(one, other, 0.002 - 1e-6):
                continue
            on_top = isinstance(one, Pose) and isinstance(other, Pose)
            if on_top and stands_on(scene, other, one):
                continue
            assert not are_apart(one, other, 0.001 + 1e-6)
            touching += 1
            kinds.add((type(one).__name__, type(other).__name__))
    # Some more of those that lean, and less of the first and of those that stand on.
    assert 0.15 < touching / total < 0.35
    if name == "mixed_table":
        assert {("Pose", "Pose"), ("Pose", "Cuboid")} <= kinds


def test_scenery_is_no_cylinder(scenes):
    for scene in scenes["no_cylinders"]:
        assert scene.poses == ()
        for thing in scene.scenery:
            if isinstance(thing, solid.Round):
                length = np.linalg.norm(thing.p2 - thing.p1)
                angle = np.arctan2(abs(thing.radius1 - thing.radius2), length)
                assert np.degrees(angle) > 3.99


@pytest.fixture(scope="module")
def empty(tmp_path_factory):
    """Datasets of images without cylinders, by layout."""
    home = tmp_path_factory.mktemp("empty")
    for layout in ("bop", "webdataset"):
        small_dataset(home / layout, EMPTY, layout=layout, count=3, shard_size=2)
    return {layout: home / layout for layout in ("bop", "webdataset")}


@pytest.mark.parametrize("layout", [pytest.param("bop", marks=RELEASE), "webdataset"])
def test_images_without_cylinders_are_written_and_read(empty, layout, tmp_path, capsys):
    folder = empty[layout]
    images = list(read_dataset(folder))
    assert len(images) == 3
    for image in images:
        assert image.mask.shape == (0, HEIGHT, WIDTH)
        assert image.cylinders.batch_shape == (0,)
        assert image.visible_fraction.shape == (0,)
        assert (image.depth > 0).mean() > 0.7
    assert validate(folder) == []
    assert json.loads((folder / "models" / "models_info.json").read_text()) == {}
    preview(folder, tmp_path / "sheet.png")
    assert cv2.imread(str(tmp_path / "sheet.png")).shape == (480, 640, 3)


def test_both_layouts_have_the_same_images_without_cylinders(empty):
    for one, other in zip(*map(read_dataset, empty.values()), strict=True):
        np.testing.assert_array_equal(one.depth, other.depth)


def test_evaluate_ends_well_without_cylinders(empty, tmp_path, capsys, monkeypatch):
    path = tmp_path / "outcomes.json"
    words = ["evaluate", str(empty["bop"]), "--json", str(path)]
    monkeypatch.setattr("sys.argv", ["impostor-jax", *words])
    assert main() == 0
    assert capsys.readouterr().out == f"{empty['bop']}: no cylinder to fit\n"
    assert json.loads(path.read_text()) == []


def test_labels_of_scenery_render_the_clean_depth(empty):
    folder = empty["bop"] / "train" / "000000"
    label = json.loads((folder / "scene_cylinders.json").read_text())["0"]
    assert label["cylinders"] == []
    shapes = [ij.Plane(p["point_m"], p["normal"]) for p in label["planes"]]
    kinds = set()
    for record in label["scenery"]:
        kinds.add(record.pop("kind"))
        shapes.append(PRIMITIVES[record.pop("type")](**record))
    assert kinds == {"pillar", "hand", "cone"}
    assert len(label["planes"]) == 4
    camera = read_dataset(empty["bop"])[0].camera
    seen = ij.render(ij.Scene(shapes), camera, ("depth",))
    clean = cv2.imread(str(folder / "depth_clean" / "000000.png"), -1)
    np.testing.assert_allclose(clean, np.asarray(seen.depth) / 1e-4, atol=0.51)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"count": Fixed(-1)}, "count must not be negative"),
        ({"objects": 0}, "objects must be a whole number from 1"),
        ({"touching": 1.5}, "touching must be a fraction from 0 to 1"),
        ({"touching": 0.5, "ground": False, "placement": ("free",)}, "ground must be"),
        ({"scenery": EMPTY.scenery, "placement": ("around",)}, "must not be around"),
    ],
)
def test_bad_presets_of_scenery_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(SMALL, **changes)


SOFT = {
    "arm": Arms(
        Fixed(1), length=Fixed(0.25), radius=Fixed(0.04), taper=Fixed(0.6),
        swell=Fixed(0.1), bend=Fixed(0.05),
    ),
    "bottle": Bottles(
        Fixed(1), radius=Fixed(0.04), aspect=Fixed(4.0), waist=Fixed(0.2),
        neck=Fixed(0.4), shoulder=Fixed(0.4), lying=0.5,
    ),
    "bag": Bags(Fixed(1), size=Fixed(0.06), lump=Uniform(0.3, 0.7)),
    "roll": Rolls(
        Fixed(1), length=Fixed(0.2), radius=Fixed(0.04), unevenness=Fixed(0.15),
        wave=Fixed(1.5),
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", SOFT)
def test_what_is_soft_lies_on_the_table_and_is_no_cylinder(kind):
    rng = np.random.default_rng(1)
    for _ in range(20):
        thing = SOFT[kind].draw(0.2, rng).object
        assert thing.kind == kind
        bottom = thing.center[:, 2] - thing.radius
        assert bottom.min() == pytest.approx(0, abs=1e-12)
        assert len(thing.radius) == SOFT[kind].shapes[1]
        # Balls of one size in a row would be a cylinder.
        assert np.ptp(thing.radius) > 0.05 * thing.radius.max()


def test_a_bottle_may_have_a_belly():
    wide = dataclasses.replace(SOFT["bottle"], waist=Fixed(-0.2), lying=0.0)
    thing = wide.draw(0.2, np.random.default_rng(0)).object
    assert 0.044 < thing.radius.max() < 0.05
    assert thing.radius.argmax() not in (0, len(thing.radius) - 1)


def test_bad_scenery_is_refused():
    with pytest.raises(ValueError, match="stretch of Bumps must not be negative"):
        Bumps(Fixed(1), Fixed(0.1), stretch=Uniform(-1.0, 1.0), part=Fixed(1.0))
    with pytest.raises(ValueError, match="radius of Bottles must not be negative"):
        dataclasses.replace(SOFT["bottle"], radius=Fixed(-0.1))
