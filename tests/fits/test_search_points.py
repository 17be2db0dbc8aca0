"""Every cylinder of a cloud, with labels for its points."""

import jax
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fits import search_points
from tests.clouds.scenes import floor, wall
from tests.groups import FULL, OF_POINTS, RELEASE
from tests.schemas import validator

pytestmark = OF_POINTS

ORIGIN = np.array([0.0, 4.0, 0.5])
NOISE = 0.002
ARC = (-1.3, 1.3)
PIPES = [((0, 0, 0.5), (1, 0, 0), 0.06, 2.0), ((0.6, 0.6, 0.8), (0, 0, 1), 0.1, 1.6)]


@pytest.fixture(scope="module")
def cloud():
    """Two pipes over a floor, as they are seen from one place; and which is whose."""
    rng = np.random.default_rng(0)
    parts = [wall(rng, 3000, *pipe, ARC) for pipe in PIPES]
    parts.append(floor(rng, 8000, 3.0))
    points = np.concatenate(parts)
    rays = points - ORIGIN
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    owner = np.repeat([1, 2, 0], [3000, 3000, 8000])
    return points + rng.normal(0, NOISE, (len(points), 1)) * rays, owner


@pytest.fixture(scope="module")
def found(cloud):
    return ij.find_cylinders_in_points(cloud[0], ORIGIN)


def check(found, owner, shift=(0, 0, 0)):
    assert len(found) == 2
    for fit, label in zip(found.fits, (1, 2), strict=True):
        own = found.labels == label
        number = np.bincount(owner[own]).argmax()
        center, axis, radius, length = PIPES[number - 1]
        assert np.mean(owner[own] == number) > 0.99
        assert own.sum() > 2900
        assert fit.success
        off = abs(float(fit.cylinder.radius) - radius)
        assert off < 4 * float(fit.std.radius)
        assert abs(np.asarray(fit.cylinder.axis) @ axis) > 1 - 1e-5
        away = np.asarray(fit.cylinder.center) - np.asarray(shift) - center
        across = np.linalg.norm(np.cross(away, axis))
        assert across < 5 * float(np.max(fit.std.across_axis))
        assert float(fit.cylinder.height) == pytest.approx(length, rel=0.03)


@FULL
def test_pipes_are_found_with_their_points_and_the_floor_is_taken(cloud, found):
    check(found, cloud[1])
    assert found.confidence.min() > 0.9
    assert not found.inside.any()
    # As much of the wall as was drawn.
    assert found.visible == pytest.approx((ARC[1] - ARC[0]) / (2 * np.pi), rel=0.2)
    np.testing.assert_array_equal(found.masks[0], found.labels == 1)
    assert found.planes.batch_shape == (1,)
    assert float(found.planes.unit_normal[0, 2]) == pytest.approx(1, abs=1e-3)
    assert found.fits[0].region.shape == (np.count_nonzero(found.labels == 1),)
    text = str(found)
    assert text.startswith("2 found, 1 planes taken away\n  1: radius ")


def test_the_record_is_of_the_schema(found):
    from impostor_jax.io.record import found_in_points_record

    record = found_in_points_record(found, 1.0)
    validator("found").validate(record)
    assert record["cloud"] == {"points": 14000, "searched": 14000}
    assert record["cylinders"][0]["num_points"] > 2900


@FULL
def test_far_coordinates_and_an_origin_for_each_point_change_nothing(cloud, found):
    points, owner = cloud
    shift = np.array([5.0e5, 5.4e6, 300.0])
    origins = np.broadcast_to(ORIGIN + shift, points.shape)
    both = np.concatenate([points + shift, origins], axis=1)
    far = ij.find_cylinders_in_points(both)
    check(far, owner, shift)
    np.testing.assert_array_equal(far.labels, found.labels)
    radii = [[float(fit.cylinder.radius) for fit in one] for one in (far, found)]
    np.testing.assert_allclose(*radii, atol=1e-5)


@FULL
def test_a_viewpoint_need_not_be_known(cloud):
    points, owner = cloud
    check(ij.find_cylinders_in_points(points, sigma=NOISE), owner)


@RELEASE
def test_what_large_voxels_took_for_one_wall_is_found_by_smaller_ones(monkeypatch):
    # A wall around several pipes of a rack was refused, and their points were lost.
    monkeypatch.setattr(search_points, "MOST_POINTS", 6000)
    rng = np.random.default_rng(0)
    radii = [0.05, 0.06, 0.07, 0.05, 0.06, 0.07]
    places = [((0, 0.2 * (k % 2), 0.5 + 0.3 * k), (1, 0, 0)) for k in range(6)]
    parts = [
        wall(rng, 1500, *place, radius, 3.0, ARC, NOISE)
        for place, radius in zip(places, radii, strict=True)
    ]
    points = np.concatenate([*parts, floor(rng, 60_000, 4.0)])
    found = ij.find_cylinders_in_points(points)
    assert found.num_searched < 6000
    sizes = sorted(float(fit.cylinder.radius) for fit in found.fits)
    assert sizes == pytest.approx(sorted(radii), abs=5e-4)


