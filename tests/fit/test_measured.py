"""Noise that is measured in the image, where nothing is told of the sensor."""

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.measured import NOT_MEASURED, law_of_noise, measured_noise
from tests.fit.scenes import CAMERA, SIGMA, camera_with, can, image, with_outliers
from tests.groups import FULL

SHAPE = can()


def drawn(sensor, seed=0):
    """Readings of the can before a wall that is turned, and the can's mask.

    The wall is far: there smooth errors are not lost in the noise of single readings.
    """
    wall = ij.Plane((0.0, 0.0, 1.3), (0.3, 0.0, -1.0))
    scene = ij.Scene([SHAPE, wall])
    maps = ij.render(scene, CAMERA, outputs=("depth", "normal", "index"))
    readings = sensor.sample(jax.random.key(seed), maps.depth, maps.normal, CAMERA)
    return np.asarray(readings), np.asarray(maps.index) == 0


@pytest.mark.parametrize("sigma", [0.0003, 0.001, 0.003])
def test_a_level_of_white_noise_is_found_to_a_tenth(sigma):
    depth, mask = drawn(ij.ConstantNoise(sigma))
    found = measured_noise(depth, mask, CAMERA)
    assert isinstance(found.noise, ij.ConstantNoise)
    assert float(found.noise.deviation) == pytest.approx(sigma, rel=0.1)
    assert "white noise" in found.text


@pytest.mark.parametrize("seed", range(3))
def test_a_camera_that_matches_windows_is_told_by_the_planes_around(seed):
    depth, mask = drawn(ij.StructuredLight.sensor(), seed)
    noise = measured_noise(depth, mask, CAMERA).noise
    assert noise.bias.scales
    assert noise.bias.fields
    assert int(noise.bias.window_reach) > 0


@pytest.mark.parametrize("sensor", [ij.StructuredLight(), ij.StereoDisparity(150.0)])
def test_what_is_independent_is_no_camera_that_matches_windows(sensor):
    depth, mask = drawn(sensor)
    assert isinstance(measured_noise(depth, mask, CAMERA).noise, ij.ConstantNoise)


@pytest.mark.parametrize(
    "lens",
    [
        pytest.param({"distortion": (-0.3, 0.1, 0, 0, 0)}, id="radial"),
        pytest.param({"distortion": (0.1, 0, 0, 0), "fisheye": True}, id="fisheye"),
    ],
)
def test_a_wall_is_flat_through_a_lens(lens):
    # Planes of its pixels had smooth errors: deviations were 20 to 35 times too wide.
    camera = camera_with(**lens)
    wall = ij.Plane((0.0, 0.0, 1.3), (0.5, 0.3, -1.0))
    depth = np.asarray(ij.render(wall, camera, outputs=("depth",)).depth)
    depth = depth + np.random.default_rng(0).normal(0, SIGMA, depth.shape)
    mask = np.zeros(depth.shape, bool)
    mask[50:70, 60:100] = True
    found = measured_noise(depth.astype(np.float32), mask, camera)
    assert isinstance(found.noise, ij.ConstantNoise)
    assert float(found.noise.deviation) == pytest.approx(SIGMA, rel=0.15)


@FULL
def test_grain_is_told_by_planes_around():
    # Of one whose length nobody knew, radii were up to eight deviations off.
    grain = ij.CorrelatedNoise(ij.ConstantNoise(6e-4), 1.5e-3, length=2.8, power=0)
    depth, mask = drawn(grain)
    noise = measured_noise(depth, mask, CAMERA).noise
    short = [one for one in noise.bias.fields if one.is_grain]
    assert [one.length for one in short] == [3.0]
    # An object by itself bends.
    alone = measured_noise(np.where(mask, depth, 0), mask, CAMERA).noise
    assert not any(one.is_grain for one in alone.bias.fields)


LARGE = ij.PinholeCamera(525.0, 525.0, 319.5, 239.5, 640, 480)


def with_smooth_error(length, deviation, sigma=0.001):
    """An object before a wall, with white noise, and its mask."""
    row, col = np.indices((480, 640))
    rng = np.random.default_rng(0)
    smooth = cv2.GaussianBlur(rng.normal(size=row.shape), (0, 0), length / 2**0.5)
    mask = (abs(row - 240) < 60) & (abs(col - 320) < 40)
    depth = np.where(mask, 0.7, 1 / (1 + 1e-4 * col - 3e-4 * row))
    depth += rng.normal(0, sigma, row.shape) + deviation * smooth / smooth.std()
    # In each of the smallest patches a block is a hole.
    return np.where((row % 48 < 12) & (col % 48 < 12), 0, depth), mask


