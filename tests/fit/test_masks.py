"""Masks that are not the object's pixels, and shapes that are not the readings'."""

import functools

import cv2
import jax
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit import border
from impostor_jax.fit.edges import without_edges
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.touching import with_unsure
from tests.checks import angle_between
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of, with_outliers
from tests.groups import FULL, RELEASE, SMALL_IMAGES

pytestmark = SMALL_IMAGES

# Of a camera that looks down on a table.
UP = np.array([0.0, -np.cos(0.6), -np.sin(0.6)])
STANDING = ij.Cylinder((0.01, 0.005, 0.35), UP, radius=0.04, height=0.12)


@functools.cache
def on_table(seed=0):
    """Depth image of a can that stands on a table, and its mask."""
    table = ij.Plane(np.asarray(STANDING.center) - 0.06 * UP, UP)
    maps = ij.render(ij.Scene([STANDING, table]), CAMERA, outputs=("depth", "index"))
    depth, mask = np.asarray(maps.depth), np.asarray(maps.index) == 0
    noise = np.random.default_rng(seed).normal(0, SIGMA, depth.shape)
    return np.where(np.isfinite(depth), depth + noise, 0).astype(np.float32), mask


def read_by(sensor, shape, camera, wall, seed):
    """Depth image of a shape before a wall as a sensor reads it, and its mask."""
    maps = ij.render(shape, camera, outputs=("depth", "normal", "mask"))
    mask = np.asarray(maps.mask)
    scene = np.minimum(maps.depth, wall)
    normal = np.where(mask[..., None], maps.normal, np.float32((0, 0, -1)))
    return np.asarray(sensor.sample(jax.random.key(seed), scene, normal, camera)), mask


def grown(mask, pixels):
    """A mask made larger, or smaller, by some pixels on each side."""
    change = cv2.dilate if pixels > 0 else cv2.erode
    kernel = np.ones((3, 3), np.uint8)
    return change(mask.astype(np.uint8), kernel, iterations=abs(pixels)) > 0


def errors(fit, truth):
    """Errors of radius and height, where that is seen, in deviations."""
    found = [(fit.cylinder.radius - truth.radius) / fit.std.radius]
    if fit.height_observed:
        found.append((fit.cylinder.height - truth.height) / fit.std.height)
    return np.abs(np.asarray(found))


def test_pixels_beside_the_outline_are_no_reason_for_another_start():
    # What a small mask leaves out is the object, and was taken for hidden background.
    truth, sigma = can(), 0.003
    maps = ij.render(truth, CAMERA, outputs=("depth", "mask"))
    noise = np.random.default_rng(5).normal(0, sigma, maps.depth.shape)
    depth = np.minimum(np.asarray(maps.depth), 0.65) + noise
    mask = grown(np.asarray(maps.mask), -3)
    fit = ij.fit_cylinder(depth.astype(np.float32), CAMERA, mask, sigma)
    assert fit.success
    assert fit.num_starts == 1


def test_a_grazing_reading_at_a_rim_does_not_decide():
    # Guess and truth lead to estimates that take one reading for the wall's or the
    # cap's; taken for the wall's it told five times more than all others.
    up = np.array([0.0, -np.cos(np.radians(70)), -np.sin(np.radians(70))])
    truth = ij.Cylinder((0.02, 0.01, 0.8), up, 0.04, 0.12)
    table = ij.Plane(np.asarray(truth.center) - 0.06 * up, up)
    row, col = 180, 252
    camera = ij.PinholeCamera(525.0, 525.0, 319.5 - col, 239.5 - row, 160, 120)
    maps = ij.render(ij.Scene([truth, table]), camera, outputs=("depth", "index"))
    noise = np.random.default_rng(2).normal(0, SIGMA, (480, 640))
    depth = np.asarray(maps.depth) + noise[row : row + 120, col : col + 160]
    mask = np.asarray(maps.index) == 0
    mask &= np.indices(mask.shape)[0] < np.median(np.nonzero(mask)[0])
    guessed, told = (
        ij.fit_cylinder(depth.astype(np.float32), camera, mask, SIGMA, initial=start)
        for start in (None, truth)
    )
    assert guessed.success
    assert told.success
    np.testing.assert_allclose(guessed.std.across_axis, told.std.across_axis, rtol=0.02)


