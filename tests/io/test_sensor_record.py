"""Noise models as records."""

import json

import pytest

import impostor_jax as ij
from impostor_jax.io.sensor_record import (
    SENSORS,
    sensor_from_record,
    sensor_record,
)

MODELS = [
    ij.ConstantNoise(0.002),
    ij.TimeOfFlight(across=0.0, angle=1e-4),
    ij.StructuredLight(floor=0.001),
    ij.StereoDisparity(500.0, baseline=0.1),
    ij.LateralNoise(ij.ConstantNoise(0.001), floor=0.3),
    ij.FlyingPixels(ij.ConstantNoise(0.001), probability=0.2),
    ij.Dropout(ij.FlyingPixels(ij.StructuredLight())),
    ij.MatchingWindow(ij.StructuredLight(), native_scale=1.88),
    ij.TimeOfFlight(growth=0.002),
    ij.CorrelatedNoise(ij.ConstantNoise(0.001), 0.002, 30.0, power=1),
    ij.LineNoise(ij.ConstantNoise(0.001), 0.002, "columns", power=1),
    ij.ScaleError(ij.ConstantNoise(0.001), 0.01, law="disparity"),
    ij.AlignedDepth(ij.ConstantNoise(0.001), 1.44),
]


@pytest.mark.parametrize("model", MODELS, ids=lambda model: type(model).__name__)
def test_a_model_is_the_same_after_its_record(model):
    text = json.dumps(sensor_record(model))
    assert sensor_from_record(json.loads(text), "sensor") == model


def test_every_model_has_a_name():
    assert {type(model) for model in MODELS} == set(SENSORS.values())


def test_a_whole_camera_has_a_name_and_is_written_by_its_parts():
    record = {"type": "structured_light_camera", "native_scale": 2}
    sensor = sensor_from_record(record, "sensor")
    assert sensor == ij.StructuredLight.sensor(native_scale=2)
    assert sensor_record(sensor)["type"] == "scale_error"
    with pytest.raises(ValueError, match="lacks focal_length"):
        sensor_from_record({"type": "stereo_camera"}, "sensor")


def test_a_stereo_camera_takes_the_focal_length_of_the_image():
    record = {"type": "dropout", "sensor": {"type": "stereo"}}
    sensor = sensor_from_record(record, "sensor", focal_length=525.0)
    assert sensor == ij.Dropout(ij.StereoDisparity(525.0))
    record["sensor"]["focal_length"] = 280.0
    sensor = sensor_from_record(record, "sensor", focal_length=525.0)
    assert sensor == ij.Dropout(ij.StereoDisparity(280.0))


def test_what_is_left_out_takes_the_default():
    record = {"type": "dropout", "sensor": {"type": "structured_light"}}
    assert sensor_from_record(record, "sensor") == ij.Dropout(ij.StructuredLight())


@pytest.mark.parametrize(
    ("record", "message"),
    [
        (None, "type of sensor must be one of constant"),
        ({"type": "laser"}, "got 'laser'"),
        ({"type": "constant", "deviation": -1}, "deviation must be"),
        ({"type": "constant"}, "deviation"),
        ({"type": "constant", "deviation": 1, "mean": 2}, "unknown keys: mean"),
        ({"type": "dropout", "sensor": {"type": "x"}}, "got 'x'"),
    ],
)
def test_bad_records_are_refused(record, message):
    with pytest.raises(ValueError, match=message):
        sensor_from_record(record, "sensor")
