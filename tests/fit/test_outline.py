"""Fits to a silhouette alone."""

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.compiling import quickly_compiled
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.fittable import KINDS
from impostor_jax.fit.outline import _to_end
from impostor_jax.fit.outline_solve import rays_through, traced
from impostor_jax.fit.silhouette import coverage_of
from tests.cases import pose
from tests.checks import angle_between
from tests.fit.scenes import CAMERA, camera_with, can
from tests.groups import FULL, RELEASE, SMALL_IMAGES
from tests.schemas import validator

pytestmark = [SMALL_IMAGES, FULL]

RADIUS = {"radius": (0.04, 0.0001)}
NOISE = 0.05
LIDAR = ij.SphericalCamera(np.linspace(0.3, -0.3, 120), np.linspace(-0.4, 0.4, 160))


def mask_of(shape, camera=CAMERA):
    return np.array(ij.render(shape, camera, outputs=("mask",)).mask)


def matte_of(shape, seed=0):
    exact = np.asarray(ij.coverage(shape, CAMERA))
    noise = np.random.default_rng(seed).normal(0, NOISE, exact.shape)
    return np.clip(exact + noise, 0, 1).astype(np.float32)


def fit_to(mask, fit=ij.fit_cylinder, camera=CAMERA, **asked):
    """Of masks that tell of centers exactly, and mattes whose noise is known."""
    is_matte = isinstance(mask, np.ndarray) and np.any(mask % 1)
    sigma = NOISE if is_matte else 0.0
    asked = {"prior": RADIUS, "mask_meaning": "outline", "sigma": sigma} | asked
    return fit(None, camera, mask, **asked)


def assert_close(fit, truth, most=4.0):
    """Within so many standard deviations in all that is told."""
    assert fit.status is ij.FitStatus.CONVERGED
    off = np.asarray(fit.cylinder.center - truth.center)
    assert (np.abs(off) < most * np.asarray(fit.std.center)).all()
    turn = np.radians(angle_between(fit.cylinder.axis, truth.axis))
    assert turn < most * np.linalg.norm(fit.std.axis)
    assert abs(float(fit.cylinder.height - truth.height)) < most * fit.std.height


@pytest.mark.parametrize("degrees", [40, 60, 88])
def test_a_matte_tells_the_pose_as_far_as_it_says(degrees):
    truth = can(degrees)
    fit = fit_to(matte_of(truth))
    assert_close(fit, truth)
    assert fit.ends_seen.all()
    assert np.isfinite(fit.covariance).all()
    # The distance is known as the radius is, to 0.25 %.
    assert float(fit.std.center[2]) == pytest.approx(0.0025 * 0.35, rel=0.1)
    assert float(jnp.linalg.norm(fit.std.axis)) < np.radians(0.5)
    outline, prior = fit.std_budget["outline"], fit.std_budget["prior"]
    assert float(outline.radius) < 0.1 * float(prior.radius)
    assert float(jnp.max(prior.axis)) < 0.1 * float(jnp.max(outline.axis))
    assert 0.5 < float(fit.chi2) < 1.2


@pytest.mark.parametrize("degrees", [40, 60, 88])
def test_a_mask_tells_it_to_parts_of_a_pixel(degrees):
    truth = can(degrees)
    fit = fit_to(mask_of(truth))
    assert_close(fit, truth)
    assert float(fit.chi2) < 1.2


@pytest.mark.parametrize("change", [cv2.dilate, cv2.erode])
def test_a_mask_that_is_a_pixel_too_large_or_small_is_within_what_is_said(change):
    truth = can(60)
    mask = change(mask_of(truth).astype(np.uint8), np.ones((3, 3))) > 0
    fit = fit_to(mask, sigma=None)
    assert_close(fit, truth, most=3)
    # Of 34 pixels across, half a pixel on both sides, and on each side by itself.
    width = 0.5 * np.hypot(2, np.sqrt(2))
    assert float(fit.std.center[2]) == pytest.approx(0.35 * width / 34, rel=0.25)
    with pytest.raises(AssertionError):
        assert_close(fit_to(mask), truth)