@pytest.mark.parametrize("pixels", [1, 2, 4])
@pytest.mark.parametrize("scene", ["table", "wall"])
def test_an_eroded_mask_is_a_part_of_the_object(scene, pixels):
    # Its own far half, beyond its edge, was taken for background: up to 20 deviations.
    depth, mask = on_table() if scene == "table" else image()
    truth = STANDING if scene == "table" else can()
    fit = ij.fit_cylinder(depth, CAMERA, mask=grown(mask, -pixels), sigma=SIGMA)
    assert fit.success
    assert errors(fit, truth).max() < 3.5


@FULL
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("pixels", [1, 2, 3, 4])
def test_a_mask_that_is_too_large_shows_its_surroundings(pixels, seed):
    # On a table they pulled the radius off by a hundred deviations.
    depth, mask = on_table(seed)
    fit = ij.fit_cylinder(depth, CAMERA, mask=grown(mask, pixels), sigma=SIGMA)
    assert not fit.success or errors(fit, STANDING).max() < 3.5


def test_a_narrower_region_begins_from_what_the_wider_one_told():
    depth, mask = image(wall=0.45)
    fit = ij.fit_cylinder(depth, CAMERA, grown(mask, 2), SIGMA)
    assert fit.success
    # That, and the best guess of its own.
    assert int(fit.num_starts) == 2
    assert abs(fit.cylinder.radius - can().radius) < 4 * fit.std.radius


def test_where_no_pixel_is_beyond_doubt_the_inner_ones_are_fitted(monkeypatch):
    # Of a slight thing beside others none may be, and the fit raised an IndexError.
    asked = []

    def none_is(away, region):
        asked.append(region)
        return np.zeros_like(region)

    monkeypatch.setattr(border, "_own_pixels", none_is)
    monkeypatch.setattr(border, "with_unsure", lambda seen, *_: seen)
    depth, mask = on_table()
    fit = ij.fit_cylinder(depth, CAMERA, mask=grown(mask, 2), sigma=SIGMA)
    assert asked
    assert fit.success
    assert errors(fit, STANDING).max() < 3.5


@pytest.mark.parametrize("pixels", [1, 2, 4])
def test_a_mask_that_is_too_large_on_a_table_costs_nothing(pixels):
    # Half of those of 2 pixels were refused, and of others a radius was known four
    # times worse.
    depth, mask = on_table()
    exact = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    fit = ij.fit_cylinder(depth, CAMERA, mask=grown(mask, pixels), sigma=SIGMA)
    assert fit.success
    assert errors(fit, STANDING).max() < 3.5
    assert float(fit.std.radius) < 1.5 * float(exact.std.radius)


@pytest.mark.parametrize("seed", range(3))
def test_a_floor_that_a_mask_takes_with_it_turns_no_wall(seed):
    # Seen from above the wall grazes all rays: a row of pixels along its foot turned it
    # by up to 8 deviations, and none of them was an outlier.
    up = np.array([0.0, -np.cos(1.3), -np.sin(1.3)])
    can = ij.Cylinder((0.05, 0.06, 0.4), up, radius=0.04, height=0.12)
    floor = ij.Plane(np.asarray(can.center) - 0.06 * up, up)
    maps = ij.render(ij.Scene([can, floor]), CAMERA, outputs=("depth", "index"))
    mask = np.asarray(maps.index) == 0
    noise = np.random.default_rng(seed).normal(0, SIGMA, mask.shape)
    depth = (maps.depth + noise).astype(np.float32)
    jump = cv2.morphologyEx(np.asarray(maps.depth), cv2.MORPH_GRADIENT, np.ones((3, 3)))
    fit = ij.fit_cylinder(
        depth, CAMERA, mask=mask | grown(mask, 1) & (jump < 0.01), sigma=SIGMA
    )
    assert fit.success
    off = np.radians(angle_between(fit.cylinder.axis, up))
    assert off < 3.5 * fit.std.axis.max()


