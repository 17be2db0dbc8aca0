import numpy as np
import pytest

import impostor_jax as ij
from tests.groups import FULL
from tests.sensor.scenes import CAMERA, COUNT, SHAPE, normals, readings

# Less than what single precision resolves of a depth of 1 m.
STILL = ij.ConstantNoise(1e-9)
INNER = np.s_[:, 4:-4, 4:-4]
ANGLE = np.radians(50)


def wall():
    """A plane at 1 m whose normal is at an angle to the middle of the view."""
    row, col = np.mgrid[: SHAPE[0], : SHAPE[1]]
    x, y = (col - CAMERA.cx) / CAMERA.fx, (row - CAMERA.cy) / CAMERA.fy
    n = normals(ANGLE)[SHAPE[0] // 2, SHAPE[1] // 2]
    return n[2] / (n[0] * x + n[1] * y + n[2]), n


@pytest.mark.parametrize("scale", [1.0, 1.44, 2.5])
def test_the_nearer_of_two_reaches_half_a_pixel_too_far(scale):
    depth, n = wall()
    sensor = ij.AlignedDepth(STILL, scale)
    sample = readings(sensor, depth, normal=n)
    down, right = np.gradient(depth)
    lean = -(np.abs(down) + np.abs(right)) / 2
    found = np.mean((sample - depth)[INNER] / lean[INNER[1:]])
    # Places of the grid scatter by 0.29 scale: three standard errors of 16 of them.
    assert found == pytest.approx(1, abs=0.2 * scale)


def test_readings_are_copied_as_often_as_pixels_are_larger():
    depth = np.full(SHAPE, 0.9)
    sample = readings(ij.AlignedDepth(ij.ConstantNoise(0.001), 2.0), depth)
    values = np.mean([len(np.unique(one)) for one in sample])
    assert len(sample) == COUNT
    # One more along each axis: the grid begins anywhere.
    assert values == pytest.approx((SHAPE[0] / 2 + 1) * (SHAPE[1] / 2 + 1), rel=0.01)


def test_an_object_grows_by_a_pixel_at_most():
    depth = np.full(SHAPE, np.inf)
    depth[20:30, 20:40] = 0.9
    sample = readings(ij.AlignedDepth(STILL, 1.5), depth)
    assert np.isfinite(sample[:, 21:29, 21:39]).all()
    assert np.isposinf(sample[:, :18]).all()
    assert np.isposinf(sample[:, :, 42:]).all()


@FULL
@pytest.mark.parametrize("scale", [0.5, 11.0, np.nan])
def test_scales_that_no_copies_have_are_refused(scale):
    with pytest.raises(ValueError, match="native_scale must be"):
        ij.AlignedDepth(STILL, scale)