@pytest.mark.parametrize("sigma", [0.0, 1e-4])
def test_smooth_errors_are_told_where_nothing_else_errs(sigma):
    # As of depth that a network tells. Without noise they were not looked for, and one
    # of 8 fits was 18 of its deviations off; with .1 mm of it all 8 failed.
    depth, mask = with_smooth_error(60, 0.003, sigma)
    noise = measured_noise(depth, mask, LARGE).noise
    at = jnp.asarray(0.7)
    smooth = np.linalg.norm([float(one.shift(at)) for one in noise.bias.fields])
    assert 0.5 < smooth / 0.003 < 1.5
    # With less of its own most readings of a wall would be outliers.
    assert float(noise.sigma(at, at)) > smooth / 4


def test_what_a_mask_shows_beside_an_object_is_no_noise_of_it():
    # Two pixels of a table: noise of 1.3 mm was 8.6, and a radius 7 deviations off.
    depth, mask = drawn(ij.ConstantNoise(SIGMA))
    wider = cv2.dilate(mask.view(np.uint8), np.ones((5, 5))) > 0
    found = measured_noise(depth, wider, CAMERA)
    assert float(found.noise.deviation) == pytest.approx(SIGMA, rel=0.1)


def test_differences_across_an_edge_are_no_filtered_noise():
    # With a mask that is a pixel too large noise of less than 2 mm was 4.9.
    plane = ij.Plane((0.0, 0.05, 0.38), (0.0, -0.3, -1.0))
    maps = ij.render(ij.Scene([SHAPE, plane]), CAMERA, outputs=("depth", "index"))
    noise = np.random.default_rng(0).normal(0, 0.002, maps.depth.shape)
    depth = cv2.medianBlur((np.asarray(maps.depth) + noise).astype(np.float32), 5)
    mask = (np.asarray(maps.index) == 0).astype(np.uint8)
    found = measured_noise(depth, cv2.dilate(mask, np.ones((3, 3))) > 0, CAMERA)
    at = jnp.asarray(0.35)
    assert float(found.noise.sigma(at, jnp.ones_like(at))) < 0.003


@pytest.mark.parametrize("value", [0.1, 10.0])
def test_holes_that_are_filled_with_a_number_are_no_noise(value):
    # Those that are wider than an outlier: the radius was 450 times less sure.
    depth, mask = with_smooth_error(60, 0.0)
    row, col = np.indices(depth.shape)
    depth[((row - 5) % 37 < 9) & ((col - 5) % 41 < 10)] = value
    found = measured_noise(depth, mask, LARGE)
    assert isinstance(found.noise, ij.ConstantNoise)
    assert float(found.noise.deviation) == pytest.approx(0.001, rel=0.1)


@pytest.mark.parametrize("length", [42, 85])
def test_a_warp_that_is_longer_than_the_smallest_patch_is_told(length):
    # Planes of 48 pixels take it up, and the noise was white: of 8 fits 5 and 7 were
    # more than four of their deviations off, up to 29, with success.
    noise = measured_noise(*with_smooth_error(length, 0.0015), LARGE).noise
    assert max(one.length for one in noise.bias.fields) == 60
    # On the object it is what it is on the wall, as the noise is.
    at, steep = jnp.asarray(0.7), jnp.asarray(1.0)
    smooth = [float(one.shift(at)) for one in noise.bias.fields]
    assert 0.4 < np.linalg.norm(smooth) / 0.0015 < 1.5
    assert float(noise.sigma(at, steep)) == pytest.approx(0.001, rel=0.15)


@pytest.mark.parametrize(("length", "part"), [(20, 0.1), (40, 0.1), (100, 0.2)])
def test_smooth_errors_are_seen_that_are_a_tenth_of_the_noise(length, part):
    noise = measured_noise(*with_smooth_error(length, 1e-3 * part), LARGE).noise
    assert noise.bias.fields


@pytest.mark.parametrize("seed", [1, 2, 4, 5])
def test_flat_things_on_a_table_are_no_smooth_errors(seed):
    # In small images few patches are free of edges: of 40 such 32 had some, now 9.
    rng = np.random.default_rng(seed)
    row, col = np.indices((120, 160))
    depth = 1 / (1 + 1e-3 * col - 2e-3 * row)
    for y, x, size in rng.integers(0, (100, 140, 40), (12, 3)):
        depth[y : y + size, x : x + size] -= rng.choice([0.005, 0.02, 0.1])
    mask = (abs(row - 60) < 15) & (abs(col - 80) < 16)
    depth = np.where(mask, 0.7, depth) + rng.normal(0, 0.001, row.shape)
    noise = measured_noise(depth, mask, CAMERA).noise
    assert isinstance(noise, ij.ConstantNoise)