def test_a_small_mask_tells_the_shape_though_its_edge_may_be_off():
    small = ij.Cylinder((0.0, 0.0, 0.5), (0.2, 0.9, 0.3), 0.04, 0.16)
    fit = fit_to(mask_of(small), sigma=None)
    # The distance by more than half a radius.
    assert float(fit.std.center[2]) > 0.02
    assert float(fit.std_budget["scale"].center[2]) > 0.02
    assert_close(fit, small)


def test_an_edge_that_errs_in_places_is_told_by_sigma():
    truth = can(60)
    # Drawn at a quarter of the resolution, as by some networks.
    small = cv2.resize(
        np.float32(mask_of(truth)), None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA
    )
    mask = np.kron(small > 0.5, np.ones((4, 4))) > 0
    refused = fit_to(mask, sigma=None)
    assert refused.status is ij.FitStatus.POOR_FIT
    assert "off by more than sigma says, in pixels" in refused.reason
    assert_close(fit_to(mask, sigma=1.0), truth, most=3)


def test_an_edge_along_the_grid_is_known_to_a_pixel():
    upright = ij.Cylinder((0.0, 0.0, 0.35), (0.0, 1.0, 0.0), 0.04, 0.12)
    fit = fit_to(mask_of(upright), prior={"radius": (0.04, 1e-6)})
    # Each side of the wall errs by 1 / sqrt(12) pixels, all of its rows alike.
    pixel = 0.35 / 150
    across = float(fit.std.center[0])
    assert across == pytest.approx(pixel / np.sqrt(24), rel=0.2)
    turned = ij.Cylinder((0.0, 0.0, 0.35), (0.35, 0.94, 0.0), 0.04, 0.12)
    tilted = fit_to(mask_of(turned), prior={"radius": (0.04, 1e-6)})
    assert float(tilted.std.across_axis.max()) < 0.5 * across


@pytest.mark.parametrize("sigma", [None, 0.0])
def test_a_distance_is_known_as_well_as_the_radius_that_tells_it(sigma):
    # Of a ball of 9 pixels a radius that is known to 5 % tells it to 16 mm: more than
    # half a radius, which was taken for nothing.
    ball = ij.Sphere((0.03, 0.02, 0.33), 0.02)
    mask = mask_of(ball)
    for seed in range(3):
        believed = 0.02 * (1 + 0.05 * np.random.default_rng(seed).normal())
        prior = {"radius": (believed, 0.001)}
        fit = fit_to(mask, ij.fit_sphere, prior=prior, sigma=sigma)
        assert fit.status is ij.FitStatus.CONVERGED
        off = np.asarray(fit.sphere.center) - np.asarray(ball.center)
        assert np.all(np.abs(off) < 4 * np.asarray(fit.std.center))
        assert fit.std.center[2] > 0.012


def test_without_a_length_all_but_the_scale_is_told():
    truth = can()
    fit = fit_to(matte_of(truth), prior=None)
    assert fit.status is ij.FitStatus.UNDETERMINED
    assert not fit.success
    assert np.isinf(fit.std.radius)
    assert np.isinf(fit.std.height)
    assert np.isinf(fit.std.center).all()
    assert float(jnp.max(fit.std.axis)) < np.radians(0.5)
    assert angle_between(fit.cylinder.axis, truth.axis) < 1
    slender = float(fit.cylinder.height / fit.cylinder.radius)
    assert slender == pytest.approx(3, rel=0.02)


@pytest.mark.parametrize(
    "known",
    [
        {"prior": {"height": (0.12, 0.0003)}},
        {"prior": {"center": ((0.01, 0.005, 0.35), 0.001)}},
        {"fixed": ("radius",), "initial": True, "prior": None},
    ],
    ids=["height", "distance", "a radius that is held"],
)
def test_any_known_length_tells_the_scale(known):
    truth = can()
    if "initial" in known:
        known = known | {
            "initial": ij.Cylinder((0.0, 0.0, 0.36), (0.5, 0.7, 0.4), 0.04, 0.1)
        }
    fit = fit_to(matte_of(truth), **known)
    assert_close(fit, truth)
    assert float(fit.cylinder.radius) == pytest.approx(0.04, rel=0.02)


def disc():
    return mask_of(ij.Sphere((0.02, 0.0, 0.35), 0.04))


def corner():
    mask = np.zeros((120, 160), bool)
    mask[30:90, 50:65] = mask[75:90, 50:110] = True
    return mask