@FULL
def test_normals_and_a_range_of_radii_are_taken(cloud):
    points, owner = cloud
    normals = np.zeros_like(points)
    for number, (center, axis, *_) in enumerate(PIPES, start=1):
        about = points - np.asarray(center, float)
        out = about - np.outer(about @ axis, axis)
        normals[owner == number] = -2 * out[owner == number]
    normals[owner == 0] = (0, 0, 1)
    # Of some other programs know none.
    normals[::40], normals[20::40] = 0, np.nan
    found = ij.find_cylinders_in_points(
        points, ORIGIN, normals=normals, radius_range=(0.08, 0.2)
    )
    (fit,) = found.fits
    assert float(fit.cylinder.radius) == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize(("num_rings", "is_said"), [(10, True), (100, False)])
def test_lines_of_a_scan_that_are_too_far_apart_are_told(num_rings, is_said):
    # Nothing is found on rings a radius apart, and nothing said why.
    side, slope = np.linspace(-1.2, 1.2, 60), np.linspace(0, 0.3, num_rings)
    angle, slope = np.meshgrid(side, slope)
    x, y = 0.1 * np.sin(angle), 3 - 0.1 * np.cos(angle)
    points = np.stack([x, y, slope * np.hypot(x, y)], axis=-1).reshape(-1, 3)
    points *= 1 + np.random.default_rng(0).normal(0, 0.001, (len(points), 1))
    found = ij.find_cylinders_in_points(points, np.zeros(3))
    assert len(found) == (0 if is_said else 1)
    assert ("lines of a scan that are too far apart" in str(found)) is is_said
    assert (found.on_lines > 0.6) is is_said


def test_a_floor_alone_holds_nothing(cloud):
    points, owner = cloud
    found = ij.find_cylinders_in_points(points[owner == 0], ORIGIN)
    assert len(found) == 0
    assert not found.labels.any()
    assert found.masks.shape == (0, 8000)
    assert found.cylinders.batch_shape == (0,)
    assert found.to_dict()["cylinders"] == []


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"points": np.zeros((10, 3))}, "points must be at least 50, got 10"),
        ({"normals": np.ones((3, 3))}, "normals must be .14000, 3."),
        ({"normals": np.zeros((14000, 3))}, "normals must have a direction"),
        ({"radius_range": (1.0, 0.1)}, "radius_range must be the smaller"),
        ({"min_points": 0}, "min_points"),
        ({"min_arc": -1.0}, "min_arc"),
        ({"origin": (0, 0)}, r"origin must be \(3,\), or \(14000, 3\)"),
        ({"sigma": ij.StructuredLight.sensor()}, "noise model of single readings"),
        ({"effort": "quick"}, "effort must be"),
    ],
)
def test_bad_arguments_are_named(cloud, given, message):
    with pytest.raises(ValueError, match=message):
        ij.find_cylinders_in_points(**({"points": cloud[0]} | given))


def test_traced_points_are_refused(cloud):
    with pytest.raises(ValueError, match="must be concrete"):
        jax.jit(ij.find_cylinders_in_points)(cloud[0])


@FULL
@pytest.mark.parametrize("share", [pytest.param(0.3, marks=RELEASE), 0.7])
def test_a_pipe_is_fitted_among_more_points_of_something_else(cloud, share):
    rng = np.random.default_rng(5)
    pipe = cloud[0][cloud[1] == 2]
    others = rng.uniform(
        (-1.2, -1.5, -0.3), (0.4, 0.9, 1.9), (int(3000 * share / (1 - share)), 3)
    )
    fit = ij.fit_cylinder_to_points(np.concatenate([pipe, others]), ORIGIN, sigma=NOISE)
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.1) < 4 * float(fit.std.radius)
    assert fit.region.shape == (len(pipe) + len(others),)
    assert np.count_nonzero(fit.region[3000:]) < 0.1 * len(others)


LINE = np.linspace(0, 1, 400)[:, None] * [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    "points",
    [np.ones((100, 3)), np.repeat([[0.0, 0, 0], [1, 1, 1]], 100, axis=0), LINE],
    ids=["one place", "two places", "a line"],
)
@pytest.mark.parametrize("origin", [None, (5.0, 0.0, 0.0)])
def test_points_of_nothing_are_no_cylinder(points, origin):
    assert len(ij.find_cylinders_in_points(points, origin)) == 0
    assert ij.fit_cylinder_to_points(points, origin).status == "no_first_guess"


@FULL
def test_points_that_are_there_twice_change_nothing(cloud, found):
    twice = ij.find_cylinders_in_points(np.concatenate([cloud[0]] * 2), ORIGIN)
    assert len(twice) == 2
    np.testing.assert_array_equal(twice.labels[:14000], twice.labels[14000:])
    assert np.mean(twice.labels[:14000] == found.labels) > 0.99


@FULL
def test_points_without_noise_may_lie_far_off():
    rng = np.random.default_rng(6)
    shift = np.array([5e5, 5e6, 0.0])
    points = wall(rng, 2000, (0, 0, 0), (0, 0, 1), 0.1, 1.0, (-1.0, 1.0)) + shift
    fit = ij.fit_cylinder_to_points(points)
    assert fit.success
    assert float(fit.cylinder.radius) == pytest.approx(0.1, abs=1e-6)
