"""What a search of an image finds, and what it does not take for a cylinder."""

import itertools

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find import fitting, search
from tests.find.scenes import ORTHOGRAPHIC, WALL, image_of
from tests.fit.scenes import CAMERA as SMALL
from tests.fit.scenes import SIGMA, can
from tests.groups import FULL, RELEASE, SMALL_IMAGES

pytestmark = SMALL_IMAGES

# Odd, so that the last row and column stand alone.
CAMERA = ij.PinholeCamera(260.0, 260.0, 160.0, 120.0, 321, 241)


DOWN = np.array([0.0, 0.8, 0.6])
TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]])
TABLE = ij.Plane((0.0, 0.1, 0.7), -DOWN)


def standing(x, y, height):
    """Foot and top of what stands on the table."""
    foot = np.array([x, y, 0.7 - 0.8 / 0.6 * (y - 0.1)])
    return foot, foot - height * DOWN


def can_on_table(x, y, radius, height):
    foot, top = standing(x, y, height)
    return ij.Cylinder((foot + top) / 2, DOWN, radius, height)


@FULL
def test_of_the_things_on_a_table_only_cans_are_found():
    foot, top = standing(0.14, 0.06, 0.09)
    ball, _ = standing(-0.14, 0.02, 0.0)
    box, _ = standing(0.12, -0.1, 0.0)
    cans = [
        can_on_table(-0.02, 0.08, 0.04, 0.12),
        can_on_table(-0.05, -0.08, 0.035, 0.1),
    ]
    others = [
        ij.Frustum(foot, top, 0.032, 0.042),
        ij.Sphere(ball - 0.045 * DOWN, 0.045),
        ij.Box(box - 0.05 * DOWN, TURN, (0.08, 0.1, 0.1)),
    ]
    image = image_of([TABLE, *cans, *others], CAMERA)
    found = ij.find_cylinders(image.depth, CAMERA, SIGMA)
    assert len(found.fits) == 2
    for truth, shown in zip(cans, (1, 2), strict=True):
        own = image.owner == shown
        number = int(np.argmax([(mask & own).sum() for mask in found.masks]))
        fit = found.fits[number]
        off = float(fit.cylinder.radius - truth.radius)
        assert abs(off) < 4 * float(fit.std.radius)
        assert abs(float(np.dot(fit.cylinder.axis, DOWN))) > np.cos(np.radians(2))
        assert not (found.masks[number] & (image.owner > 2)).any()
    again = ij.find_cylinders(image.depth, CAMERA, SIGMA)
    np.testing.assert_array_equal(again.masks, found.masks)
    np.testing.assert_array_equal(again.confidence, found.confidence)


def test_a_candidate_that_runs_out_of_steps_takes_more(monkeypatch):
    # Two of twelve cans in depth that is rounded were lost.
    fit_shape, few = fitting.fit_shape, fitting.QUICK["max_steps"]

    def ended_early(request, **more):
        fit = fit_shape(request, **more)
        is_quick = request.options.effort.max_steps == few
        return fit.failed(ij.FitStatus.STEP_LIMIT) if is_quick else fit

    monkeypatch.setattr(fitting, "fit_shape", ended_early)
    monkeypatch.setattr(search, "FEW", 1000)
    image = image_of([TABLE, can_on_table(-0.02, 0.08, 0.04, 0.12)], CAMERA)
    assert len(ij.find_cylinders(image.depth, CAMERA, SIGMA).fits) == 1


@pytest.mark.parametrize("sigma", [0.0002, 0.002])
def test_cans_that_stand_below_the_camera_are_found(sigma):
    # Of 24 below a camera with little noise 12 were.
    floor = ij.Plane((0.0, 0.0, 0.5), (0.0, 0.0, -1.0))
    cans = [
        ij.Cylinder((x, y, 0.5 - height / 2), (0.0, 0.0, 1.0), radius, height)
        for x, y, radius, height in (
            (-0.1, 0.03, 0.04, 0.12),
            (0.11, -0.05, 0.03, 0.15),
        )
    ]
    image = image_of([*cans, floor], CAMERA, sigma)
    found = ij.find_cylinders(image.depth, CAMERA, sigma=sigma)
    radii = sorted(float(fit.cylinder.radius) for fit in found.fits)
    np.testing.assert_allclose(radii, [0.03, 0.04], rtol=0.03)


def test_a_cup_below_the_camera_shows_no_wall():
    # Of its rim and what it stands on a can of .93 was made.
    floor = ij.Plane((0.0, 0.0, 0.5), (0.0, 0.0, -1.0))
    cups = [
        ij.Frustum((x, y, 0.5), (x, y, 0.4), 0.02, 0.035)
        for x, y in ((-0.08, 0.03), (0.09, -0.04))
    ]
    image = image_of([*cups, floor], CAMERA, 0.0005)
    assert not len(ij.find_cylinders(image.depth, CAMERA, sigma=0.0005).fits)


