"""Points of which nobody tells where they were seen from, or how they err."""

import re

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.clouds.wall import wall_of
from impostor_jax.fit.regions import DepthUnitsWarning
from tests.groups import FULL, OF_POINTS, RELEASE

pytestmark = OF_POINTS
CENTER, AXIS, RADIUS = np.array([1.0, -2.0, 1.5]), np.array([0.05, -0.02, 1.0]), 0.12
NOISE, LENGTH = 0.003, 1.0


def stem(count=2000, turn=(0, 2 * np.pi), noise=NOISE, bumps=0.0, seed=0):
    """Points of a stem between two angles, and their normals."""
    random = np.random.default_rng(seed)
    axis = AXIS / np.linalg.norm(AXIS)
    one = np.cross(axis, [1.0, 0, 0])
    one /= np.linalg.norm(one)
    other = np.cross(axis, one)
    angle, height = random.uniform(*turn, count), random.uniform(-0.5, 0.5, count)
    normal = np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * other
    bump = bumps * np.sin(9 * angle) * np.cos(40 * height)
    points = CENTER + height[:, None] * LENGTH * axis
    points = points + (RADIUS + bump)[:, None] * normal
    return points + random.normal(0, noise, points.shape)


def off_by(fit):
    """Error of the radius, in its standard deviations."""
    return float(fit.cylinder.radius - RADIUS) / float(fit.std.radius)


def test_a_merged_cloud_needs_neither_a_viewpoint_nor_a_noise():
    fit = ij.fit_cylinder_to_points(stem())
    assert fit.success
    assert fit.source == "points"
    assert abs(off_by(fit)) < 3
    assert float(fit.std.radius) < 0.001
    assert "Measured in the points: noise of " in str(fit)
    assert float(fit.across.deviation) == pytest.approx(NOISE, rel=0.1)
    assert float(fit.chi2) == pytest.approx(1, abs=0.2)
    assert float(fit.std_budget["correlation"].radius) == 0


@pytest.mark.parametrize("apart", [np.pi, pytest.param(2.0, marks=FULL)])
@pytest.mark.parametrize("sigma", [None, NOISE], ids=["measured", "told"])
def test_scans_from_several_sides_err_along_their_rays(apart, sigma):
    # Of opposite ones most points face neither side: 17 deviations off, or poor.
    scans = []
    for seed, side in enumerate([2.5, 2.5 + apart]):
        points = stem(turn=(side - 1.5, side + 1.5), noise=0, seed=25 + seed)
        ray = np.mean(points, axis=0) - CENTER
        error = np.random.default_rng(seed).normal(0, NOISE, (len(points), 1))
        scans.append(points + error * ray / np.linalg.norm(ray))
    fit = ij.fit_cylinder_to_points(np.concatenate(scans), sigma=sigma)
    assert fit.success
    assert abs(off_by(fit)) < 3
    assert float(fit.std.radius) < 0.0001
    assert float(fit.across.deviation) < NOISE / (10 if apart == np.pi else 1)


def test_points_in_millimeters_get_a_hint():
    with pytest.warns(DepthUnitsWarning, match=r"noise was measured as 3.* in milli"):
        ij.fit_cylinder_to_points(1000 * stem())


@FULL
def test_one_side_with_others_points_around():
    random = np.random.default_rng(1)
    others = CENTER + random.uniform(-0.5, 0.5, (800, 3))
    points = np.concatenate([stem(1500, (0.5, 0.5 + np.pi), seed=2), others])
    fit = ij.fit_cylinder_to_points(points)
    assert fit.success
    assert abs(off_by(fit)) < 3
    assert np.mean(np.asarray(fit.region)[1500:]) < 0.1
    assert fit.region.shape == (2300,)
    told = ij.fit_cylinder_to_points(points, sigma=NOISE)
    assert told.success
    assert abs(off_by(told)) < 3


@FULL
def test_what_neighbors_share_widens_the_deviations():
    rough = ij.fit_cylinder_to_points(stem(bumps=0.006))
    assert rough.success
    assert float(rough.std_budget["correlation"].radius) > 0
    assert "correlation" in str(rough)


@pytest.mark.parametrize(
    ("count", "half"), [(3, 1.3), pytest.param(4, 1.2, marks=FULL)]
)
def test_scans_that_are_moved_aside_make_a_radius_less_sure(count, half):
    # Each sees a part of the wall, and what is left beside a fit of them all is small:
    # the radius was 5.2 and 6.3 deviations off.
    random = np.random.default_rng(104)
    scans = []
    for k in range(count):
        side = 4 + k * 2 * np.pi / count
        turn, move = (side - half, side + half), random.normal(0, 0.002, 3)
        scans.append(stem(turn=turn, noise=0.001, seed=200 + k) + move)
    fit = ij.fit_cylinder_to_points(np.concatenate(scans))
    assert fit.success
    assert abs(off_by(fit)) < 3
    assert float(fit.std.radius) < 0.002


