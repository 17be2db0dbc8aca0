"""Fits without a mask: which pixels are taken."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find.planes import planes_of
from impostor_jax.find.view import view_of
from impostor_jax.fit import border
from impostor_jax.fit.regions import DepthUnitsWarning
from impostor_jax.fits import shown
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of
from tests.fit.test_box import CARTON
from tests.fit.test_frustum import cup
from tests.fit.test_sphere import ball
from tests.fit.test_tube import INNER, pipe
from tests.groups import FULL, RELEASE, SMALL_IMAGES

pytestmark = SMALL_IMAGES

WALL = np.full((CAMERA.height, CAMERA.width), 0.6, np.float32)


def moved(shape, offset):
    """The same shape elsewhere."""
    return shape.transformed(ij.RigidTransform(np.eye(3), np.asarray(offset)))


def beside(*shapes):
    """Noisy image of shapes in front of a wall, and the mask of each."""
    seen = [image_of(shape, seed=k) for k, shape in enumerate(shapes)]
    depth = np.min([depth for depth, _ in seen], axis=0)
    return depth, [mask & (depth == own) for own, mask in seen]


def upper_side():
    """Normal of a face of the carton that the camera sees; on the other it stands."""
    normal = np.asarray(CARTON.rotation)[:, 1]
    return normal if normal @ np.asarray(CARTON.center) < 0 else -normal


def test_the_surest_cylinder_is_fitted():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, sigma=SIGMA)
    assert fit.success
    region = np.asarray(fit.region)
    assert np.count_nonzero(region & mask) > 0.95 * np.count_nonzero(region)
    assert abs(float(fit.cylinder.radius) - 0.04) < 4 * float(fit.std.radius)
    # An image without a cylinder fails alone.
    several = ij.fit_cylinders(np.stack([depth, WALL, 0 * WALL]), CAMERA, sigma=SIGMA)
    assert np.asarray(several.success).tolist() == [True, False, False]
    np.testing.assert_array_equal(several.region[0], region)
    assert not np.asarray(several.region[1:]).any()


def test_a_silo_is_looked_for_where_the_camera_stands_far_off():
    depth, _ = image()
    fit = ij.fit_cylinder(100 * depth, CAMERA, sigma=100 * SIGMA)
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 4) < 4 * float(fit.std.radius)


@pytest.mark.parametrize("on_table", [True, False], ids=["on a table", "in the air"])
def test_a_box_stands_out_of_planes_that_go_on_beyond_the_image(on_table):
    # Its own faces are planes, too.
    depth, mask = image_of(CARTON)
    normal = upper_side()
    if on_table:
        foot = np.asarray(CARTON.center) - normal * float(CARTON.size[1]) / 2
        table = ij.render(ij.Plane(foot, normal), CAMERA, outputs=("depth",)).depth
        noise = np.random.default_rng(1).normal(0, SIGMA, depth.shape)
        depth = np.where(mask, depth, np.minimum(depth, np.asarray(table) + noise))
    fit = ij.fit_box(depth.astype(np.float32), CAMERA, sigma=SIGMA)
    assert fit.success
    region = np.asarray(fit.region)
    # All but some beside the table.
    assert np.count_nonzero(region & mask) > 0.9 * np.count_nonzero(region | mask)
    # Where it stands on a table may be open.
    size, std = (
        np.asarray(x.size)[np.argsort(fit.box.size)] for x in (fit.box, fit.std)
    )
    known = np.isfinite(std)
    assert np.count_nonzero(known) >= 2
    assert np.all(np.abs(size - [0.04, 0.06, 0.1])[known] < 4 * std[known])


def test_a_tube_is_found_with_what_is_seen_in_its_bore():
    # Its rim parts the two.
    depth, mask = image_of(pipe())
    fit = ij.fit_tube(depth, CAMERA, sigma=SIGMA)
    assert fit.success
    assert abs(float(fit.tube.inner_radius) - INNER) < 4 * float(fit.std.inner_radius)
    region = np.asarray(fit.region)
    assert np.count_nonzero(region & mask) > 0.9 * np.count_nonzero(region | mask)


def test_what_lies_in_the_hull_of_a_thing_is_seen_in_its_bore():
    labels = np.zeros((40, 40), int)
    # Like a horseshoe; what it holds, half of it outside; and what stands beside.
    labels[5:20, 5:20] = 1
    labels[10:25, 9:16] = 0
    labels[12:30, 10:15] = 2
    labels[21:30, 25:35] = 3
    found = shown._with_what_is_within(labels)
    np.testing.assert_array_equal(found == 1, (labels == 1) | (labels == 2))
    np.testing.assert_array_equal(found == 3, labels == 3)


def test_what_something_stands_on_is_no_face_of_it():
    """A table that is seen as a whole is a box, too, and the larger one."""
    normal = upper_side()
    foot = np.asarray(CARTON.center) - normal * (float(CARTON.size[1]) / 2 + 0.01)
    table = ij.Box(foot, CARTON.rotation, (0.16, 0.02, 0.18))
    # Planes are made of cells of 8 x 8 pixels.
    camera = ij.PinholeCamera(900.0, 900.0, 479.5, 359.5, 960, 720)
    parts = [
        np.asarray(ij.render(shape, camera, outputs=("depth",)).depth)
        for shape in (CARTON, table)
    ]
    depth = np.min([*parts, np.full(parts[0].shape, 0.6)], axis=0)
    mask, around = (depth == part for part in parts)
    noise = np.random.default_rng(0).normal(0, SIGMA, depth.shape)
    noisy = (depth + noise).astype(np.float32)
    view = view_of(noisy, camera, ij.ConstantNoise(SIGMA), depth.size)
    planes = planes_of(view, view.valid)
    found = np.isin(planes.labels, shown._surroundings(view, planes, 1.0))
    # The table's upper side, and the wall behind.
    assert np.mean(found[around]) > 0.6
    assert np.mean(found[~mask & ~around]) > 0.8
    assert np.mean(planes.labels[mask] > 0) > 0.5
    assert np.mean(found[mask]) < 0.1


def test_a_quick_fit_cuts_down_what_it_has_found():
    depth, _ = image()
    fit = ij.fit_cylinder(depth, CAMERA, sigma=SIGMA, effort="fast")
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.04) < 4 * float(fit.std.radius)


@pytest.mark.parametrize("fit", [ij.fit_cylinder, ij.fit_frustum, ij.fit_sphere])
def test_a_wall_shows_no_object(fit):
    found = fit(WALL, CAMERA, sigma=SIGMA)
    assert found.status is ij.FitStatus.NO_FIRST_GUESS
    assert not np.asarray(found.region).any()
    assert ("150 pixels" in found.reason) == (fit is ij.fit_cylinder)


@pytest.mark.parametrize(
    ("fit", "shape"),
    [
        (ij.fit_sphere, ball()),
        (ij.fit_frustum, cup()),
    ],
)
@RELEASE
def test_the_object_of_the_shape_is_fitted_though_another_is_nearer(fit, shape):
    plate = ij.Box((-0.1, -0.06, 0.25), np.eye(3), (0.04, 0.06, 0.02))
    depth, (mask, other) = beside(shape, plate)
    assert np.count_nonzero(other) > 300
    found = fit(depth, CAMERA, sigma=SIGMA)
    assert found.success
    region = np.asarray(found.region)
    assert np.count_nonzero(region & mask) > 0.95 * np.count_nonzero(region | mask)


def test_what_reads_near_a_start_is_fitted():
    second = moved(can(), (0.0, 0.0, 0.15))
    depth, (mask, _) = beside(can(), moved(can(90.0), (-0.13, -0.07, 0.05)))
    near = ij.Cylinder(can().center, can().axis, 0.042, 0.125)
    found = ij.fit_cylinder(depth, CAMERA, sigma=SIGMA, initial=near)
    assert found.success
    region = np.asarray(found.region)
    assert np.count_nonzero(region & mask) > 0.97 * np.count_nonzero(region | mask)
    # The silhouette of a start behind it is covered by what is nearer.
    found = ij.fit_cylinder(depth, CAMERA, sigma=SIGMA, initial=second)
    assert found.status is ij.FitStatus.NO_FIRST_GUESS


@RELEASE
def test_a_traced_start_without_a_mask_takes_what_it_covers():
    depth, mask = image()
    fit = jax.jit(lambda d: ij.fit_cylinder(d, CAMERA, sigma=SIGMA, initial=can()))
    np.testing.assert_array_equal(fit(jnp.asarray(depth)).region, mask)


def test_millimeters_in_which_nothing_is_found_get_a_hint():
    wall = WALL + np.random.default_rng(0).normal(0, SIGMA, WALL.shape)
    with pytest.warns(DepthUnitsWarning, match="is it in millimeters"):
        found = ij.fit_sphere(1000 * wall, CAMERA, sigma=SIGMA)
    assert not found.success


def test_bad_arguments_are_refused_before_a_search(monkeypatch):
    def unexpected(*_, **__):
        raise AssertionError

    monkeypatch.setattr(shown, "find_cylinders", unexpected)
    for options, message in (
        ({"prior": {"size": (1, 1)}}, "prior must be one of"),
        ({"fixed": ("radius",)}, "initial must be given with fixed"),
        ({"sigma": -1.0}, "sigma must be a positive number"),
    ):
        with pytest.raises(ValueError, match=message):
            ij.fit_cylinder(WALL, CAMERA, **options)
    with pytest.raises(ValueError, match="at least 50 readings"):
        ij.fit_cylinder(0 * WALL, CAMERA)
    with pytest.raises(ValueError, match="negative"):
        ij.fit_cylinder(-WALL, CAMERA)


def test_a_search_knows_the_radius_and_the_effort(monkeypatch):
    calls = []
    real = shown.find_cylinders

    def noted(*arguments, **options):
        calls.append(options)
        return real(*arguments, **options)

    monkeypatch.setattr(shown, "find_cylinders", noted)
    prior = {"radius": (0.04, 0.001), "height": (0.12, 0.001)}
    ij.fit_cylinder(WALL, CAMERA, sigma=SIGMA, prior=prior, effort="fast")
    (given,) = calls
    assert given["prior"] == {"radius": (0.04, 0.001)}
    assert given["effort"].readings == 1024


def bottle():
    """Depth with noise and the mask of a body and its shoulder, and the body."""
    axis = np.array([0.52, 0.69, 0.5])
    at = np.array([0.0, 0.0, 0.35])
    body = ij.Cylinder(at - 0.03 * axis, axis, 0.035, 0.07)
    shoulder = ij.Frustum(at + 0.005 * axis, at + 0.06 * axis, 0.035, 0.008)
    depth, masks = beside(body, shoulder)
    return depth, np.any(masks, axis=0), body


@pytest.mark.parametrize("sigma", [SIGMA, pytest.param(None, marks=FULL)])
def test_of_the_mask_of_a_bottle_its_body_is_fitted(sigma):
    depth, mask, body = bottle()
    fit = ij.fit_cylinder(depth, CAMERA, mask, sigma)
    assert fit.success
    assert "of the region is of the cylinder, and the rest was left out" in fit.reason
    assert abs(float(fit.cylinder.radius - body.radius)) < 3 * float(fit.std.radius)
    region = np.asarray(fit.region)
    assert 0.4 < np.count_nonzero(region) / np.count_nonzero(mask) < 0.95
    assert not np.any(region & ~mask)


def tries_of(monkeypatch):
    """How fits of a region are asked for from now on, beside their requests."""
    tried, fit_shape = [], shown.fit_shape

    def noted(request, **also):
        tried.append(also)
        return fit_shape(request, **also)

    monkeypatch.setattr(shown, "fit_shape", noted)
    return tried


def test_a_mask_of_a_large_object_is_searched_first(monkeypatch):
    depth, mask, _ = bottle()
    monkeypatch.setattr(border, "MANY", 100)
    tried = tries_of(monkeypatch)
    assert ij.fit_cylinder(depth, CAMERA, mask, SIGMA).success
    assert tried == [{"is_trial": True}, {}]


@RELEASE
def test_a_trial_that_ended_early_is_no_answer(monkeypatch):
    # Of few readings that are taken the others count, too.
    depth, mask, _ = bottle()
    monkeypatch.setattr(border, "MANY", 1000)
    monkeypatch.setattr(shown, "MANY", 1000)
    monkeypatch.setattr(shown, "_fit_within", lambda *_: None)
    tried = tries_of(monkeypatch)
    ij.fit_cylinder(depth, CAMERA, mask, SIGMA, effort=ij.Effort(readings=500))
    assert tried == [{"is_trial": True}, {}]


@pytest.mark.parametrize("option", ["start", "fast", "outline"])
def test_only_what_is_asked_of_the_region_is_searched(option, monkeypatch):
    depth, mask, body = bottle()
    monkeypatch.setattr(shown, "_fit_within", None)
    options = {
        "start": {"initial": body},
        "fast": {"effort": "fast"},
        "outline": {"mask_meaning": "outline"},
    }
    ij.fit_cylinder(depth, CAMERA, mask, SIGMA, **options[option])