def test_filtered_noise_is_told_without_anything_around():
    depth, mask = image(wall=None)
    grain = ij.CorrelatedNoise(ij.ConstantNoise(1e-4), 0.01, length=4.0)
    flat = np.full(depth.shape, 0.35, np.float32)
    normal = np.broadcast_to(np.float32([0, 0, -1]), (*depth.shape, 3))
    readings = grain.sample(jax.random.key(1), flat, normal, CAMERA)
    alone = np.where(mask, readings, 0)
    reach = int(measured_noise(alone, mask, CAMERA).noise.bias.window_reach)
    assert reach > 0
    # An image that was warped to a color camera's has finer pixels than its sensor.
    narrow = ij.PinholeCamera(250.0, 250.0, 79.5, 59.5, 160, 120)
    wide = int(measured_noise(alone, mask, narrow).noise.bias.window_reach)
    assert wide >= 2 * reach - 1


def test_what_fills_the_image_bends_and_is_no_smooth_error():
    # Of a tank: smooth errors of 2 mm, with which its radius was known to a tenth.
    tank = ij.Cylinder((0.0, 0.0, 3.5), (0.0, 1.0, 0.05), radius=2.0, height=100.0)
    camera = ij.PinholeCamera(525.0, 525.0, 159.5, 119.5, width=320, height=240)
    depth = np.asarray(ij.render(tank, camera, outputs=("depth",)).depth)
    depth = depth + np.random.default_rng(0).normal(0, 0.003, depth.shape)
    found = measured_noise(depth, np.isfinite(depth), camera)
    assert isinstance(found.noise, ij.ConstantNoise)
    assert float(found.noise.deviation) == pytest.approx(0.003, rel=0.1)


@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
def test_outliers_are_no_noise(share):
    # A twentieth of them made 4 mm that neighbors share of 1 mm of white noise, and
    # fits of what little was left 50 mm of a radius of 41, with success.
    depth, mask = drawn(ij.ConstantNoise(0.001))
    found = measured_noise(with_outliers(depth, share), mask, CAMERA)
    assert isinstance(found.noise, ij.ConstantNoise)
    assert 0.0009 < float(found.noise.deviation) < 0.001 * (1 + 3 * share)


def test_more_outliers_than_can_be_told_apart_leave_the_noise_open():
    depth, mask = drawn(ij.ConstantNoise(0.001))
    depth = with_outliers(depth, 0.4)
    assert measured_noise(depth, mask, CAMERA) is None
    assert law_of_noise(depth, CAMERA).text == NOT_MEASURED


def test_rounded_readings_are_no_outliers():
    depth, mask = drawn(ij.ConstantNoise(0.0005))
    noise = measured_noise(np.round(depth, 3), mask, CAMERA).noise
    assert isinstance(noise, ij.ConstantNoise)
    rounded = np.hypot(0.0005, 0.001 / 12**0.5)
    assert float(noise.deviation) == pytest.approx(rounded, rel=0.15)


@pytest.mark.parametrize("step", [0.0002, 0.001, 0.01])
def test_rounding_alone_is_no_error_that_neighbors_share(step):
    # Terraces of a plane were smooth errors: a radius that was off by .01 mm had a
    # deviation of 1 mm, and without a mask some cans were not found.
    wall = ij.Plane((0.0, 0.0, 1.2), (0.2, 0.6, -0.8))
    maps = ij.render(ij.Scene([SHAPE, wall]), CAMERA, outputs=("depth", "index"))
    depth = (step * np.round(np.asarray(maps.depth, float) / step)).astype(np.float32)
    mask = np.asarray(maps.index) == 0
    for noise in (measured_noise(depth, mask, CAMERA), law_of_noise(depth, CAMERA)):
        assert "rounded" in noise.text
        assert float(noise.noise.deviation) == pytest.approx(step / 12**0.5, rel=1e-3)
    # A camera's own noise is more than that.
    noisy = depth + np.random.default_rng(0).normal(0, step / 3, depth.shape)
    assert "rounded" not in measured_noise(noisy, mask, CAMERA).text


