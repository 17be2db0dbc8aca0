"""Sensors that are recovered from their own images."""

import jax
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.calibrate.calibration import calibration_of
from impostor_jax.calibrate.request import checked_images
from impostor_jax.fit.regions import DepthUnitsWarning
from impostor_jax.io.sensor_record import sensor_from_record, sensor_record
from tests.calibrate.scenes import (
    CAMERA,
    LAW,
    NATIVE_SCALE,
    SENSOR,
    image_of,
    images_of,
)
from tests.groups import FULL, RELEASE, SMALL_IMAGES

pytestmark = [SMALL_IMAGES, FULL]


@pytest.fixture(scope="module")
def twenty():
    """What twenty images of a wall and a table tell."""
    return calibration_of(images_of(SENSOR), CAMERA, native_scale=NATIVE_SCALE)


def test_noise_grain_and_warp_are_recovered_within_10_percent(twenty):
    warp, grain = twenty.sensor, twenty.sensor.sensor
    assert isinstance(grain.sensor, ij.MatchingWindow)
    found, truth = twenty.law, LAW
    for name in ("floor", "growth", "grazing"):
        assert getattr(found, name) == pytest.approx(getattr(truth, name), rel=0.1)
    assert float(grain.deviation) == pytest.approx(0.0006, rel=0.1)
    assert grain.length == pytest.approx(2, rel=0.1)
    assert float(warp.deviation) == pytest.approx(0.0012, rel=0.1)
    assert warp.length == pytest.approx(14, rel=0.1)


def test_what_it_says_of_its_own_errors_holds(twenty):
    deviation, length, errors = twenty.warp
    off = np.log([deviation / 0.0012, length / 14])
    assert np.all(np.abs(off) < 3 * np.array(errors))
    # A field of 14 pixels has 500 independent parts on so many: 3 % of its deviation.
    assert max(errors) < 0.06


def test_the_summary_tells_what_was_found_on_what(twenty):
    lines = twenty.summary().splitlines()
    assert lines[0].startswith("40 planes in 20 images, 27")
    assert [line.split()[0] for line in lines[1:]] == ["noise", "grain", "warp"]
    assert "mm at 1 m (std 0.0" in lines[3]


def test_a_sensor_is_its_record_again(twenty):
    record = sensor_record(twenty.sensor)
    again = sensor_from_record(record, "sensor")
    assert sensor_record(again) == record
    assert again.bias.window_reach == 3
    assert len(again.bias.fields) == 2


@RELEASE
def test_independent_noise_has_neither_grain_nor_warp():
    sensor = ij.MatchingWindow(LAW, native_scale=NATIVE_SCALE)
    found = calibration_of(images_of(sensor, 6), CAMERA, native_scale=NATIVE_SCALE)
    assert found.grain is None
    assert found.warp is None
    assert isinstance(found.sensor, ij.MatchingWindow)
    assert found.law.floor == pytest.approx(0.001, rel=0.05)


@pytest.mark.parametrize(
    ("kind", "law", "names"),
    [
        pytest.param(
            "time_of_flight",
            ij.TimeOfFlight(floor=0.002, growth=0.003),
            ("floor", "growth"),
            id="noise of light that comes back",
        ),
        pytest.param(
            "constant",
            ij.ConstantNoise(0.004),
            ("deviation",),
            id="of one size",
            marks=RELEASE,
        ),
        pytest.param(
            "stereo",
            ij.StereoDisparity(280.0, 0.05, deviation=0.1, step=0.0),
            ("deviation",),
            id="of the disparity",
            marks=RELEASE,
        ),
    ],
)
def test_other_kinds_have_laws_of_their_own(kind, law, names):
    options = {"kind": kind, "native_scale": NATIVE_SCALE}
    found = calibration_of(images_of(law, 6, seed=3), CAMERA, **options)
    assert (found.grain, found.warp) == (None, None)
    for name in names:
        assert getattr(found.law, name) == pytest.approx(getattr(law, name), rel=0.05)


@RELEASE
def test_a_warp_larger_than_the_noise_tears_no_planes():
    """Once its crests were cut off as not on the plane, and it came out smaller."""
    sensor = ij.CorrelatedNoise(ij.TimeOfFlight(0.001, 0.0005), 0.006, 20.0, power=0.0)
    images = images_of(sensor, 12, seed=2)
    found = calibration_of(images, CAMERA, kind="time_of_flight")
    deviation, length, errors = found.warp
    off = np.log([deviation / 0.006, length / 20])
    assert np.all(np.abs(off) < 4 * np.array(errors))


