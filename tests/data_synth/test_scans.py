"""Range images of a scanner among stems: what is drawn, read and labeled."""

import dataclasses
import json

import cv2
import jax
import numpy as np
import pytest

import impostor_jax as ij
from data_synth.camera_draw import CameraDraw, ScannerDraw
from data_synth.distribution import Fixed, Uniform, Whole
from data_synth.presets import PRESETS
from data_synth.preview import preview
from data_synth.roughness import Roughness, roughened
from data_synth.validate import validate
from tests.data_synth.small import small_dataset
from tests.groups import DATASETS, FULL

pytestmark = [DATASETS, FULL]
PRESET = PRESETS["tree_scan"]
SMALL = dataclasses.replace(
    PRESET,
    objects=6,
    count=Whole(4, 6),
    radius=Uniform(0.2, 0.4),
    aspect=Fixed(20.0),
    distance=Uniform(3.0, 8.0),
    camera=ScannerDraw(width=192, height=32, stand=Uniform(1.5, 2.0)),
)


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans") / "dataset"
    small_dataset(folder, SMALL, count=3)
    return folder


def test_a_scan_is_read_as_it_was_drawn(scans):
    for image in ij.read_dataset(scans):
        assert isinstance(image.camera, ij.SphericalCamera)
        assert image.depth.shape == (32, 192)
        center = np.asarray(image.cylinders.center)
        stems = ij.render(ij.Scene([image.cylinders]), image.camera, ("depth", "index"))
        seen = image.mask.any(axis=0)
        index = np.where(seen, image.mask.argmax(axis=0), -1)
        # Where a stem is seen it is the nearest of the stems; the ground hides others.
        np.testing.assert_array_equal(index[seen], np.asarray(stems.index)[seen])
        error = (image.depth - np.asarray(stems.depth))[seen & (image.depth > 0)]
        assert np.median(np.abs(error)) < 0.008
        assert image.visible_fraction.max() > 0.9
        with pytest.raises(ValueError, match="must have a pinhole camera"):
            image.pinhole  # noqa: B018
    assert len({np.sign(z) for z in center[:, 2]}) == 2, "before and behind"


def test_labels_hold_the_scanner_and_the_mounds(scans):
    scene = scans / "train" / "000000"
    camera = json.loads((scene / "scene_camera.json").read_text())["0"]
    assert camera == {"depth_scale": 1.0}
    labels = json.loads((scene / "scene_cylinders.json").read_text())["0"]
    assert labels["camera"]["model"] == "spherical"
    (ground,) = labels["planes"]
    assert 1.5 <= ground["point_m"][1] <= 2.0
    assert {thing["kind"] for thing in labels["scenery"]} == {"mound"}
    for mound in labels["scenery"]:
        top = mound["center"][0][1] - mound["radius"][0]
        assert 0.1 <= ground["point_m"][1] - top <= 0.6


def test_scans_are_good_and_have_a_preview(scans, tmp_path):
    assert validate(scans) == []
    preview(scans, tmp_path / "sheet.png")
    assert cv2.imread(str(tmp_path / "sheet.png")).shape == (2 * 53, 640, 3)


def test_stems_stand_all_around_at_their_distances(scans):
    centers = np.concatenate([i.cylinders.center for i in ij.read_dataset(scans)])
    axes = np.concatenate([i.cylinders.axis for i in ij.read_dataset(scans)])
    assert (-axes[:, 1] > np.cos(np.radians(6.001))).all()
    away = np.hypot(*centers[:, [0, 2]].T)
    # Middles lean off the feet by up to 0.42 m.
    assert ((away > 2.5) & (away < 8.5)).all()


def test_rough_surfaces_have_their_deviation_and_correlation():
    camera = ij.PinholeCamera(200.0, 200.0, 49.5, 39.5, 100, 80)
    maps = ij.render(ij.Plane((0, 0, 2), (0, 0, -1)), camera)
    make = jax.jit(
        lambda key: roughened(key, maps.depth, maps.normal, camera, 0.003, 0.05)
    )
    bumps = np.stack([make(jax.random.key(k)) - maps.depth for k in range(40)])
    # Of forty draws, each of some ten independent places.
    assert bumps.std() == pytest.approx(0.003, rel=0.1)
    # Five pixels are 0.05 m at 2 m, one correlation length.
    next_ones = (bumps[:, :, :-5] * bumps[:, :, 5:]).mean() / bumps.var()
    assert next_ones == pytest.approx(np.exp(-0.5), abs=0.1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"placement": ("standing",)}, "placement must be surrounding, and nothing"),
        ({"camera": CameraDraw()}, "placement must be surrounding, and nothing else"),
        ({"wall": Fixed(9.0)}, "wall must be None for a scanner"),
        ({"projector_baseline": 0.1}, "projector_baseline must be None for a scanner"),
        ({"clutter": Whole(0, 1)}, "clutter, things in contact and things on a table"),
        ({"ground": False}, "ground must be True for cylinders that are"),
    ],
)
def test_what_a_scanner_cannot_have_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(PRESET, **changes)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ScannerDraw(up=Fixed(-40.0)), "down must be below up, both from -85"),
        (lambda: ScannerDraw(down=Fixed(-90.0)), "down must be below up, both from"),
        (lambda: ScannerDraw(stand=Fixed(0.0)), "stand must be positive"),
        (lambda: Roughness(0.0, 0.1), "deviation must be positive, in meters"),
    ],
)
def test_bad_scanners_and_surfaces_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