def test_a_mask_that_ends_on_the_object_leaves_out_nothing():
    depth, mask = on_table()
    seen = Seen(depth, mask, CAMERA, ij.ConstantNoise(SIGMA))
    body = RoundBody.of(STANDING)
    part = seen._replace(region=grown(mask, -3))
    assert with_unsure(part, body, 1.0) is part
    found = with_unsure(seen, body, 1.0)
    # Of the can its foot touches the table, and what is seen of its sides beside that.
    rows, cols = np.nonzero(found.unsure)
    foot = np.asarray(STANDING.center) - 0.06 * UP
    assert len(rows) > 20
    x, y = (cols - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy
    points = np.stack([x, y, np.ones_like(x)], axis=-1) * depth[rows, cols][:, None]
    assert ((points - foot) @ UP).max() < 0.04


def test_a_mask_that_is_too_large_before_a_wall_costs_nothing():
    depth, mask = image()
    exact = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    fit = ij.fit_cylinder(depth, CAMERA, mask=grown(mask, 3), sigma=SIGMA)
    assert fit.success
    assert fit.height_observed
    assert errors(fit, can()).max() < 3.5
    assert float(fit.std.radius) < 1.5 * float(exact.std.radius)


@pytest.mark.parametrize("degrees", [45, 60, 75])
@RELEASE
def test_a_mask_made_from_readings_leaves_out_mixed_ones(degrees):
    # It ends short of the can, whose height was 6 to 13 deviations too small.
    sensor, truth = ij.FlyingPixels(ij.ConstantNoise(SIGMA)), can(degrees)
    depth, mask = read_by(sensor, truth, CAMERA, 0.6, seed=0)
    rendered = np.asarray(ij.render(truth, CAMERA).depth)
    own = mask & (np.abs(depth - rendered) < 5 * SIGMA)
    fit = ij.fit_cylinder(depth, CAMERA, own, sensor)
    assert fit.success
    assert fit.height_observed
    assert errors(fit, truth).max() < 3.5


def test_a_mug_hides_nothing_with_the_cap_that_it_lacks():
    # What is seen inside of it was taken for hidden background; a disc won.
    up = np.array([0.0, -np.sin(np.pi / 4), -np.cos(np.pi / 4)])
    mug = ij.Cylinder((0.01, 0.0, 0.3), up, 0.04, 0.09, caps=False)
    closed = ij.Cylinder(mug.center, up, mug.radius, mug.height)
    maps = ij.render(closed, CAMERA, outputs=("normal", "mask"))
    wall = np.asarray(maps.mask) & (np.abs(np.asarray(maps.normal) @ up) < 0.1)
    depth, _ = image_of(mug)
    fit = ij.fit_cylinder(depth, CAMERA, mask=grown(wall, -2), sigma=SIGMA)
    assert fit.success
    assert fit.num_starts == 1
    assert errors(fit, mug).max() < 3.5


@pytest.mark.parametrize("part", ["holes", "left half", "upper half"])
def test_any_part_of_the_object_will_do(part):
    depth, mask = on_table()
    rows, cols = np.nonzero(mask)
    kept = np.zeros_like(mask)
    if part == "holes":
        kept = np.random.default_rng(0).random(mask.shape) < 0.7
    elif part == "left half":
        kept[:, : int(cols.mean())] = True
    else:
        kept[: int(rows.mean())] = True
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask & kept, sigma=SIGMA)
    assert fit.success
    assert errors(fit, STANDING).max() < 3.5


@FULL
def test_a_held_radius_that_is_wrong_is_no_success():
    depth, mask = image()
    truth = can()
    start = ij.Cylinder(truth.center, truth.axis, radius=0.08, height=0.12)
    fit = ij.fit_cylinder(
        depth, CAMERA, mask=mask, sigma=SIGMA, initial=start, fixed=("radius",)
    )
    assert fit.status is ij.FitStatus.CONTRADICTED
    assert np.isposinf(np.asarray(fit.std.center)).all()


