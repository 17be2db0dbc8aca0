"""Images in color: they show the scene of the labels, and change nothing else."""

import dataclasses
import itertools
import json

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from data_synth.appearance import Appearance
from data_synth.camera_draw import CameraDraw
from data_synth.catalogue import draw_catalogue
from data_synth.distribution import Fixed, Uniform, Whole
from data_synth.draw import draw_scene
from data_synth.preset import Preset
from data_synth.presets import PRESETS
from data_synth.preview import preview
from data_synth.scenery import Balls, Hands
from data_synth.validate import validate
from impostor_jax.io.appearance_record import light_from_record, material_from_record
from impostor_jax.io.camera_file import camera_from_record
from impostor_jax.io.color_image import srgb
from impostor_jax.io.dataset import read_dataset
from impostor_jax.primitives import PRIMITIVES
from tests.data_synth.small import HEIGHT, SMALL, WIDTH, checksums, small_dataset
from tests.groups import DATASETS, FULL, RELEASE

pytestmark = [DATASETS, FULL]
COLORED = dataclasses.replace(
    SMALL,
    scenery=(
        Balls(count=Whole(0, 2), radius=Uniform(0.03, 0.05)),
        # Of many balls, which are of one material.
        Hands(count=Whole(0, 1), length=Uniform(0.15, 0.2)),
    ),
    appearance=Appearance(mirrors=0.3, glasses=0.3, lamps=1, bounces=2),
)
PLAIN = dataclasses.replace(COLORED, appearance=None)


@pytest.fixture(scope="module")
def colored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("colored") / "dataset"
    small_dataset(folder, COLORED)
    return folder


def labels(folder, name):
    """Of each image, by the scene and the number in it."""
    for scene in sorted((folder / "train").iterdir()):
        found = json.loads((scene / f"scene_{name}.json").read_text())
        yield from ((scene, int(number), label) for number, label in found.items())


@RELEASE
def test_a_picture_is_that_of_the_labels(colored):
    seen = set()
    pairs = zip(
        labels(colored, "cylinders"), labels(colored, "appearance"), strict=True
    )
    # Of the first ones: a scene of another number of shapes is another program.
    for (scene, number, shown), (_, _, look) in itertools.islice(pairs, 3):
        shapes = [
            *(
                ij.Cylinder(c["center_m"], c["axis"], c["radius_m"], c["height_m"])
                for c in shown["cylinders"]
            ),
            *(ij.Plane(p["point_m"], p["normal"]) for p in shown["planes"]),
        ]
        materials = [*look["cylinders"], *look["planes"]]
        for thing, material in zip(shown["scenery"], look["scenery"], strict=True):
            values = {k: v for k, v in thing.items() if k not in ("kind", "type")}
            shape = PRIMITIVES[thing["type"]](**values)
            shapes.append(shape)
            materials += [material] * int(np.prod(shape.batch_shape))
        seen.update(*(material.keys() for material in materials))
        picture = cv2.imread(str(scene / "rgb" / f"{number:06d}.png"))[..., ::-1]
        assert picture.shape == (HEIGHT, WIDTH, 3)
        camera = camera_from_record(shown["camera"], "camera").camera
        expected = ij.trace(
            ij.Scene(shapes),
            camera,
            [light_from_record(light, "light") for light in look["lights"]],
            [material_from_record(made, "material") for made in materials],
            look["background"],
            COLORED.appearance.bounces,
        )
        differ = np.abs(picture - 255 * srgb(expected)).max(axis=-1) > 1
        # Rays beside an edge may meet either side.
        assert differ.mean() < 0.01
        assert picture.std() > 5
    assert seen == {"color", "exponent", "reflect", "transmit", "ior"}


@RELEASE
def test_depth_is_that_of_the_same_dataset_without_color(colored, tmp_path):
    small_dataset(tmp_path / "plain", PLAIN)
    plain, both = checksums(tmp_path / "plain"), checksums(colored)
    changed = {name for name in plain if both[name] != plain[name]}
    assert all(name.startswith("checksums/") for name in changed)
    added = {name for name in both.keys() - plain.keys() if "/rgb/" not in name}
    assert all(name.endswith("/scene_appearance.json") for name in added)


