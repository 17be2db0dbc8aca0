"""Depth that is not in meters is fitted, with a hint."""

import warnings

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.regions import (
    DepthUnitsWarning,
    warn_of_units,
)
from tests.fit.scenes import CAMERA, SIGMA, image
from tests.groups import SMALL_IMAGES


@SMALL_IMAGES
def test_depth_in_millimeters_gets_a_hint():
    depth, mask = image()
    with pytest.warns(DepthUnitsWarning, match="its median is 3.* in millimeters"):
        fit = ij.fit_cylinder(1000 * depth, CAMERA, mask, SIGMA)
    assert fit.reason.endswith(": is it in millimeters?")


@SMALL_IMAGES
@pytest.mark.parametrize("sigma", [SIGMA, None])
def test_where_nothing_is_found_units_may_be_why(sigma):
    depth, _ = image()
    with pytest.warns(DepthUnitsWarning, match="in millimeters"):
        assert not ij.find_cylinders(1000 * depth, CAMERA, sigma).fits


@pytest.mark.parametrize(
    ("scale", "sensor", "warned"),
    [
        pytest.param(1000, ij.ConstantNoise(1e-3), True, id="a camera's noise"),
        pytest.param(1000, ij.StructuredLight(), True, id="out of its range"),
        pytest.param(1000, ij.StereoDisparity(525.0, 0.075), True, id="stereo"),
        pytest.param(
            1000, ij.ConstantNoise(1.0), False, id="a scene 1000 times larger"
        ),
        pytest.param(1000, ij.ConstantNoise(0.02), False, id="a lidar"),
        pytest.param(100, ij.ConstantNoise(1e-5), False, id="below 100 m"),
    ],
)
def test_units_are_asked_where_no_sensor_could_measure(scale, sensor, warned):
    depth, mask = image()
    depth = np.where(mask, scale * depth, 0).astype(np.float32)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        doubt = warn_of_units(depth, mask, sensor)
    assert [w.category for w in caught] == [DepthUnitsWarning] * warned
    assert [str(w.message) for w in caught] == [doubt] * warned


def test_what_is_far_behind_the_object_does_not_count():
    depth, mask = image()
    depth = np.where(mask, depth, 200).astype(np.float32)
    assert warn_of_units(depth, mask, ij.ConstantNoise(1e-3)) == ""