def test_noise_that_is_larger_than_given_says_so():
    depth, mask = image()
    right = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    assert float(right.chi2) == pytest.approx(1, abs=0.1)
    assert 1e-3 < float(right.p_value) < 1 - 1e-3
    wrong = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA / 4)
    assert wrong.status is ij.FitStatus.POOR_FIT
    assert wrong.reason == (
        "The residuals are 3.9 times the noise given: the shape or sigma is wrong."
    )
    # Twice the noise, as of the bands of a real sensor, widens the deviations.
    doubled = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA / 2)
    assert doubled.success
    assert float(doubled.chi2) == pytest.approx(4, rel=0.1)
    assert float(doubled.p_value) < 1e-6
    assert float(doubled.std.radius) == pytest.approx(float(right.std.radius), rel=0.2)


def test_noise_that_is_not_given_is_measured():
    depth, mask = image()
    noise = np.random.default_rng(1).normal(0, 4 * SIGMA, depth.shape)
    loud = (depth + noise).astype(np.float32)
    assert not ij.fit_cylinder(loud, CAMERA, mask=mask, sigma=SIGMA).success
    fit = ij.fit_cylinder(loud, CAMERA, mask=mask)
    assert fit.success
    assert float(fit.chi2) == pytest.approx(1, abs=0.1)


def test_a_cone_is_no_can():
    truth = can()
    half = np.asarray(truth.axis) * 0.06
    cone = ij.Frustum(truth.center - half, truth.center + half, 0.05, 0.02)
    depth, mask = image_of(cone)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    assert not fit.success
    assert fit.status.meaning
    assert fit.reason


def test_a_guess_and_the_truth_lead_to_one_place():
    # The stages ended before they had settled: here 60 deviations apart.
    depth, mask = image(10.0, seed=5)
    rng = np.random.default_rng(105)
    wrong = rng.random(depth.shape) < 0.1
    depth = np.where(wrong, rng.uniform(0.2, 1.0, depth.shape), depth)
    asked = {"mask": mask, "sigma": SIGMA}
    guess = ij.fit_cylinder(depth.astype(np.float32), CAMERA, **asked)
    true = ij.fit_cylinder(depth.astype(np.float32), CAMERA, initial=can(10.0), **asked)
    assert guess.success
    assert true.success
    apart = angle_between(guess.cylinder.axis, true.cylinder.axis)
    assert apart < np.degrees(float(true.std.axis.max()))
    assert abs(guess.cylinder.radius - true.cylinder.radius) < true.std.radius


def test_a_sensor_that_mixes_readings_at_edges_is_not_believed_there():
    depth, mask = image()
    plain, mixing = ij.ConstantNoise(SIGMA), ij.FlyingPixels(SIGMA_NOISE)
    assert without_edges(depth, mask, CAMERA, plain) is depth
    left = np.asarray(without_edges(depth, mask, CAMERA, mixing))
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    inner = cv2.erode(mask.astype(np.uint8), cross) > 0
    np.testing.assert_array_equal(left[mask] > 0, inner[mask])
    np.testing.assert_array_equal(left[~mask], depth[~mask])


@pytest.mark.parametrize(
    "noise", [ij.StructuredLight.sensor(), ij.FlyingPixels(ij.StructuredLight())]
)
def test_edges_are_the_same_in_a_trace_as_on_the_host(noise):
    depth, mask = image()
    depth = np.where(np.random.default_rng(0).random(depth.shape) < 0.02, 0, depth)
    host = without_edges(depth, mask, CAMERA, noise)
    assert 0 < np.count_nonzero(host != depth)
    traced = jax.jit(lambda depth: without_edges(depth, mask, CAMERA, noise))(depth)
    np.testing.assert_array_equal(host, traced)


SIGMA_NOISE = ij.ConstantNoise(SIGMA)