def test_color_is_read_from_folders_and_archives(colored, tmp_path):
    small_dataset(tmp_path / "archives", COLORED, layout="webdataset")
    assert validate(colored) == validate(tmp_path / "archives") == []
    for one, other in zip(
        read_dataset(colored), read_dataset(tmp_path / "archives"), strict=True
    ):
        assert one.color.shape == (HEIGHT, WIDTH, 3)
        np.testing.assert_array_equal(one.color, other.color)
    preview(colored, tmp_path / "sheet.png", count=1)
    # Depth and color side by side, each 320 wide.
    assert cv2.imread(str(tmp_path / "sheet.png")).shape == (240, 640, 3)


def test_a_picture_that_is_broken_is_named(colored, tmp_path):
    image = next(iter(labels(colored, "camera")))[0] / "rgb" / "000000.png"
    data = image.read_bytes()
    try:
        for wrong, message in (
            (b"", "is not a readable picture"),
            (cv2.imencode(".png", np.zeros((3, 4, 3)))[1].tobytes(), "shape .48, 64."),
        ):
            image.write_bytes(wrong)
            with pytest.raises(
                ValueError, match=f"color image .*000000.png'.* {message}"
            ):
                read_dataset(colored)[0]
        image.unlink()
        with pytest.raises(ValueError, match=r"color image .*000000.png' .*exist"):
            read_dataset(colored)[0]
    finally:
        image.write_bytes(data)


# Scans have no color.
COLORABLE = [
    name for name, one in PRESETS.items() if isinstance(one.camera, CameraDraw)
]


@pytest.mark.parametrize("name", COLORABLE)
def test_lamps_are_before_planes_and_in_no_thing(name):
    preset = dataclasses.replace(PRESETS[name], appearance=Appearance(lamps=3))
    rng = np.random.default_rng(2)
    catalogue = draw_catalogue(preset.objects, preset.radius, preset.aspect, rng)
    drawn = [draw_scene(preset, catalogue, rng) for _ in range(12)]
    kept = [scene for scene in drawn if scene.failure is None]
    assert len(kept) > 2
    assert sum(scene.failure == "no_room_for_lamp" for scene in drawn) < 3
    for scene in kept:
        things = [*scene.poses, *scene.scenery]
        for lamp in scene.look.lights[1:]:
            place = np.array(lamp["position"])
            assert all((place - point) @ normal > 0 for point, normal in scene.planes)
            around = preset.placement == ("around",)
            assert around or not any(
                np.linalg.norm(place - thing.middle) < thing.reach for thing in things
            )
            # What is lit there is neither dark nor far too bright.
            distance = np.linalg.norm(place - [0, 0, preset.distance.ends[0]])
            assert around or 0.01 < lamp["intensity"] / distance**2 < 2


def test_color_is_asked_for_and_recorded(tmp_path):
    # The second of two parts: nothing but the manifest.
    small_dataset(tmp_path / "asked", count=1, color=True, shard=1, num_shards=2)
    record = json.loads((tmp_path / "asked" / "manifest.json").read_text())
    assert Preset.from_record(record["preset"]).appearance == Appearance()
    assert Preset.from_record(COLORED.record()) == COLORED


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mirrors": 1.5}, "mirrors must be a fraction from 0 to 1, got 1.5"),
        ({"mirrors": 0.6, "glasses": 0.6}, "at most 1 together, got 0.6 and 0.6"),
        ({"lamps": -1}, "lamps must be"),
        ({"samples": 0}, "samples must be"),
        ({"bounces": 100}, "bounces must be"),
        ({"reflect": Fixed(1.5)}, "reflect must be from 0 to 1, got 1.5"),
        ({"ior": Fixed(0)}, "ior must be positive, got 0"),
        ({"light": Fixed(-1)}, "light must not be negative, got -1"),
    ],
)
def test_impossible_appearances_are_named(changes, message):
    with pytest.raises(ValueError, match=message):
        Appearance(**changes)


def test_several_rays_a_pixel_see_through_no_lens():
    with pytest.raises(ValueError, match="samples must be 1 for cameras with a lens"):
        dataclasses.replace(PRESETS["hard"], appearance=Appearance(samples=2))