@pytest.mark.parametrize("seed", [6, 7])
def test_chance_beyond_an_arc_is_no_wall(seed):
    # Few outliers lie near the circle beyond an arc, and have all the leverage: the
    # radius was 6 and 8 deviations off.
    around = np.random.default_rng(seed).uniform(-0.4, 0.4, (500, 3)) + CENTER
    arc = stem(turn=(0, np.pi / 2), seed=seed)
    fit = ij.fit_cylinder_to_points(np.concatenate([arc, around]))
    assert fit.success
    assert abs(off_by(fit)) < 4


def test_where_nothing_is_round_the_fit_says_so():
    line = np.linspace(0, 1, 100)[:, None] * np.array([1.0, 2.0, 3.0])
    fit = ij.fit_cylinder_to_points(line)
    assert not fit.success
    assert fit.region.shape == (100,)
    flat = np.random.default_rng(0).uniform(-1, 1, (500, 3)) * [1, 1, 0.001]
    assert not ij.fit_cylinder_to_points(flat).success


def test_a_noise_that_depends_on_the_range_needs_an_origin():
    with pytest.raises(ValueError, match="for points without an origin"):
        ij.fit_cylinder_to_points(stem(), sigma=ij.TimeOfFlight())


@FULL
def test_the_noise_of_ranges_is_measured():
    origin = np.array([1.0, -8.0, 1.5])
    points = stem(noise=0.0)
    axis = AXIS / np.linalg.norm(AXIS)
    out = points - CENTER
    out -= (out @ axis)[:, None] * axis
    faces = np.sum(out * (origin - points), axis=1) > 0
    points = points[faces]
    ray = (points - origin) / np.linalg.norm(points - origin, axis=1, keepdims=True)
    error = np.random.default_rng(2).normal(0, 0.004, (len(points), 1))
    fit = ij.fit_cylinder_to_points(points + ray * error, origin)
    assert fit.success
    assert abs(off_by(fit)) < 3
    assert float(fit.chi2) == pytest.approx(1, abs=0.2)
    assert "noise of " in str(fit)


@pytest.mark.parametrize("turn", [2 * np.pi, np.pi, 2.0])
def test_a_wall_is_found_without_a_start(turn):
    wall = wall_of(stem(turn=(0, turn)))
    assert wall is not None
    assert wall.is_known
    assert abs(wall.radius - RADIUS) < 5 * wall.deviation
    assert wall.scatter == pytest.approx(NOISE, rel=0.15)
    axis = AXIS / np.linalg.norm(AXIS)
    assert abs(wall.frame[2] @ axis) > np.cos(np.radians(1))


def rings(count, heights, noise, seed):
    """Points of a stem that a scanner at the origin sees on some rings."""
    random = np.random.default_rng(seed)
    center, radius = np.array([0.0, 10.0, 0.0]), 0.1
    side = radius * np.linspace(-0.97, 0.97, count)
    side, height = np.meshgrid(side, heights)
    depth = center[1] - np.sqrt(radius**2 - side**2)
    points = np.stack([side, depth, height], axis=-1).reshape(-1, 3)
    scale = 1 + random.normal(0, noise, (len(points), 1)) / depth.reshape(-1, 1)
    return points * scale


def test_a_ring_alone_is_no_other_wall():
    # Its points lie along the axis by noise alone, which is in their distances, too: a
    # tilted wall explained both, and the fit was of "two walls that meet".
    fit = ij.fit_cylinder_to_points(rings(400, np.linspace(-0.5, 0.5, 5), 0.002, 0))
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.1) < 3 * float(fit.std.radius)


@pytest.mark.parametrize("seed", range(3))
def test_few_rings_tell_their_noise(seed):
    # Half of them lie within .3 mm of a wall that lies, where they scatter by 10 mm:
    # the residuals were 12 times the noise measured, or points faced away.
    points = rings(26, [-0.06, 0.0, 0.06], 0.01, seed)
    fit = ij.fit_cylinder_to_points(points, np.zeros(3))
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.1) < 3 * float(fit.std.radius)
    assert 0.7 * 0.01 < float(fit.across.scale) * noise_of(fit) < 1.4 * 0.01


def noise_of(fit):
    """What a fit says that it measured, in meters."""
    told = re.search(r"noise of ([\d.]+) mm", fit.asked.measured)
    assert told is not None
    return 1e-3 * float(told[1])


