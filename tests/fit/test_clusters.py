"""What is on an object and not of its shape: outliers that lie together."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.clusters import FEWEST, clustered_outliers
from impostor_jax.fit.pixelwise import Pixelwise
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.seen import Seen
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of
from tests.groups import FULL, SMALL_IMAGES

pytestmark = SMALL_IMAGES

SEEN = Seen(*image(), CAMERA, ij.ConstantNoise(SIGMA))


def told_of(outliers):
    """What a fit tells of which these readings of the can are no inliers."""
    (place,) = np.nonzero(SEEN.region.ravel())
    marks = np.where(outliers.ravel()[place], 1, 2).astype(np.int8)
    residual = np.zeros(len(place), np.float32)
    return Pixelwise(residual, marks, place.astype(np.int32), SEEN.region.shape)


def block(rows, cols):
    found = np.zeros_like(SEEN.region)
    row, col = (int(np.median(place)) for place in np.nonzero(SEEN.region))
    found[row : row + rows, col : col + cols] = True
    return found


def test_outliers_that_lie_together_are_left_out_with_two_pixels_beside_them():
    clusters = clustered_outliers(SEEN, RoundBody.of(can()), told_of(block(4, 5)))
    assert np.count_nonzero(clusters) == 8 * 9
    assert clusters[block(4, 5)].all()


def test_outliers_that_lie_apart_are_noise():
    some = np.random.default_rng(0).random(SEEN.region.shape) < 0.05
    assert np.count_nonzero(some & SEEN.region) > FEWEST
    for outliers in (some, block(4, 4)):
        told = told_of(outliers & SEEN.region)
        assert not clustered_outliers(SEEN, RoundBody.of(can()), told).any()


def test_of_few_readings_that_were_taken_all_are_asked():
    off = block(6, 6)
    depth = np.where(off, SEEN.image + 10 * SIGMA, SEEN.image)
    told = told_of(np.zeros_like(off))
    few = Pixelwise(told.residual[::9], told.marks[::9], told.place[::9], told.shape)
    seen = SEEN._replace(image=depth)
    clusters = clustered_outliers(seen, RoundBody.of(can()), few)
    assert clusters[off].mean() > 0.9
    assert np.count_nonzero(clusters) < 1.5 * 10 * 10


def with_lid(degrees, radius, height):
    """The can, with a narrower one on the end that is nearer."""
    body = can(degrees)
    end = np.asarray(body.center) - np.asarray(body.axis) * (0.06 + height / 2)
    return body | ij.Cylinder(end, body.axis, radius, height)


@pytest.mark.parametrize(
    ("degrees", "radius", "height"),
    [(60.0, 0.028, 0.02), pytest.param(45.0, 0.03, 0.015, marks=FULL)],
)
def test_a_lid_in_the_mask_does_not_turn_the_axis(degrees, radius, height):
    truth = can(degrees)
    for seed in range(3):
        depth, mask = image_of(with_lid(degrees, radius, height), seed=seed)
        fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
        assert fit.success
        tilt = np.linalg.norm(np.cross(fit.cylinder.axis, truth.axis))
        assert tilt < 4 * np.max(fit.std.axis)
        off = abs(float(fit.cylinder.radius - truth.radius))
        assert off < 4 * float(fit.std.radius)