def star():
    angle = np.arange(10) * np.pi / 5
    radius = np.where(np.arange(10) % 2, 13, 29)
    points = np.stack([80 + radius * np.cos(angle), 60 + radius * np.sin(angle)])
    blank = np.zeros((120, 160), np.uint8)
    return cv2.fillPoly(blank, [points.T.round().astype(np.int32)], 1) > 0


@pytest.mark.parametrize("make", [disc, corner, star])
def test_what_is_no_silhouette_of_a_cylinder_is_no_success(make):
    fit = fit_to(make())
    assert not fit.success
    assert fit.status in (ij.FitStatus.POOR_FIT, ij.FitStatus.UNDETERMINED)


def test_a_fit_says_that_it_is_of_an_outline():
    fit = fit_to(mask_of(can()))
    assert fit.source == "outline"
    assert "Of an outline: scale and distance" in str(fit)
    record = fit.to_dict()
    assert record["source"] == "outline"
    validator("fit").validate(record)
    assert fit.asked.arguments["depth"] is None
    for use in (ij.view, ij.test_taper, ij.test_bore):
        with pytest.raises(ValueError, match="got a fit to an outline"):
            use(fit)


def test_an_image_of_another_size_from_elsewhere_is_fitted_by_the_same_programs():
    mask = mask_of(can())
    fit_to(mask)
    programs = [
        quickly_compiled(traced, static_argnames="to_end").programs,
        quickly_compiled(_to_end).programs,
    ]
    before = [len(one) for one in programs]
    camera = ij.PinholeCamera(
        150.0, 150.0, 79.5, 59.5, width=200, height=130, camera_from_world=pose()
    )
    fit = fit_to(np.pad(mask, ((0, 10), (0, 40))), camera=camera)
    np.testing.assert_allclose(
        np.asarray(fit.pose_in_camera)[:3, 3], can().center, atol=2e-3
    )
    assert fit.inliers.shape == (130, 200)
    assert [len(one) for one in programs] == before


def test_labels_are_fitted_one_by_one():
    labels = np.where(mask_of(can()), 7, 0)
    fits = ij.fit_labels(None, CAMERA, labels, prior=RADIUS, mask_meaning="outline")
    assert_close(fits[7], can())


def test_a_sigma_that_is_too_small_is_a_poor_fit():
    fit = fit_to(matte_of(can()), sigma=0.01)
    assert fit.status is ij.FitStatus.POOR_FIT
    assert "times the noise given" in fit.reason


def test_a_matte_that_is_blurred_needs_a_sigma_of_that_size():
    truth = can()
    blurred = cv2.GaussianBlur(np.array(ij.coverage(truth, CAMERA)), (0, 0), 1.0)
    fit = fit_to(blurred)
    assert fit.status is ij.FitStatus.POOR_FIT
    assert float(fit.chi2) > 9
    assert_close(fit_to(blurred, sigma=0.2), truth)


def test_a_mask_of_booleans_is_one_when_it_is_stored_as_floats():
    mask = mask_of(can(60))
    fit, of_floats = fit_to(mask), fit_to(mask.astype(np.float32))
    assert of_floats.status is ij.FitStatus.CONVERGED
    jax.tree.map(np.testing.assert_array_equal, of_floats.std, fit.std)
    np.testing.assert_array_equal(of_floats.cylinder.center, fit.cylinder.center)


def test_a_bite_out_of_a_mask_changes_little():
    truth = can()
    mask = mask_of(truth)
    row = 60
    first = int(np.flatnonzero(mask[row])[0])
    mask[row - 3 : row + 3, first : first + 5] = False
    assert_close(fit_to(mask), truth)


def test_holes_within_a_mask_are_no_edges():
    mask = mask_of(can())
    pierced = mask.copy()
    row, col = np.argwhere(cv2.erode(mask.view(np.uint8), np.ones((13, 13))) > 0)[
        ::200
    ].T
    for down in (-1, 0, 1):
        pierced[row + down, col - 1] = pierced[row + down, col] = False
    assert np.count_nonzero(mask & ~pierced) > 20
    fit, whole = fit_to(pierced), fit_to(mask)
    np.testing.assert_array_equal(fit.cylinder.center, whole.cylinder.center)