@pytest.mark.parametrize(
    "told",
    [
        pytest.param("sigma", marks=FULL),
        pytest.param("origin", marks=FULL),
        "nothing",
    ],
)
def test_two_rings_are_of_the_pipe_or_ambiguous(told):
    # A wall across it touches their planes: a success with an axis 90 degrees off.
    told = {"sigma": {"sigma": 0.002}, "origin": {"origin": np.zeros(3)}}.get(told, {})
    ends = []
    for seed in range(3):
        points = rings(60, [-0.25, 0.25], 0.002, seed)
        fit = ij.fit_cylinder_to_points(points, **told)
        ends.append(fit.status)
        if not fit.success:
            assert fit.status is ij.FitStatus.AMBIGUOUS
            assert "origin tells them apart" in fit.reason
            continue
        assert abs(float(fit.cylinder.radius) - 0.1) < 4 * float(fit.std.radius)
        assert abs(fit.cylinder.axis[2]) > 0.99
    if "origin" in told:
        assert set(ends) == {ij.FitStatus.CONVERGED}


def test_too_few_points_near_a_wall_end_in_a_status():
    # It raised of a depth and a mask, of which a call with points has none.
    for seed in range(5):
        points = rings(18, [-0.1, 0.0, 0.1], 0.01, seed)
        fit = ij.fit_cylinder_to_points(points)
        assert fit.region.shape == (54,)


NEARBY = np.linspace(-1.0, 1.0, 6)


def scanned(drift, seed, sides=NEARBY, count=300):
    """Points with the places that they were seen from, whose poses err."""
    random = np.random.default_rng(seed)
    scans = []
    for side in sides:
        turn = side - 1.0, side + 1.0
        points = stem(count, turn, noise=0, seed=random.integers(99))
        ray = points.mean(axis=0) - CENTER
        start = CENTER + 5 * ray / np.linalg.norm(ray)
        view = points - start
        view /= np.linalg.norm(view, axis=1, keepdims=True)
        points = points + random.normal(0, NOISE, (len(points), 1)) * view
        points = points + random.normal(0, drift, 3)
        scans.append(np.hstack([points, np.broadcast_to(start, points.shape)]))
    return np.concatenate(scans)


@FULL
def test_places_that_disagree_widen_deviations():
    # Of scanners that move and drift, 7 of 16 radii were up to 12 deviations off.
    exact, drifts = (
        ij.fit_cylinder_to_points(scanned(drift, 2), sigma=NOISE)
        for drift in (0.0, 0.001)
    )
    assert abs(off_by(exact)) < 3
    assert "disagree" not in exact.reason
    assert abs(off_by(drifts)) < 3
    assert "different places disagree by" in drifts.reason
    assert float(drifts.std.radius) > 3 * float(exact.std.radius)
    root = np.sqrt(np.diagonal(drifts.covariance))
    np.testing.assert_allclose(root[5], drifts.std.radius, rtol=1e-5)


@RELEASE
def test_scans_that_are_aligned_to_a_few_millimeters_are_fitted_and_found():
    # With places given none was fitted, a poor fit; found without them, radii were up
    # to 30 deviations off.
    cloud = scanned(0.003, 3, (0.0, 2.1, 4.2), 3000)
    fit = ij.fit_cylinder_to_points(cloud)
    assert fit.success
    (found,) = ij.find_cylinders_in_points(cloud[:, :3], cloud[:, 3:]).fits
    for one in (fit, found):
        assert "different places disagree by" in one.reason
        assert abs(off_by(one)) < 3
        assert 0.0005 < float(one.std.radius) < 0.01


@pytest.mark.parametrize("away", [0.0, pytest.param(2.0, marks=FULL)])
def test_exact_points_are_fitted_wherever_they_are(away):
    # Two rings of a model; 2 m away single precision rounded them by all their noise,
    # which was an error, and near by the center was 10 deviations off.
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    ring = 0.01 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    rings = np.concatenate([ring, ring + np.array([0, 0, 0.05])])
    middle = np.array([0.3, 0.6, 0.7]) * away
    fit = ij.fit_cylinder_to_points(rings + middle)
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.01) < 3 * float(fit.std.radius) < 1e-6


@pytest.mark.parametrize("origin", [None, (-5.0, -2.0, 1.5)], ids=["none", "origin"])
def test_a_noise_that_is_less_than_was_told_is_measured(origin):
    # Told ten times too large it drew the radius in by 7 deviations.
    points = stem(turn=(1.0, 1.0 + np.pi)) if origin is None else stem_from(origin)
    fit = ij.fit_cylinder_to_points(points, origin, 10 * NOISE)
    assert fit.success
    assert abs(off_by(fit)) < 3
    assert float(fit.std.radius) < 0.001
    assert re.search(
        r"Readings scatter by 0\.\d+ of sigma. Measured in the p", str(fit)
    )
    kept = ij.fit_cylinder_to_points(points, origin, 10 * NOISE, scale="fixed")
    assert "Measured" not in str(kept)


def stem_from(origin):
    """Points of the half that is seen from a place, which err along its rays."""
    points = stem(noise=0)
    points = points[(points - CENTER)[:, :2] @ (np.array(origin) - CENTER)[:2] > 0.003]
    ray = points - origin
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    return points + np.random.default_rng(5).normal(0, NOISE, (len(points), 1)) * ray
