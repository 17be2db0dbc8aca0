"""Errors that all readings share: of scale, and smooth ones."""

import functools

import jax
import numpy as np
import pytest

import impostor_jax as ij
from tests.fit.scenes import CAMERA, SIGMA, can, image
from tests.groups import FULL, RELEASE, SMALL_IMAGES

pytestmark = [SMALL_IMAGES, FULL]

NOISE = ij.ConstantNoise(SIGMA)
SCALED = ij.ScaleError(NOISE, deviation=0.02)
WARPED = ij.CorrelatedNoise(NOISE, deviation=0.01, length=60.0)


@functools.cache
def fitted(sensor, **options):
    depth, mask = image()
    return ij.fit_cylinder(depth, CAMERA, mask, sensor, **options)


@RELEASE
def test_an_error_of_scale_is_in_every_length_and_no_angle():
    plain, scaled = fitted(NOISE), fitted(SCALED)
    share = scaled.std_budget["scale"]
    for name in ("radius", "height"):
        size = float(getattr(scaled.cylinder, name))
        assert float(getattr(share, name)) == pytest.approx(0.02 * size, rel=1e-3)
    away = 0.02 * np.abs(np.asarray(scaled.cylinder.center))
    np.testing.assert_allclose(share.center, away, rtol=1e-3)
    assert not np.asarray(share.axis).any()
    np.testing.assert_allclose(scaled.std.axis, plain.std.axis, rtol=1e-3)
    np.testing.assert_allclose(scaled.cylinder.center, plain.cylinder.center, rtol=1e-6)


def test_an_error_of_scale_that_is_none_changes_nothing():
    plain, scaled = fitted(NOISE), fitted(ij.ScaleError(NOISE, deviation=0))
    np.testing.assert_allclose(scaled.std.radius, plain.std.radius, rtol=1e-3)


@RELEASE
def test_an_offset_of_the_disparity_bends_what_is_deep():
    law = {"deviation": 0.02 / 0.35, "law": "disparity"}
    fit = fitted(ij.ScaleError(NOISE, **law))
    share = float(fit.std_budget["scale"].radius)
    assert share == pytest.approx(0.02 * float(fit.cylinder.radius), rel=0.01)
    assert float(fit.std_budget["warp"].axis.max()) > 3 * float(
        fit.std_budget["noise"].axis.max()
    )


def test_what_deviations_are_made_of_adds_up():
    fit = fitted(ij.ScaleError(WARPED, 0.01))
    for name in ("radius", "height", "across_axis", "axis"):
        parts = fit.std_budget.of(name)
        total = np.sqrt(sum(np.asarray(part) ** 2 for part in parts.values()))
        np.testing.assert_allclose(total, getattr(fit.std, name), rtol=1e-3)
    assert set(fit.std_budget.of("radius")) == {"noise", "warp", "scale", "outline"}
    assert "warp: " in str(fit.std_budget)
    with pytest.raises(KeyError, match="std_budget has the parts noise, "):
        fit.std_budget["bias"]


def test_a_known_height_tells_the_scale():
    depth, mask = image()
    truth = can()
    free = fitted(SCALED)
    # The sensor shows all 3 % too large.
    fit = ij.fit_cylinder(
        (depth * 1.03).astype(np.float32), CAMERA, mask, SCALED,
        prior={"height": (float(truth.height), 1e-4)},
    )  # fmt: skip
    assert fit.success
    assert float(fit.std.radius) < 0.15 * float(free.std.radius)
    assert abs(fit.cylinder.radius - truth.radius) < 2 * float(fit.std.radius)
    assert abs(fit.cylinder.height - truth.height) < 2 * float(fit.std.height)
    away = np.asarray(fit.cylinder.center - truth.center)
    assert (np.abs(away) < 3 * np.asarray(fit.std.center)).all()


@RELEASE
def test_a_mean_error_that_is_known_is_taken_off_once():
    depth, mask = image()
    sensor = ij.ScaleError(NOISE, deviation=0.001, mean=0.05)
    far = (depth * 1.05).astype(np.float32)
    for given in (mask, None):
        fit = ij.fit_cylinder(far, CAMERA, given, sensor)
        assert fit.success
        assert float(fit.cylinder.radius) == pytest.approx(0.04, abs=2e-4)
    found = ij.find_cylinders(far, CAMERA, sensor)
    assert float(found.fits[0].cylinder.radius) == pytest.approx(0.04, abs=2e-4)
    told = ij.test_taper(fit)
    assert float(told.frustum.frustum.radius1) == pytest.approx(0.04, abs=5e-4)


@RELEASE
def test_deviations_are_those_of_draws_of_a_warp():
    truth, start = can(), can()
    maps = ij.render(truth, CAMERA, outputs=("depth", "normal", "mask"))
    found = []
    for key in jax.random.split(jax.random.key(0), 60):
        depth = WARPED.sample(key, maps.depth, maps.normal, CAMERA)
        fit = ij.fit_cylinder(depth, CAMERA, maps.mask, WARPED, initial=start)
        assert fit.success
        off = [fit.cylinder.radius - truth.radius, *(fit.cylinder.axis - truth.axis)]
        found.append(np.asarray(off))
    spread = np.std(found, axis=0)
    # Four standard errors of a standard deviation.
    near = {"rel": 4 / np.sqrt(2 * len(found))}
    assert spread[0] == pytest.approx(float(fit.std.radius), **near)
    tilt = np.linalg.norm(spread[1:])
    assert tilt == pytest.approx(np.linalg.norm(np.asarray(fit.std.axis)), **near)
    assert fit.std_budget["warp"].radius > 2 * fit.std_budget["noise"].radius


@RELEASE
def test_a_sensor_that_shifts_outlines_says_so_of_them():
    depth, mask = image()
    window = ij.MatchingWindow(NOISE, half_window=2)
    plain, shifted = (
        ij.fit_cylinder(
            depth, CAMERA, mask, sensor, mask_meaning="outline", errors="independent"
        )
        for sensor in (NOISE, window)
    )
    assert shifted.success
    ratio = shifted.std_budget["outline"].height / plain.std_budget["outline"].height
    assert ratio > 5
    assert shifted.std.radius > plain.std.radius


@RELEASE
def test_other_shapes_have_a_scale():
    depth, mask = image()
    frustum = ij.fit_frustum(depth, CAMERA, mask, SCALED)
    assert float(frustum.std_budget["scale"].radius1) == pytest.approx(8e-4, rel=0.02)
    ball = ij.Sphere((0.0, 0.0, 0.35), 0.05)
    maps = ij.render(ball, CAMERA, outputs=("depth", "mask"))
    fit = ij.fit_sphere(maps.depth, CAMERA, maps.mask, SCALED)
    assert fit.success
    assert float(fit.std_budget["scale"].radius) == pytest.approx(0.001, rel=0.01)


@RELEASE
def test_a_traced_fit_counts_the_same_in():
    depth, mask = image()
    sensor = ij.ScaleError(WARPED, 0.01)

    @jax.jit
    def traced(depth):
        return ij.fit_cylinder(depth, CAMERA, mask, sensor, initial=can()).std.radius

    plain = ij.fit_cylinder(depth, CAMERA, mask, sensor, initial=can()).std.radius
    assert float(traced(depth)) == pytest.approx(float(plain), rel=0.01)


def test_parallel_rays_have_no_scale():
    camera = ij.OrthographicCamera(500.0, 500.0, 79.5, 59.5, 160, 120)
    with pytest.raises(ValueError, match="sigma must be a sensor without errors"):
        ij.find_cylinders(np.ones((120, 160), np.float32), camera, SCALED)