@pytest.mark.parametrize(
    ("sensor", "reach"),
    [
        (SIGMA_NOISE, 0),
        (ij.StructuredLight(), 0),
        (ij.StereoDisparity(500.0), 0),
        (ij.Dropout(ij.FlyingPixels(SIGMA_NOISE)), 1),
        # Of shifts of 0.8 pixels one in a hundred is larger than 2, of 0.5 than 1.
        (ij.LateralNoise(SIGMA_NOISE), 2),
        (ij.FlyingPixels(ij.LateralNoise(SIGMA_NOISE, floor=0.5)), 2),
    ],
)
def test_a_sensor_says_how_far_from_a_jump_it_errs(sensor, reach):
    assert int(sensor.bias.edge_reach) == reach


def test_holes_of_a_mask_are_no_edges():
    depth, mask = image()
    kept = mask & (np.random.default_rng(0).random(mask.shape) < 0.7)
    left = np.asarray(without_edges(depth, kept, CAMERA, ij.FlyingPixels(SIGMA_NOISE)))
    # The outline's pixels go, and what is at a larger hole.
    assert np.count_nonzero(left[kept]) > 0.7 * np.count_nonzero(kept)


def test_a_quick_fit_says_of_the_same_mask_that_it_is_too_large():
    # It does not look for what is the object's own.
    depth, mask = image()
    asked = {"sigma": SIGMA, "effort": "fast"}
    fit = ij.fit_cylinder(depth, CAMERA, mask=grown(mask, 3), **asked)
    assert fit.status in (ij.FitStatus.POOR_FIT, ij.FitStatus.STEP_LIMIT)
    good = ij.fit_cylinder(depth, CAMERA, mask=mask, **asked)
    assert good.success
    assert "Nothing was doubted" in str(good)


@RELEASE
def test_a_sensor_is_not_blamed_for_what_its_sigma_leaves_out():
    maps = ij.render(can(), CAMERA, outputs=("depth", "normal", "mask"))
    sensor = ij.LateralNoise(SIGMA_NOISE, floor=0.5)
    depth = sensor.sample(jax.random.key(0), maps.depth, maps.normal, CAMERA)
    fit = ij.fit_cylinder(depth, CAMERA, mask=maps.mask, sigma=sensor)
    assert fit.status is not ij.FitStatus.POOR_FIT
    assert np.isnan(float(fit.p_value))


def test_enough_readings_of_a_thin_object_are_left():
    mask = np.zeros((20, 60), bool)
    mask[10:12, 2:58] = True
    sensor = ij.FlyingPixels(SIGMA_NOISE)
    left = without_edges(np.where(mask, 0.5, 0.6), mask, CAMERA, sensor)
    assert np.asarray(left).all()


@FULL
@pytest.mark.parametrize("pixels", [0, 1])
def test_mixed_readings_beside_the_outline_do_not_decide(pixels):
    # A mask that is a pixel larger here and there kept some from being at its edge: 50
    # of 4000 took up to 4.6 deviations off the radius of a trunk, and 11 in a dataset.
    camera = ij.PinholeCamera(525.0, 525.0, 79.5, 59.5, 160, 120)
    trunk = ij.Cylinder((0.02, 0.1, 3.9), (0.1, 0.96, 0.26), 0.13, 4.0)
    sensor = ij.FlyingPixels(ij.ConstantNoise(0.02))
    depth, mask = read_by(sensor, trunk, camera, 4.4, seed=2)
    larger = grown(mask, 1)
    if not pixels:
        larger &= mask | (np.abs(depth - 4) < 0.15)
    fit = ij.fit_cylinder(depth, camera, larger, sensor)
    assert fit.success
    assert errors(fit, trunk).max() < 3
    # Errors that neighbors share are not to blame.
    assert float(fit.std.radius) < 0.0015


