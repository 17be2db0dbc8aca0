"""Errors across the ray: as they are drawn, and what is refused."""

import jax
import numpy as np
import pytest

import impostor_jax as ij
from tests.groups import FULL
from tests.sensor.scenes import CAMERA, readings

ALONG = 0.001
DEPTH = 1.0


@FULL
@pytest.mark.parametrize("angle", [0.0, 1.2])
@pytest.mark.parametrize("told", [{"across": 0.002}, {"angle": 0.002}])
def test_what_grazes_errs_by_what_the_ray_errs(told, angle):
    # A small part of a pixel: the surface that is met is that of the pixel itself.
    assert 0.002 < 0.4 / float(CAMERA.fx)
    row, col = np.mgrid[: CAMERA.height, : CAMERA.width]
    x, y = (col - CAMERA.cx) / CAMERA.fx, (row - CAMERA.cy) / CAMERA.fy
    length = np.sqrt(x**2 + y**2 + 1)
    error = 0.002 if "across" in told else 0.002 * length
    found = readings(ij.ConstantNoise(ALONG, **told), DEPTH, angle) - DEPTH
    expected = np.hypot(ALONG, error * np.tan(angle) / length)
    ratio = found / expected
    assert np.std(ratio) == pytest.approx(1, rel=0.03)
    assert abs(np.mean(ratio)) < 0.05


def test_a_ray_that_is_told_to_be_exact_draws_as_one_of_which_nothing_is_known():
    known = readings(ij.ConstantNoise(ALONG, across=0.0), DEPTH, 1.2)
    assert np.std(known - DEPTH) == pytest.approx(ALONG, rel=0.03)
    assert ij.ConstantNoise(ALONG).bias.has_exact_rays
    assert not ij.ConstantNoise(ALONG, across=0.0).bias.has_exact_rays


def test_a_ray_beside_an_outline_reads_what_lies_there():
    depth = np.full((CAMERA.height, CAMERA.width), 2.0, np.float32)
    depth[:, : CAMERA.width // 2] = 1.0
    pixel = 1 / float(CAMERA.fx)
    found = readings(ij.ConstantNoise(ALONG, angle=2 * pixel), depth)
    border = CAMERA.width // 2
    beside, away = found[:, :, border], found[:, :, border + 12]
    assert 0.2 < np.mean(beside < 1.5) < 0.5
    assert not np.any(away < 1.5)


@pytest.mark.parametrize("model", [
    ij.ConstantNoise, ij.StructuredLight, ij.TimeOfFlight,
    lambda *args, **told: ij.StereoDisparity(500.0, **told),
])  # fmt: skip
def test_errors_that_make_no_sense_are_refused(model):
    with pytest.raises(ValueError, match="across must be 0 or positive, in meters"):
        model(0.001, across=-1.0)
    with pytest.raises(ValueError, match="angle must be from 0 to 0"):
        model(0.001, angle=5.0)


def test_wrappers_hand_it_on():
    sensor = ij.FlyingPixels(ij.Dropout(ij.ConstantNoise(ALONG, across=0.002)))
    assert float(sensor.bias.across) == pytest.approx(0.002)
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(sensor))