def test_noise_at_one_distance_grows_as_is_usual():
    wall = [image_of(ij.StructuredLight(0.0036, 0.0057), 0.8, 0.0, 0.5, seed=4)[0]]
    mask = np.zeros((120, 160), bool)
    mask[:50] = True
    sensor = ij.calibrate_sensor(wall, CAMERA, mask, half_window=0)
    law, usual = sensor.sensor, ij.StructuredLight()
    # Only the third number, which incidence tells of, pulls at these two.
    assert law.growth / law.floor == pytest.approx(usual.growth / usual.floor, rel=0.3)
    assert law.floor == pytest.approx(0.0036, rel=0.1)


def test_readings_that_were_smoothed_keep_their_scatter_in_the_law():
    """Of a law without the grain a fit would call a good can a poor fit."""
    smooth = ij.CorrelatedNoise(ij.ConstantNoise(0.0005), 0.003, 3.0, power=0)
    found = calibration_of(images_of(smooth, 4, seed=5), CAMERA, kind="constant")
    assert found.is_filtered
    assert found.law.deviation == pytest.approx(0.00304, rel=0.05)
    assert float(found.sensor.deviation) == pytest.approx(0.003, rel=0.1)
    assert "counted in the noise too" in found.summary()


RADIUS = 0.12


def with_a_can(sensor, count=3):
    """Images of a can before a wall, and its masks."""
    images, masks = [], []
    for seed in range(count):
        can = ij.Cylinder((0.05 * seed, 0.0, 0.8), (0.1, 1.0, 0.1), RADIUS, 3.0)
        image, maps = image_of(sensor, 1.6, 0.2, 0.5, seed=seed, shapes=[can])
        images.append(image)
        masks.append(np.asarray(maps.index) == 2)
    return np.stack(images), np.stack(masks)


@RELEASE
@pytest.mark.parametrize(
    ("kind", "noise", "law", "mean"),
    [
        ("constant", ij.ConstantNoise(0.001), "scale", -0.03),
        ("structured_light", ij.StructuredLight(0.0006, 0.001), "disparity", 0.04),
    ],
)
def test_the_scale_is_that_of_an_object_of_known_size(kind, noise, law, mean):
    truth = ij.ScaleError(noise, 0.0, mean, law)
    images, objects = with_a_can(truth)
    found = calibration_of(
        images, CAMERA, kind=kind, objects=objects, radius=RADIUS,
        native_scale=NATIVE_SCALE,
    )  # fmt: skip
    assert found.sensor.law == law
    assert found.scale.number == 3
    # What so few do not tell is in the deviation, which is small nevertheless.
    assert abs(found.sensor.mean - mean) < 2 * found.sensor.deviation
    assert abs(found.sensor.mean - mean) < 0.01
    assert found.sensor.deviation < 0.015


DEPTH = np.ones((120, 160), np.float32)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"depths": DEPTH[:-1]}, r"depths must be .* of the camera's shape \(120, 160"),
        ({"depths": np.ones((0, 120, 160))}, "depths must be"),
        ({"depths": -DEPTH}, "depth must not be negative"),
        ({"depths": np.ones((120, 160), int)}, "depth must be floating-point meters"),
        ({"depths": 0 * DEPTH}, "planes on at least 3000 pixels, .* got 0: a bare"),
        ({"mask": DEPTH[:-1] > 0}, "mask must have the shape"),
        ({"mask": DEPTH}, "mask must be of booleans or integers, got float32"),
        ({"kind": "sonar"}, "kind must be one of structured_light, stereo"),
        ({"native_scale": 0.0}, "native_scale must be a positive number"),
        ({"half_window": -1.0}, "half_window must be 0 or positive, got -1.0"),
        ({"baseline": "wide"}, "baseline must be a positive number in meters"),
        ({"objects": DEPTH > 0}, "radius must be given with objects"),
        ({"radius": 0.1}, "objects must be given with radius"),
        ({"objects": DEPTH > 0, "radius": -1.0}, "radius must be a positive number"),
        ({"objects": DEPTH > 2, "radius": 0.1}, "objects must hold at least one pixel"),
    ],
)
def test_bad_arguments_are_named(changes, message):
    given = {"depths": DEPTH, "camera": CAMERA, **changes}
    with pytest.raises(ValueError, match=message):
        ij.calibrate_sensor(given.pop("depths"), given.pop("camera"), **given)


def test_depth_in_millimeters_gets_a_hint():
    with pytest.warns(DepthUnitsWarning, match="in millimeters"):
        checked_images(1000 * DEPTH, CAMERA)


def test_a_traced_image_is_refused():
    with pytest.raises(ValueError, match="must be concrete"):
        jax.jit(lambda depth: ij.calibrate_sensor(depth, CAMERA).floor)(DEPTH)
