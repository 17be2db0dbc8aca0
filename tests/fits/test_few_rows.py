"""Scans of few rows, of which no window of pixels tells a surface."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.measured import NOT_MEASURED
from tests.groups import FULL, OF_POINTS

pytestmark = OF_POINTS

SIGMA = 0.02
SCANNER = ij.SphericalCamera(
    np.radians(np.arange(-15.0, 16.0, 2.0)), np.radians(np.arange(-8.0, 8.0, 0.4))
)
TRUNK = ij.Cylinder((0.1, 0.0, 8.0), (0.05, 1.0, 0.03), radius=0.2, height=6.0)


def scan(seed=0):
    """Ranges with noise, and which are of the trunk."""
    maps = ij.render(TRUNK, SCANNER, outputs=("depth", "mask"))
    ranges, mask = np.asarray(maps.depth), np.asarray(maps.mask)
    noise = np.random.default_rng(seed).normal(0, SIGMA, ranges.shape)
    return np.where(mask, ranges + noise, 0).astype(np.float32), mask


@pytest.mark.parametrize("sigma", [SIGMA, pytest.param(None, marks=FULL)])
def test_a_trunk_in_a_scan_of_16_rows_is_fitted(sigma):
    # Of 20 scans 8 had no first guess, and of 20 whose noise nobody told 13 no fit.
    ranges, mask = scan()
    fit = ij.fit_cylinder(ranges, SCANNER, mask, sigma)
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.2) < 4 * float(fit.std.radius)
    assert float(fit.std.radius) < 0.01
    assert fit.asked.measured != NOT_MEASURED
    if sigma is None:
        level = float(fit.asked.measured.split("noise of ")[1].split()[0]) / 1e3
        assert level == pytest.approx(SIGMA, rel=0.25)


@FULL
def test_what_is_no_wall_has_no_first_guess():
    ranges, mask = scan()
    scattered = np.random.default_rng(1).uniform(4, 9, ranges.shape)
    scattered = np.where(mask, scattered, 0).astype(np.float32)
    fit = ij.fit_cylinder(scattered, SCANNER, mask, SIGMA)
    assert not fit.success
