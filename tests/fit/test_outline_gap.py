"""The outline that an image shows, beside that of the fit."""

import dataclasses
import json
from typing import Any

import cv2
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit import learned
from impostor_jax.fit.outline_gap import compared_with_outline
from impostor_jax.fit.request import checked_noise
from impostor_jax.fit.result import Asked, OutlineGap
from impostor_jax.fit.seen import Seen
from tests.fit.scenes import CAMERA, SIGMA, camera_with, can, image
from tests.fit.test_masks import grown, on_table
from tests.groups import FULL, SMALL_IMAGES
from tests.schemas import validator

pytestmark = SMALL_IMAGES
PIXEL = 0.35 / 150


def fit_of(depth, mask, sigma=SIGMA, **asked):
    return ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=sigma, **asked)


def with_radius(fit, factor):
    """A fit with another radius whose front is where that of the first is."""
    center, axis = np.asarray(fit.cylinder.center), np.asarray(fit.cylinder.axis)
    away = center - axis * (center @ axis)
    larger = (factor - 1) * float(fit.cylinder.radius)
    moved = center + larger * away / np.linalg.norm(away)
    shape = eqx.tree_at(
        lambda c: (c.center, c.radius),
        fit.cylinder,
        (jnp.asarray(moved, jnp.float32), fit.cylinder.radius * np.float32(factor)),
    )
    return dataclasses.replace(fit, shape=shape, asked=Asked())


def gap_of(fit) -> OutlineGap:
    assert fit.outline_gap is not None
    return fit.outline_gap


def compared(fit, depth, mask, camera=CAMERA, sigma: Any = SIGMA, is_outline=False):
    depth = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    seen = Seen(depth, mask, camera, checked_noise(sigma))
    return compared_with_outline(fit, [seen], is_outline)


def test_the_outline_of_a_right_fit_has_no_gap():
    depth, mask = image()
    fit = fit_of(depth, mask)
    gap = gap_of(fit)
    assert fit.success
    assert abs(gap.pixels) < 0.5
    assert gap.fit_pixels < 0.1
    assert gap.edge_pixels == 1
    assert "outline is" not in str(fit)


@pytest.mark.parametrize("pixels", [-4, -2, 1, 2, 4])
@pytest.mark.parametrize("scene", [image, on_table])
def test_a_mask_that_is_off_is_no_gap(scene, pixels):
    depth, mask = scene()
    fit = fit_of(depth, mask)
    found = compared(with_radius(fit, 1), depth, grown(mask, pixels))
    assert found.success
    assert abs(gap_of(found).pixels) < 1


def test_sparse_readings_and_outliers_are_no_gap():
    depth, mask = image()
    fit = with_radius(fit_of(depth, mask), 1)
    rng = np.random.default_rng(1)
    few = np.where(rng.random(depth.shape) < 0.2, depth, 0)
    assert abs(gap_of(compared(fit, few, mask)).pixels) < 1
    wild = np.where(rng.random(depth.shape) < 0.1, 0.6, depth)
    assert abs(gap_of(compared(fit, wild, mask)).pixels) < 1


def test_an_occluder_and_the_borders_of_an_image_end_no_surface():
    depth, mask = image()
    fit = with_radius(fit_of(depth, mask), 1.5)
    # The edges of all that is left are the occluder's.
    hidden = depth.copy()
    hidden[~grown(mask, -4)] = 0.2
    assert compared(fit, hidden, grown(mask, -4)).outline_gap is None
    inner = grown(mask, -6)
    nothing = np.where(mask, depth, 0)
    assert compared(fit, nothing, inner).outline_gap is None


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("first", [86, 90])
def test_outliers_before_an_occluder_are_no_background(first, seed):
    # They contradicted a twentieth of all random scenes.
    depth, mask = image()
    fit = with_radius(fit_of(depth, mask), 1)
    board = np.broadcast_to(np.arange(160) >= first, depth.shape)
    wild = np.random.default_rng(seed).random(depth.shape) < 0.1
    hidden = np.where(board, np.where(wild, 0.6, 0.2), depth)
    assert abs(gap_of(compared(fit, hidden, mask & ~board)).pixels) < 1


@pytest.mark.parametrize("factor", [0.6, 1.6])
def test_a_gap_is_told_in_pixels_and_contradicts(factor):
    depth, mask = image()
    fit = fit_of(depth, mask)
    wrong = with_radius(fit, factor)
    found = compared(wrong, depth, mask)
    gap = gap_of(found)
    assert found.status is ij.FitStatus.CONTRADICTED
    assert not found.success
    # The wall's edge is a little farther than its axis, or nearer.
    expected = (1 - factor) * 0.04 / PIXEL
    assert gap.pixels == pytest.approx(expected, abs=0.15 * abs(expected) + 0.7)
    radius = float(wrong.cylinder.radius)
    assert gap.radii * radius / PIXEL == pytest.approx(gap.pixels, rel=0.1)
    scale = np.hypot(gap.fit_pixels, gap.edge_pixels)
    assert gap.deviations == pytest.approx(gap.pixels / scale)
    where = "beyond" if factor < 1 else "within"
    for text in (f"{abs(gap.pixels):.1f} pixels {where}", f"{1e3 * radius:.1f} mm"):
        assert text in found.reason
    record = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    validator("fit").validate(record)
    assert record["outline_gap"]["pixels"] == gap.pixels


