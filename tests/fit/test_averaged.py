"""Images that average over their pixels, as those made smaller do."""

import functools

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.averaged import without_averaged
from impostor_jax.fit.regions import SQUARE
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.seen import Seen
from impostor_jax.sensor.flying_pixels import FlyingPixels
from impostor_jax.sensor.gaussian import ConstantNoise
from tests.fit.scenes import CAMERA, SIGMA
from tests.groups import FULL, SMALL_IMAGES

pytestmark = SMALL_IMAGES

FINE = ij.PinholeCamera(
    2 * CAMERA.fx,
    2 * CAMERA.fy,
    2 * CAMERA.cx + 0.5,
    2 * CAMERA.cy + 0.5,
    2 * CAMERA.width,
    2 * CAMERA.height,
)
CANS = {
    "across": ij.Cylinder((0.01, 0.0, 0.4), (1.0, 0.5, 0.2), radius=0.04, height=0.12),
    "tilted": ij.Cylinder((0.01, 0.0, 0.4), (0.1, 0.8, 0.6), radius=0.03, height=0.1),
}


@functools.cache
def fine(can, wall):
    """Depth of a can before a wall in an image of twice the size, and its mask."""
    scene = ij.Scene([CANS[can], ij.Plane((0.0, 0.0, wall), (0.1, 0.05, -1.0))])
    maps = ij.render(scene, FINE, outputs=("depth", "index"))
    return np.asarray(maps.depth), np.asarray(maps.index) == 0


def halved(can, wall, seed=0):
    """The image that averages over four readings, of which two lie on the can."""
    depth, mask = fine(can, wall)
    noise = np.random.default_rng(seed).normal(0, 2 * SIGMA, depth.shape)
    size = CAMERA.width, CAMERA.height
    small = cv2.resize(depth + noise, size, interpolation=cv2.INTER_AREA)
    share = cv2.resize(mask.astype(float), size, interpolation=cv2.INTER_AREA)
    return small.astype(np.float32), share >= 0.5


def seen(depth, mask, noise=None, camera=CAMERA):
    """The can as a fit is told of it."""
    return Seen(depth, mask, camera, noise or ConstantNoise(SIGMA))


def left_of(seen, can, is_exact=False):
    """What is left of a can."""
    return without_averaged(seen, RoundBody.of(CANS[can]), 1.0, is_exact)


@FULL
@pytest.mark.parametrize("can", CANS)
@pytest.mark.parametrize(("wall", "seed"), [(0.8, 0), pytest.param(1.5, 1, marks=FULL)])
def test_an_image_made_smaller_by_averaging_takes_nothing_off_sizes(can, wall, seed):
    depth, mask = halved(can, wall, seed)
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    assert fit.success, fit.reason
    radius = CANS[can].radius
    assert abs(fit.cylinder.radius - radius) < 3 * fit.std.radius
    if fit.height_observed:
        height = CANS[can].height
        assert abs(fit.cylinder.height - height) < 3 * fit.std.height
    # What is left of it still tells more than a part in a hundred.
    assert fit.std.radius < 0.01 * radius


def test_what_is_left_out_lies_along_edges():
    depth, mask = halved("across", 0.8)
    left = left_of(seen(depth, mask), "across")
    marks = mask.astype(np.uint8)
    inner, core = (cv2.erode(marks, SQUARE, iterations=n) > 0 for n in (2, 3))
    assert left.unsure is not None
    assert not np.any(left.unsure & core)
    assert np.sum(left.unsure & mask) > 0.8 * np.sum(mask & ~inner)


def test_mixed_readings_are_left_out_whatever_the_mask_says():
    depth, mask = fine("across", 0.8)
    # Exact shares of each pixel, and a background that is level.
    clear = np.where(mask, depth, 0.8).astype(np.float32)
    size = CAMERA.width, CAMERA.height
    small = cv2.resize(clear, size, interpolation=cv2.INTER_AREA)
    share = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    is_mixed = (share > 0) & (share < 1)
    for given in (share > 0, share == 1, share >= 0.5):
        left = left_of(seen(small, given), "across")
        assert np.sum(is_mixed & (left.image == 0)) > 0.8 * np.sum(is_mixed)
        assert not np.any(left.region & (left.image == 0))
        assert np.array_equal(left.image[share == 1], small[share == 1])


def test_of_an_outline_that_is_exact_the_mask_stays():
    depth, mask = halved("across", 0.8)
    left = left_of(seen(depth, mask), "across", is_exact=True)
    assert left.region is mask
    assert left.image is depth
    assert np.any(left.unsure)


@pytest.mark.parametrize("wall", [0.5, 0.8, 3.0])
@pytest.mark.parametrize("can", CANS)
def test_of_an_image_whose_rays_are_thin_nothing_is_left_out(can, wall):
    depth, mask = fine(can, wall)
    image = seen(depth, mask, camera=FINE)
    assert left_of(image, can) is image
    # A reading that lacks, or is an outlier, is not mixed.
    rng = np.random.default_rng(0)
    wrong = rng.uniform(size=depth.shape) < 0.1
    spoilt = np.where(wrong, rng.choice([0.0, 1.0], depth.shape) * wall, depth)
    image = seen(spoilt, mask, camera=FINE)
    assert left_of(image, can) is image


def test_the_wider_readings_are_mixed_the_more_are_left_out():
    depth, mask = fine("across", 0.8)
    counts = []
    for width in (1, 2, 3):
        image = seen(cv2.blur(depth, (width, width)), mask, camera=FINE)
        left = left_of(image, "across")
        counts.append(0 if left.unsure is None else np.sum(left.unsure & mask))
    assert counts[0] == 0 < 1.8 * counts[1] < counts[2]


def test_of_a_small_object_enough_is_left():
    depth, mask = halved("across", 0.8)
    inner = cv2.erode(mask.astype(np.uint8), SQUARE)
    rows, cols = np.nonzero(mask & ~(inner > 0))
    rim = np.zeros_like(mask)
    rim[rows[:120], cols[:120]] = True
    left = left_of(seen(depth, rim), "across")
    kept = rim if left.unsure is None else rim & ~left.unsure
    assert np.sum(kept) >= 50


def test_a_sensor_that_tells_of_its_edges_is_believed():
    depth, mask = halved("across", 0.8)
    image = seen(depth, mask, FlyingPixels(ConstantNoise(SIGMA)))
    assert left_of(image, "across") is image
