"""Whether one wall was fitted to two that meet."""

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.seam import (
    BINS,
    best_split,
    departs_beyond,
    departures,
    solved,
    wall_readings,
)
from impostor_jax.fit.seen import Seen
from tests.fit.scenes import CAMERA, SIGMA
from tests.groups import FULL, SMALL_IMAGES

pytestmark = SMALL_IMAGES

AXIS = np.array([0.6, 0.8, 0.0])
CENTER = np.array([0.0, 0.0, 0.7])
RADIUS, HEIGHT = 0.05, 0.16


def seen(*shapes, sigma=SIGMA, seed=0):
    """Depth with noise, and the mask of all shapes, before a wall."""
    wall = ij.Plane((0.0, 0.0, 0.9), (0.0, 0.0, -1.0))
    maps = [np.asarray(ij.render(shape, CAMERA).depth) for shape in (*shapes, wall)]
    depth = np.min(maps, axis=0)
    mask = np.argmin(maps, axis=0) < len(shapes)
    noise = sigma * np.random.default_rng(seed).normal(size=depth.shape)
    return depth + noise, mask


def stack(part):
    """Two cans in line, the second a part of the radius."""
    return [
        ij.Cylinder(CENTER + side * HEIGHT / 4 * AXIS, AXIS, radius, HEIGHT / 2)
        for side, radius in ((-1, RADIUS), (1, part * RADIUS))
    ]


@pytest.mark.parametrize("sigma", [SIGMA, None])
@pytest.mark.parametrize("part", [0.9, 0.95])
def test_two_cans_in_one_mask_are_no_cylinder(part, sigma):
    # Half of them said success, off by up to 16 deviations.
    depth, mask = seen(*stack(part))
    fit = ij.fit_cylinder(depth, CAMERA, mask, sigma)
    assert not fit.success
    # Of the smaller step some readings are left out first, and are found to go on.
    assert part > 0.9 or "two walls that meet" in fit.reason


@pytest.mark.parametrize(
    "shapes",
    [
        stack(1.0),
        [ij.Frustum(CENTER - 0.08 * AXIS, CENTER + 0.08 * AXIS, 0.051, 0.049)],
        # A barrel of two cones departs smoothly, on the whole.
        [
            ij.Frustum(CENTER - 0.08 * AXIS, CENTER, 0.049, 0.05),
            ij.Frustum(CENTER, CENTER + 0.08 * AXIS, 0.05, 0.049),
        ],
    ],
    ids=["equal", "cone", "barrel"],
)
def test_what_departs_smoothly_is_one(shapes):
    depth, mask = seen(*shapes)
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.05) < 0.0015


@FULL
def test_scans_of_two_walls_are_no_cylinder():
    random = np.random.default_rng(1)
    angle = random.uniform(0, 2 * np.pi, 3000)
    z = random.uniform(-0.5, 0.5, 3000)
    radius = np.where(z < 0.1, 0.2, 0.196) + 0.002 * random.normal(size=3000)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    fit = ij.fit_cylinder_to_points(points, sigma=0.002)
    assert fit.status == "contradicted"
    assert "94 mm from the middle" in fit.reason


def drawn_rows(cut, step, count=4000, seed=3):
    random = np.random.default_rng(seed)
    place = random.uniform(-1, 1, count)
    angle = random.uniform(-1.3, 1.3, count)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    terms = departures(place, out, np.array([0.0, 0.0, 1.0]))
    miss = np.where(place > cut, step * terms[:, 1], 0) + random.normal(size=count)
    return place, np.column_stack([terms, miss])