def test_a_mask_that_is_the_outline_needs_no_background():
    depth, mask = image(wall=None)
    fit = fit_of(depth, mask)
    assert fit.outline_gap is None
    wrong = with_radius(fit, 0.6)
    assert compared(wrong, depth, mask).outline_gap is None
    assert gap_of(compared(wrong, depth, mask, is_outline=True)).pixels > 5


def test_what_a_sensor_may_move_an_edge_by_is_a_warning():
    depth, mask = image()
    wrong = with_radius(fit_of(depth, mask), 0.75)
    sensor = ij.MatchingWindow(checked_noise(SIGMA))
    with pytest.warns(UserWarning, match="pixels beyond the fit's"):
        found = compared(wrong, depth, mask, sigma=sensor)
    assert found.success
    assert gap_of(found).edge_pixels == pytest.approx(np.hypot(1, 5 / 3**0.5))
    assert "The image's outline is +" in str(found)
    assert "pixels beyond the fit's" in found.reason


def test_poses_and_lenses_count():
    depth, mask = image()
    fit = fit_of(depth, mask)
    wrong = with_radius(fit, 0.6)
    expected = gap_of(compared(wrong, depth, mask))
    pose = ij.RigidTransform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], (0.1, 0.2, 0.3))
    turned = camera_with(camera_from_world=pose)
    shape = wrong.cylinder.transformed(pose.inverse())
    there = dataclasses.replace(wrong, shape=shape, asked=Asked())
    found = gap_of(compared(there, depth, mask, turned))
    assert found.pixels == pytest.approx(expected.pixels, abs=0.3)
    assert found.deviations == pytest.approx(expected.deviations, abs=0.3)
    lens = camera_with(distortion=(-1.0, 0.3, 0.0, 0.0, 0.0))
    maps = jax.device_get(ij.render(can(), lens, outputs=("depth", "mask")))
    right = compared(with_radius(fit, 1), np.minimum(maps.depth, 0.6), maps.mask, lens)
    assert abs(gap_of(right).pixels) < 1


def test_a_skewed_image_is_no_success(monkeypatch):
    # As of rays that are exact: what skews an image is not taken for their error.
    monkeypatch.setattr(learned, "SPEAKS", np.inf)
    depth, mask = image()
    middle = np.median(depth[mask])
    skewed = np.where(mask, middle + 0.45 * (depth - middle), depth)
    # Of its noise 0.45 are left: with that alone the shape would be refuted.
    skewed = skewed + np.random.default_rng(1).normal(0, 0.0014, depth.shape)
    fit = fit_of(skewed.astype(np.float32), mask, sigma=0.0015)
    assert float(fit.cylinder.radius) > 0.05
    assert fit.status is ij.FitStatus.CONTRADICTED
    assert gap_of(fit).radii < -0.1
    assert np.isinf(fit.std.radius)


def fattened(depth, mask, pixels):
    """What is nearer reaches so far over what is farther, as of stereo."""
    size = (2 * pixels + 1,) * 2
    own = np.where(mask, depth, np.inf).astype(np.float32)
    reached = cv2.erode(own, np.ones(size))
    wider = cv2.dilate(mask.astype(np.uint8), np.ones(size)) > 0
    noise = np.random.default_rng(7).normal(0, SIGMA, depth.shape)
    grown = wider & ~mask
    return np.where(grown, reached + noise, depth).astype(np.float32), wider


@pytest.mark.parametrize("sigma", [SIGMA, pytest.param(None, marks=FULL)])
def test_ends_are_no_surer_than_edges_beside_the_wall(sigma):
    # Heights were 20 to 40 of their deviations off.
    camera = ij.PinholeCamera(300.0, 300.0, 159.5, 119.5, width=320, height=240)
    maps = ij.render(can(90.0), camera, outputs=("depth", "mask"))
    depth, mask = np.asarray(maps.depth), np.asarray(maps.mask)
    noise = np.random.default_rng(0).normal(0, SIGMA, depth.shape)
    depth = (np.minimum(depth, 0.6) + noise).astype(np.float32)
    exact = ij.fit_cylinder(depth, camera, mask, sigma)
    assert "less sure" not in exact.reason
    assert float(exact.std.height) < 1e-4
    depth, mask = fattened(depth, mask, 1)
    fit = ij.fit_cylinder(depth, camera, mask, sigma)
    assert fit.success
    assert "Ends are less sure" in fit.reason
    off = float(fit.cylinder.height) - 0.12
    assert 0.002 < off < 3 * float(fit.std.height)
    assert abs(float(fit.cylinder.radius) - 0.04) < 3 * float(fit.std.radius)


@FULL
def test_a_sensor_that_says_how_edges_err_is_believed():
    depth, mask = fattened(*image(), 1)
    fit = fit_of(depth, mask, ij.MatchingWindow(ij.ConstantNoise(SIGMA)))
    assert "less sure" not in fit.reason