def test_mixed_readings_beyond_the_outline_do_not_move_it():
    # A few of a mask that is a pixel too large, which read about as far as the limb,
    # moved the outline to their pixels: by up to twelve deviations of a radius.
    (depth, mask), truth = image(), can()
    row, col = np.nonzero(grown(mask, 1) & ~mask)
    ray = np.stack([(col - 79.5) / 150, (row - 59.5) / 150, np.ones(len(row))], axis=1)
    center, axis = np.asarray(truth.center), np.asarray(truth.axis)
    across = ray - (ray @ axis)[:, None] * axis
    limb = across @ center / np.sum(across**2, axis=1)
    off = limb[:, None] * ray - center
    along = off @ axis
    passes = np.linalg.norm(off - along[:, None] * axis, axis=1)
    beside = np.flatnonzero((np.abs(along) < 0.05) & (passes < 0.0415))
    rng = np.random.default_rng(0)
    some = rng.choice(beside, 8, replace=False)
    depth = np.array(depth)
    depth[row[some], col[some]] = limb[some] + rng.normal(0, 2 * SIGMA, 8)
    fit = ij.fit_cylinder(depth, CAMERA, grown(mask, 1), SIGMA)
    assert fit.success
    assert errors(fit, truth).max() < 3


@FULL
@pytest.mark.parametrize("share", [0.3, pytest.param(1, marks=FULL)])
def test_mixed_readings_are_not_where_the_background_begins(share):
    # They were taken for it: heights came out up to 3 mm too short, 5 to 41 deviations.
    truth = can(80)
    clean, _ = image_of(truth)
    low, high = (f(clean, np.ones((3, 3), np.uint8)) for f in (cv2.erode, cv2.dilate))
    errors_of_height = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        is_mixed = (high - low > 0.02) & (rng.random(clean.shape) < share)
        mixed = low + rng.random(clean.shape) * (high - low)
        depth = np.where(is_mixed, mixed, clean).astype(np.float32)
        fit = ij.fit_cylinder(depth, CAMERA, sigma=SIGMA)
        assert fit.success
        if fit.height_observed:
            errors_of_height.append(errors(fit, truth)[1])
    assert all(error < 4 for error in errors_of_height)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=FULL)])
@pytest.mark.parametrize("pixels", [0, 2])
def test_pixels_without_a_reading_do_not_say_where_a_can_ends(pixels, seed):
    # As if all of a mask were of the object it was 27 deviations too high.
    depth, mask = image(90.0, seed=seed)
    beside = grown(mask, 1) & ~grown(mask, -1)
    missing = beside & (np.random.default_rng(seed).random(mask.shape) < 0.6)
    region = grown(mask, pixels) if pixels else mask
    fit = ij.fit_cylinder(np.where(missing, 0, depth), CAMERA, region, SIGMA)
    assert fit.success
    assert fit.height_observed
    assert (errors(fit, can(90.0)) < 3).all()
    # With all readings a quarter of a millimeter.
    assert fit.std.height < 0.001


@FULL
def test_nor_do_those_in_a_shadow_of_a_sensor_that_mixes_readings_at_edges():
    # A search takes what is not read beside a can for its own: 80.7 mm were 87 +- 1.
    depth, mask = image(90.0)
    row, col = np.indices(mask.shape)
    place = 0.6 * (col - 83.8) + 0.8 * (row - 61.6)
    shadow = grown(mask, 6) & ~mask & (place > 24)
    sensor = ij.FlyingPixels(ij.ConstantNoise(SIGMA))
    image_of_it = np.where(shadow, 0, depth)
    fit = ij.fit_cylinder(image_of_it, CAMERA, mask | shadow, sensor)
    assert fit.success
    assert not fit.height_observed or errors(fit, can(90.0))[1] < 4


def test_an_outlier_before_an_end_is_not_where_the_object_stops():
    truth = can(80)
    depth, _ = image_of(truth)
    fit = ij.fit_cylinder(with_outliers(depth, 0.05, seed=1), CAMERA, sigma=SIGMA)
    assert fit.success
    assert bool(fit.height_observed)
    assert errors(fit, truth).max() < 4