def test_a_split_is_the_best_of_all_by_least_squares():
    place, rows = drawn_rows(cut=0.25, step=1.0)
    found = best_split(place, rows)
    assert found is not None

    def left(part, terms):
        return np.linalg.lstsq(part[:, :terms], part[:, 11], rcond=None)[1][0]

    cuts = 2 * np.arange(3, BINS - 2) / BINS - 1
    halves = [left(rows[place < cut], 5) + left(rows[place >= cut], 5) for cut in cuts]
    assert found.place == cuts[np.argmin(halves)] == 0.25
    np.testing.assert_allclose(found.halves, np.min(halves), rtol=1e-6)
    np.testing.assert_allclose(found.halves, np.sum(found.rest**2), rtol=1e-6)
    np.testing.assert_allclose(found.alone, left(rows, 5), rtol=1e-6)
    np.testing.assert_allclose(found.smooth, left(rows, 11), rtol=1e-6)


def test_of_readings_at_one_end_nothing_is_split():
    place, rows = drawn_rows(cut=0, step=0)
    at_end = place > 0.95
    assert best_split(place[at_end], rows[at_end]) is None


def test_rows_that_are_far_off_have_little_weight():
    terms = np.column_stack([np.ones(200), np.linspace(-1, 1, 200)])
    random = np.random.default_rng(0)
    miss = terms @ [0.01, 0.02] + 0.001 * random.normal(size=200)
    miss[::10] += 0.1
    found = solved(terms, miss, np.full(200, 0.001))
    assert np.all(np.abs(found.value - [0.01, 0.02]) < 5 * found.deviation)
    assert np.all(found.deviation < 3e-4)


def cup(taper):
    """A wall whose radius changes by a share from its middle to its ends."""
    ends = (1 - taper) * RADIUS, (1 + taper) * RADIUS
    reach = HEIGHT / 2 * AXIS
    return ij.Frustum(CENTER - reach, CENTER + reach, *ends)


def test_what_is_left_out_of_a_cup_is_of_its_wall():
    # Ends of ovals and cones were left out until a cylinder was left, with success: up
    # to 31 deviations off.
    depth, mask = seen(cup(0.1))
    body = ij.Cylinder(CENTER, AXIS, RADIUS, 0.4 * HEIGHT)
    middle = np.asarray(ij.render(body, CAMERA).mask) & mask
    whole = Seen(depth.astype(np.float32), mask, CAMERA, ij.ConstantNoise(SIGMA))
    assert departs_beyond(body, [whole], [middle])
    # Nor does a mask that is too small, or holds much else, make one.
    assert not departs_beyond(body, [whole], [mask])
    depth, mask = seen(ij.Cylinder(CENTER, AXIS, RADIUS, HEIGHT))
    larger = cv2.dilate(mask.astype(np.uint8), np.ones((9, 9))) > 0
    whole = Seen(depth.astype(np.float32), larger, CAMERA, ij.ConstantNoise(SIGMA))
    assert not departs_beyond(body, [whole], [middle & mask])
    body = ij.Cylinder(CENTER, AXIS, RADIUS, HEIGHT)
    assert not departs_beyond(body, [whole], [mask])


def test_nothing_left_out_by_noise_that_grows_with_depth_is_no_departure():
    # Of no readings no least depth is known, from which on the noise is asked.
    depth, mask = seen(ij.Cylinder(CENTER, AXIS, RADIUS, HEIGHT))
    whole = Seen(depth.astype(np.float32), mask, CAMERA, ij.StructuredLight())
    body = ij.Cylinder(CENTER, AXIS, RADIUS, HEIGHT)
    assert not departs_beyond(body, [whole], [mask])


def test_of_a_wall_that_is_looked_along_no_reading_is_the_caps():
    # Errors along the axis put 6 % of what is read of the cap beside the wall.
    body = ij.Cylinder((0.0, 0.0, 0.5), (0.0, 0.3, 0.954), RADIUS, 0.05)
    depth, mask = seen(body, sigma=2 * SIGMA)
    given = Seen(depth, mask, CAMERA, ij.ConstantNoise(2 * SIGMA))
    found = wall_readings(body, given, mask)
    assert len(found.place) > 10
    assert np.all(np.abs(found.miss) < 4 * found.deviation)
