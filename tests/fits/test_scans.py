"""Range images of a scanner that looks all around."""

import numpy as np
import pytest

import impostor_jax as ij
from tests.groups import OF_POINTS, RELEASE

pytestmark = OF_POINTS

SIGMA = 0.002


def scanner(pose=None):
    elevation = np.radians(np.linspace(30, -30, 96))
    azimuth = np.radians(np.linspace(-180, 178.5, 240))
    return ij.SphericalCamera(elevation, azimuth, pose)


def scanned(shape, camera, seed=0):
    maps = ij.render(shape, camera, outputs=("depth", "mask"))
    ranges, mask = np.asarray(maps.depth), np.asarray(maps.mask)
    noise = np.random.default_rng(seed).normal(0, SIGMA, ranges.shape)
    return np.where(mask, ranges + noise, 0).astype(np.float32), mask


def drum(angle):
    """So near that it takes a quarter of the view, or more; at an azimuth."""
    place = (1.1 * np.sin(angle), 0.1, 1.1 * np.cos(angle))
    return ij.Cylinder(place, (0.1, 1, 0.05), 0.6, 1.0)


@pytest.mark.parametrize("angle", [0.3, 3.13], ids=["ahead", "at the seam"])
def test_a_drum_is_fitted_along_its_rays(angle):
    camera = scanner()
    ranges, mask = scanned(drum(angle), camera)
    fit = ij.fit_cylinder(ranges, camera, mask=mask, sigma=SIGMA)
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.6) < 4 * float(fit.std.radius)
    surface = ij.render(fit.shape, camera, outputs=("depth",)).depth
    inliers = np.asarray(fit.inliers) & np.isfinite(surface)
    off = np.where(inliers, ranges - surface, 0)
    # Residuals are ranges, too; but where a ray grazes the wall, continued past it.
    same = np.abs(np.asarray(fit.residual) - off)[inliers] < 2e-5
    assert np.mean(same) > 0.99
    assert float(fit.rms) == pytest.approx(SIGMA, rel=0.1)


@RELEASE
def test_a_scan_that_shows_nothing_says_nothing():
    pose = np.eye(4)
    pose[2, 3] = 0.4
    cameras = [scanner(), scanner(pose)]
    (first, mask), (second, _) = (scanned(drum(0.3), c) for c in cameras)
    masks = [mask, np.zeros_like(mask)]
    both = ij.fit_cylinder([first, second], cameras, mask=masks, sigma=SIGMA)
    alone = ij.fit_cylinder(first, cameras[0], mask=mask, sigma=SIGMA)
    np.testing.assert_allclose(both.std.radius, alone.std.radius, rtol=0.05)


def test_an_orthographic_camera_is_refused():
    camera = ij.OrthographicCamera(50.0, 50.0, 31.5, 31.5, 64, 64)
    with pytest.raises(ValueError, match="PinholeCamera or a SphericalCamera"):
        ij.fit_cylinder(np.ones((64, 64)), camera, mask=np.ones((64, 64), bool))