@pytest.mark.parametrize("degrees", [35, 60])
@RELEASE
def test_a_window_leans_where_noise_hides_a_jump(degrees):
    # Beside a table: up to 8 deviations, and more where the can is seen from above, of
    # whose outline the distance was taken along the ray.
    up = np.array([0, -np.cos(np.radians(degrees)), -np.sin(np.radians(degrees))])
    truth = ij.Cylinder((0.01, 0.005, 0.35), up, radius=0.04, height=0.12)
    table = ij.Plane(np.asarray(truth.center) - 0.06 * up, up)
    outputs = ("depth", "normal", "index")
    maps = ij.render(ij.Scene([truth, table]), CAMERA, outputs=outputs)
    sensor = ij.MatchingWindow(SIGMA_NOISE, half_window=3)
    asked = {"mask": np.asarray(maps.index) == 0, "errors": "independent"}
    off = []
    for seed in range(3):
        key = jax.random.key(seed)
        depth = np.asarray(sensor.sample(key, maps.depth, maps.normal, CAMERA))
        fit = ij.fit_cylinder(depth, CAMERA, sigma=sensor, **asked)
        assert fit.success
        off.append(errors(fit, truth)[0])
    assert max(off) < 3


@FULL
@pytest.mark.parametrize("pixels", [0, -2])
def test_a_window_that_leans_at_edges_is_not_believed_there(pixels):
    truth, sensor = can(50.0), ij.MatchingWindow(SIGMA_NOISE, half_window=3)
    depth, mask = read_by(sensor, truth, CAMERA, 0.6, seed=2)
    believed = ij.fit_cylinder(depth, CAMERA, mask, SIGMA_NOISE)
    # Its walls seem to bend at the edges.
    assert not believed.success or errors(believed, truth).max() > 4
    part = grown(mask, pixels) if pixels else mask
    fit = ij.fit_cylinder(depth, CAMERA, part, sensor)
    assert fit.success
    assert errors(fit, truth).max() < 3
    told = ij.fit_cylinder(
        depth, CAMERA, mask, sensor, initial=fit.cylinder, errors="independent"
    )
    assert told.std.radius < fit.std.radius


def along_axis(depth):
    """Places of an image's readings along the can's axis, in meters."""
    row, col = np.indices(depth.shape)
    x, y = (col - CAMERA.cx) / CAMERA.fx, (row - CAMERA.cy) / CAMERA.fy
    points = np.stack([x, y, np.ones_like(x)], axis=-1) * depth[..., None]
    return (points - np.asarray(can().center)) @ np.asarray(can().axis)


def test_small_holes_of_a_silhouette_are_no_ends():
    depth, mask = image()
    height = ij.fit_cylinder(depth, CAMERA, mask, SIGMA, mask_meaning="outline")
    random = np.random.default_rng(0)
    row, col = np.nonzero(cv2.erode(mask.view(np.uint8), np.ones((9, 9))))
    holed = mask.copy()
    for k in random.choice(len(row), 8, replace=False):
        holed[row[k] - 1 : row[k] + 2, col[k] - 1 : col[k] + 2] = False
    fit = ij.fit_cylinder(depth, CAMERA, holed, SIGMA, mask_meaning="outline")
    assert fit.success
    off = float(fit.cylinder.height) - 0.12
    assert abs(off) < 4 * float(fit.std.height)
    assert float(fit.std.height) < 1.2 * float(height.std.height)


def test_an_outline_that_stops_where_the_wall_goes_on_is_refuted():
    # A mask without a third of the can: a height of 81 mm, 169 deviations off.
    depth, mask = image()
    cut = mask & (along_axis(depth) < 0.02)
    fit = ij.fit_cylinder(depth, CAMERA, cut, SIGMA, mask_meaning="outline")
    assert fit.status == "contradicted"
    assert "shows the wall beyond an end" in fit.reason
    as_region = ij.fit_cylinder(depth, CAMERA, cut, SIGMA)
    assert as_region.success
    assert not bool(as_region.ends_seen.all())