def test_an_end_beyond_the_border_is_open_and_the_rest_known():
    truth = ij.Cylinder((0.03, 0.14, 0.35), (0.2, 0.9, 0.3), 0.03, 0.14)
    fit = fit_to(matte_of(truth), prior={"radius": (0.03, 0.0001)})
    assert fit.status is ij.FitStatus.CONVERGED
    assert fit.ends_seen.sum() == 1
    assert np.isinf(fit.std.height)
    turn = np.radians(angle_between(fit.cylinder.axis, truth.axis))
    assert turn < 4 * float(jnp.linalg.norm(fit.std.axis))


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"mask": None}, "mask must be given where depth is None"),
        ({"mask_meaning": "region"}, "mask_meaning must be 'outline' where depth"),
        ({"mask": np.full((120, 160), 1.5)}, "coverages from 0 to 1 .* 1.5 to 1.5"),
        ({"mask": np.full((120, 160), np.nan)}, "coverages from 0 to 1"),
        ({"mask": np.zeros((12, 16))}, r"the camera's shape \(120, 160\)"),
        ({"mask": np.arange(19200).reshape(120, 160)}, "is it a label image"),
        ({"mask": np.zeros((120, 160), bool)}, "an edge of at least 20 places"),
        ({"sigma": -0.1}, "sigma must be pixels by which the edge .* 0 or positive"),
        ({"sigma": ij.StructuredLight(), "mask": disc() * 0.9}, "sigma must"),
        ({"errors": "correlated"}, "errors must be 'independent'"),
        ({"camera": LIDAR}, "one PinholeCamera where depth is None, got Spherical"),
        ({"camera": [CAMERA], "mask": [disc()]}, "is None, got list"),
        ({"fit": ij.fit_tube}, "depth must be given to fit a tube"),
    ],
)  # fmt: skip
def test_bad_input_is_named(asked, message):
    with pytest.raises(ValueError, match=message):
        fit_to(**({"mask": disc()} | asked))


def test_the_first_guess_is_no_part_of_a_trace():
    with pytest.raises(ValueError, match="concrete where depth is None"):
        jax.jit(lambda mask: fit_to(mask).cylinder)(disc())


@RELEASE
def test_a_ball_is_fitted_in_the_world_of_a_posed_camera():
    ball = ij.Sphere((0.02, -0.01, 0.4), 0.05)
    posed = camera_with(camera_from_world=pose())
    prior = {"radius": (0.05, 0.0002)}
    fit = fit_to(matte_of(ball), ij.fit_sphere, posed, prior=prior)
    assert fit.success
    off = np.asarray(fit.sphere.center - ball.transformed(pose().inverse()).center)
    assert (np.abs(off) < 4 * np.asarray(fit.std.center)).all()


@RELEASE
def test_a_cup_is_fitted_where_its_height_is_known():
    cup = ij.Frustum((0.0, -0.05, 0.33), (0.02, 0.05, 0.37), 0.03, 0.045)
    height = float(jnp.linalg.norm(cup.p2 - cup.p1))
    prior = {"height": (height, 0.0002)}
    fit = fit_to(mask_of(cup), ij.fit_frustum, prior=prior)
    assert fit.success
    radii = sorted([float(fit.frustum.radius1), float(fit.frustum.radius2)])
    assert radii == pytest.approx([0.03, 0.045], abs=1e-3)


@pytest.mark.parametrize("degrees", [30, 60, 89.9])
def test_coverage_is_that_of_the_exact_outline(degrees):
    row, col = np.mgrid[0:120, 0:160]
    body: AbstractBody = KINDS[ij.Cylinder].body.of(can(degrees))
    rays = rays_through(CAMERA, jnp.asarray(row.ravel()), jnp.asarray(col.ravel()))
    found = np.asarray(jax.jit(coverage_of)(body, rays)).reshape(120, 160)
    exact = np.asarray(ij.coverage(can(degrees), CAMERA))
    is_crossed = (exact > 0) & (exact < 1)
    off = found - exact
    # What the straight lines within a ninth of a pixel leave, at 17 pixels of radius.
    assert np.sqrt(np.mean(off[is_crossed] ** 2)) < 0.01
    assert abs(off[is_crossed].mean()) < 2e-3
    np.testing.assert_allclose(off[~is_crossed], 0, atol=0.05)