def test_a_can_with_a_neck_is_found_by_its_wall():
    # Beside the neck and the foot's slope the mask's border disagreed with the wall,
    # and a quick fit, which has no doubts, was refused: a third of such cans.
    steps = [(0.0, 0.055), (0.014, 0.07), (0.21, 0.07), (0.232, 0.056)]
    places = [(standing(0.0, 0.1, height)[1], radius) for height, radius in steps]
    parts = [
        ij.Frustum(low, high, narrow, wide)
        for (low, narrow), (high, wide) in itertools.pairwise(places)
    ]
    for seed in range(3):
        image = image_of([TABLE, *parts], CAMERA, seed=seed)
        assert (image.owner == 2).sum() > 2500
        found = ij.find_cylinders(image.depth, CAMERA, SIGMA)
        assert len(found.fits) == 1
        fit = found.fits[0]
        assert abs(float(fit.cylinder.radius) - 0.07) < 4 * float(fit.std.radius)
        assert abs(float(np.dot(fit.cylinder.axis, DOWN))) > np.cos(np.radians(1))


@FULL
@pytest.mark.parametrize("seed", [1, 6, 7])
def test_ends_that_stand_out_are_seen_without_a_mask(seed):
    # What was found lacked the last row of pixels of the wall, whose normals are of the
    # background, too: then nothing tells that the wall does not go on.
    random = np.random.default_rng(seed)
    place, tilt = random.normal(0, 0.03, 2), random.normal(0, 0.4)
    axis = (tilt, 1, random.normal(0.3, 0.4))
    radius, height = random.uniform(0.025, 0.045), random.uniform(0.08, 0.16)
    truth = ij.Cylinder((*place, 0.5), axis, radius, height)
    wall = ij.Plane((0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
    image = image_of([truth, wall], CAMERA)
    found = ij.find_cylinders(image.depth, CAMERA, SIGMA)
    assert len(found.fits) == 1
    fit = found.fits[0]
    assert fit.height_observed
    assert abs(float(fit.cylinder.height) - height) < 4 * float(fit.std.height)


@FULL
@pytest.mark.parametrize("seed", [9, 14])
def test_a_bottle_shows_no_end_of_its_body(seed):
    # Its shoulder went for a cap, or for an end before what lies far behind: of 48
    # bodies 7 had a height, which was 13 to 24 deviations too large.
    rng = np.random.default_rng(seed)
    up = np.array([0.1 * rng.normal(), -1, -0.5 + 0.2 * rng.normal()])
    up /= np.linalg.norm(up)
    center = np.array([rng.uniform(-0.02, 0.02), 0.03, 0.42])
    bottle = [
        ij.Cylinder(center, up, 0.035, 0.12),
        ij.Frustum(center + 0.06 * up, center + 0.12 * up, 0.035, 0.012),
        ij.Cylinder(center + 0.145 * up, up, 0.012, 0.05),
    ]
    image = image_of([*bottle, ij.Plane(center - 0.06 * up, up)], seed=seed)
    found = ij.find_cylinders(image.depth, SMALL, SIGMA)
    (body,) = (fit for fit in found.fits if float(fit.cylinder.radius) > 0.03)
    assert float(body.cylinder.radius) == pytest.approx(0.035, abs=5e-4)
    assert not np.isfinite(body.std.height)


@FULL
def test_a_can_is_found_in_depth_that_was_filtered():
    # What a median leaves of the noise of a wall is a quarter of what it leaves of a
    # can's, which was refused for it.
    can = ij.Cylinder((0.02, 0.01, 0.8), (0.5, 0.8, 0.3), 0.04, 0.12)
    camera = ij.PinholeCamera(525.0, 525.0, 319.5, 239.5, 640, 480)
    wall = ij.Plane((0.0, 0.0, 1.35), (0.0, 0.075, -1.0))
    depth = cv2.medianBlur(image_of([can, wall], camera).depth, 3)
    (fit,) = ij.find_cylinders(depth, camera).fits
    assert "neighbors share" in fit.asked.measured
    assert abs(float(fit.cylinder.radius) - 0.04) < 2 * float(fit.std.radius) < 0.006


def test_with_nothing_told_noise_is_that_of_the_depth():
    # The wall's 9 mm were taken for the can's, too, which then showed nothing.
    truth = ij.Cylinder((0.02, 0.0, 0.8), (0.2, 0.9, 0.1), 0.03, 0.15)
    wall = ij.Plane((0.0, 0.0, 2.4), (0.0, 0.0, -1.0))
    image = image_of([truth, wall], CAMERA, sigma=0.0)
    deviation = 0.0005 + 0.0015 * image.depth**2
    noise = deviation * np.random.default_rng(2).normal(size=deviation.shape)
    found = ij.find_cylinders((image.depth + noise).astype(np.float32), CAMERA)
    assert len(found.fits) == 1
    fit = found.fits[0]
    assert abs(float(fit.cylinder.radius) - 0.03) < 4 * float(fit.std.radius)
    assert "Measured in the image" in str(fit)


def test_of_what_is_refused_there_is_no_warning(recwarn):
    ball = ij.Sphere((0.0, 0.0, 0.6), 0.05)
    wall = ij.Plane((0.0, 0.0, 0.9), (0.0, 0.0, -1.0))
    ij.find_cylinders(image_of([ball, wall], CAMERA).depth, CAMERA, SIGMA)
    assert not recwarn.list


@pytest.mark.parametrize("value", [0.0, np.nan, 0.8])
def test_in_an_empty_image_nothing_is_found(value):
    depth = np.full((CAMERA.height, CAMERA.width), value, np.float32)
    found = ij.find_cylinders(depth, CAMERA, SIGMA)
    assert found.fits == ()
    assert found.masks.shape == (0, *depth.shape)


@pytest.mark.parametrize("stride", [1, 2])
@RELEASE
def test_masks_are_of_the_image(stride):
    # With a stride of 2 they had the view's shape, and the search raised.
    truth = can(90.0)
    maps = ij.render(truth, CAMERA, outputs=("depth", "mask"))
    mask = np.asarray(maps.mask)
    wall = float(truth.center[2]) + 0.4
    noise = SIGMA * np.random.default_rng(0).normal(size=mask.shape)
    depth = np.where(mask, np.asarray(maps.depth), wall) + noise
    found = ij.find_cylinders(depth, CAMERA, SIGMA, effort=ij.Effort(stride=stride))
    assert found.masks.shape == (1, *mask.shape)
    union = found.masks[0] | mask
    # Of half of the rows and columns an outline is known to a pixel and a half.
    assert (found.masks[0] & mask).sum() > (0.97 if stride == 1 else 0.85) * union.sum()
    fit = found.fits[0]
    assert fit.cylinder.radius == pytest.approx(0.04, abs=4 * float(fit.std.radius))


def warped(depth, camera, longer, aside):
    """Readings as a camera of a longer focal length beside the other sees them.

    Each is rounded to a pixel, as programs that register depth to color do it: around
    most of them are pixels without a reading.
    """
    row, col = np.indices(depth.shape)
    x = (col - camera.cx) / camera.fx * depth + aside
    y = (row - camera.cy) / camera.fy * depth
    col = np.rint(longer.fx * x / depth + longer.cx).astype(int)
    row = np.rint(longer.fy * y / depth + longer.cy).astype(int)
    seen = (col >= 0) & (col < longer.width) & (row >= 0) & (row < longer.height)
    image = np.full((longer.height, longer.width), np.inf, np.float32)
    np.minimum.at(image, (row[seen], col[seen]), depth[seen])
    return np.where(np.isfinite(image), image, 0)


@FULL
def test_a_can_is_found_in_depth_that_was_warped_to_a_color_camera():
    # Two thirds of the pixels have no reading, so that no reading had a neighbor, and
    # nothing was found.
    longer = ij.PinholeCamera(442.0, 442.0, 160.0, 120.0, 321, 241)
    truth = can_on_table(0.0, 0.1, 0.04, 0.12)
    image = image_of([TABLE, truth], CAMERA)
    depth = warped(image.depth, CAMERA, longer, aside=0.025)
    assert 0.3 < np.mean(depth > 0) < 0.5
    found = ij.find_cylinders(depth, longer, SIGMA)
    assert len(found.fits) == 1
    fit = found.fits[0]
    assert abs(float(fit.cylinder.radius) - 0.04) < 4 * float(fit.std.radius)
    assert abs(float(np.dot(fit.cylinder.axis, DOWN))) > np.cos(np.radians(1))


@RELEASE
def test_a_can_is_found_by_parallel_rays_without_a_warning():
    # Its fit stands 1e5 m away, in double precision: depth looked like millimeters.
    standing_can = ij.Cylinder((0.0, 0.0, 0.5), (0.3, 0.9, 0.1), 0.04, 0.12)
    image = image_of([standing_can, WALL], ORTHOGRAPHIC, 0.0005)
    found = ij.find_cylinders(image.depth, ORTHOGRAPHIC, 0.0005)
    (fit,) = found.fits
    assert abs(float(fit.cylinder.radius) - 0.04) < 4 * float(fit.std.radius)
    away = np.abs(np.asarray(fit.cylinder.center) - (0.0, 0.0, 0.5))
    assert np.all(away < 5 * np.asarray(fit.std.center))
