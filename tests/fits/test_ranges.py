"""Images of distances along the rays, which were given as depth."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.ranges import refuted_as_ranges, warn_of_ranges
from impostor_jax.fit.regions import DepthUnitsWarning
from impostor_jax.fit.request import Given
from tests.fit.scenes import CAMERA, SIGMA, camera_with
from tests.groups import FULL, SMALL_IMAGES

pytestmark = SMALL_IMAGES

DOWN = np.array([0.0, 0.8, 0.6])
CAN = ij.Cylinder((0.13, 0.05, 0.6), DOWN, 0.04, 0.12)
ROOM = [
    ij.Plane((0.0, 0.1, 0.65), -DOWN),
    ij.Plane((0.0, 0.0, 0.9), (0.0, 0.6, -0.8)),
]


def room(seed=0):
    """Distances along the rays with noise, depths of the same, and the can's mask."""
    maps = [
        ij.render(shape, CAMERA, outputs=("depth", "range")) for shape in (CAN, *ROOM)
    ]
    owner = np.argmin([np.asarray(one.depth) for one in maps], axis=0)
    ranges = np.min([np.asarray(one.range) for one in maps], axis=0)
    ranges = ranges + SIGMA * np.random.default_rng(seed).normal(size=ranges.shape)
    return ranges, ij.depth_of_ranges(ranges, CAMERA), owner == 0


@FULL
@pytest.mark.parametrize("sigma", [SIGMA, pytest.param(None, marks=FULL)])
def test_distances_given_as_depth_contradict_themselves(sigma):
    # The radius was wrong by a tenth and more, and a third of such fits said success.
    ranges, depth, mask = room()
    fit = ij.fit_cylinder(ranges, CAMERA, mask, sigma)
    assert fit.status == "contradicted"
    assert "measured along the rays" in str(fit)
    right = ij.fit_cylinder(depth, CAMERA, mask, sigma)
    assert right.success
    assert abs(float(right.cylinder.radius) - 0.04) < 4 * float(right.std.radius)
    assert refuted_as_ranges(right, [Given(depth, CAMERA, mask, None)]) is right


def test_a_search_warns_of_distances():
    ranges, depth, _ = room()
    with pytest.warns(DepthUnitsWarning, match="measured along the rays"):
        ij.find_cylinders(ranges, CAMERA, SIGMA)
    warn_of_ranges(depth, CAMERA)


def test_what_shows_no_plane_is_not_judged(recwarn):
    ranges, _, mask = room()
    warn_of_ranges(np.where(mask, ranges, 0), CAMERA)
    random = np.random.default_rng(0).uniform(0.5, 1.5, ranges.shape)
    warn_of_ranges(random, CAMERA)
    orthographic = ij.OrthographicCamera(400.0, 400.0, 79.5, 59.5, 160, 120)
    warn_of_ranges(ranges, orthographic)
    assert not recwarn.list


def test_depth_of_ranges_is_what_render_says_with_a_lens_too():
    lens = camera_with(distortion=(-0.2, 0.05, 0.002, -0.001, 0.01))
    for camera in (CAMERA, lens):
        maps = ij.render(ROOM[1], camera, outputs=("depth", "range"))
        depth = ij.depth_of_ranges(np.asarray(maps.range), camera)
        np.testing.assert_allclose(depth, np.asarray(maps.depth), rtol=3e-7)
    blank = np.full((120, 160), np.nan)
    blank[0, 0] = np.inf
    np.testing.assert_array_equal(ij.depth_of_ranges(blank, CAMERA), 0)


@pytest.mark.parametrize(
    ("ranges", "camera", "what"),
    [
        (np.ones((3, 4)), CAMERA, r"ranges must have shape \(120, 160\)"),
        (np.ones((120, 160)), "camera.json", "camera must be a PinholeCamera"),
    ],
)
def test_depth_of_ranges_refuses(ranges, camera, what):
    with pytest.raises(ValueError, match=what):
        ij.depth_of_ranges(ranges, camera)