def test_tiles_of_two_surfaces_show_no_smooth_error():
    # A table full of things: four of seven tiles held an edge, and a can of 38,000
    # pixels was not found.
    row, col = np.indices((480, 640))
    steps = 0.02 * ((row // 140 + col // 140) % 2)
    noise = np.random.default_rng(0).normal(0, 0.001, row.shape)
    depth = 1 / (1 - 1e-4 * row - 2e-4 * col) + steps + noise
    mask = (abs(row - 210) < 60) & (abs(col - 350) < 60)
    found = measured_noise(depth, mask, LARGE).noise
    assert isinstance(found, ij.ConstantNoise)
    assert float(found.deviation) == pytest.approx(0.001, rel=0.05)


@pytest.mark.parametrize("deviation", [0.0, 0.002])
@pytest.mark.parametrize("wall", [1.2, 1.2345])
def test_a_wall_that_faces_the_camera_tells_no_step(wall, deviation):
    # Its one depth was the step, 1.2 m: a drawn can was undetermined. What is as far as
    # a sensor reads hides no noise of what is nearer, either.
    scene = ij.Scene([SHAPE, ij.Plane((0.0, 0.0, wall), (0.0, 0.0, -1.0))])
    maps = ij.render(scene, CAMERA, outputs=("depth", "index"))
    mask = np.asarray(maps.index) == 0
    noise = np.random.default_rng(0).normal(0, deviation, mask.shape)
    depth = np.asarray(maps.depth, float) + np.where(mask, noise, 0)
    found = measured_noise(np.round(depth, 3).astype(np.float32), mask, CAMERA).noise
    expected = np.hypot(deviation, 0.001 / 12**0.5)
    assert float(found.deviation) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("width", [0.45, 0.6])
def test_a_filter_of_half_a_pixel_is_no_window(width):
    # Five pixels beside jumps were left out: all but 48 pixels of a can of 269, whose
    # radius came out a third, with success.
    depth, mask = drawn(ij.ConstantNoise(1e-9))
    grain = np.random.default_rng(0).normal(size=depth.shape)
    grain = cv2.GaussianBlur(grain, (0, 0), width)
    found = measured_noise(depth + 0.001 * grain / grain.std(), mask, CAMERA)
    assert int(found.noise.bias.window_reach) <= 2


def test_disparities_of_whole_pixels_are_read():
    # Most tiles of planes hold equal readings, by whose noise of 0 was divided.
    depth, mask = drawn(ij.ConstantNoise(1e-6))
    coarse = (8 / np.round(8 / depth)).astype(np.float32)
    fit = ij.fit_cylinder(coarse, CAMERA, mask)
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.04) < 3 * float(fit.std.radius)


def test_nothing_told_is_as_white_noise_told():
    depth, mask = image()
    told = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask)
    assert fit.success
    off = float(fit.cylinder.radius - told.cylinder.radius)
    assert abs(off) < 0.2 * float(told.std.radius)
    assert float(fit.std.radius) == pytest.approx(float(told.std.radius), rel=0.1)
    assert float(fit.chi2) == pytest.approx(1, abs=0.1)
    assert "Measured in the image" in str(fit)


@FULL
def test_interval_holds_of_a_camera_that_nobody_told():
    depth, mask = drawn(ij.StructuredLight.sensor(), 2)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask)
    assert fit.success
    off = float(fit.cylinder.radius - SHAPE.radius)
    assert abs(off) < 1.96 * float(fit.std.radius)
    # The scale, which no image shows, is counted.
    assert float(fit.std_budget["scale"].radius) > 0


@FULL
def test_another_shape_is_a_poor_fit_though_no_noise_is_told():
    depth, mask = image()
    wrong = ij.Cylinder(SHAPE.center, SHAPE.axis, 0.5 * SHAPE.radius, SHAPE.height)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, initial=wrong, fixed=("radius",))
    # Without the radius that is held, the readings tell another one.
    assert fit.status == ij.FitStatus.CONTRADICTED
    assert not np.isnan(fit.p_value)


def test_an_image_without_noise_is_held_against_nothing_and_says_so():
    maps = ij.render(SHAPE, CAMERA, outputs=("depth", "mask"))
    depth, mask = np.asarray(maps.depth), np.asarray(maps.mask)
    assert measured_noise(np.where(mask, depth, 0), mask, CAMERA) is None
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask)
    assert fit.success
    assert np.isnan(fit.p_value)
    assert "not measured" in str(fit)


def test_noise_is_found_to_grow_with_depth():
    # Of a wall at 2.5 m it is five times as large as of the can at 0.8 m, of which an
    # image has few readings.
    sensor = ij.StructuredLight()
    wall = ij.Plane((0.0, 0.0, 2.5), (0.1, 0.0, -1.0))
    maps = ij.render(ij.Scene([SHAPE, wall]), CAMERA, outputs=("depth", "normal"))
    readings = sensor.sample(jax.random.key(3), maps.depth, maps.normal, CAMERA)
    law = law_of_noise(np.asarray(readings), CAMERA).noise
    depths, steep = jnp.array([0.8, 2.5]), jnp.ones(2)
    ratio = np.asarray(law.sigma(depths, steep) / sensor.sigma(depths, steep))
    # The can's bend adds to what is told of it: of so few pixels, 60 %.
    assert 0.8 < ratio[0] < 2
    assert ratio[1] == pytest.approx(1, abs=0.25)


def test_a_mask_of_nothing_tells_no_noise():
    depth, mask = image()
    assert measured_noise(depth, np.zeros_like(mask), CAMERA) is None


def test_an_image_of_nothing_has_the_usual_noise():
    law = law_of_noise(np.zeros((CAMERA.height, CAMERA.width), np.float32), CAMERA)
    assert float(law.noise.deviation) == pytest.approx(0.001)
