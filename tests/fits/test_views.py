"""Several views of one object: one likelihood, whatever frame it is computed in."""

import base64

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from tests.fit.scenes import CAMERA, SIGMA, can
from tests.groups import FULL, RELEASE, SMALL_IMAGES
from tests.page.scenes import scene_of
from tests.schemas import validator

pytestmark = [SMALL_IMAGES, FULL]


def turned_about(shape, degrees: float, camera=CAMERA) -> ij.PinholeCamera:
    """A camera that looks from elsewhere at the place of a shape, upright."""
    angle, center = np.radians(degrees), np.asarray(shape.center, float)
    pose = np.eye(4)
    pose[:3, :3] = [
        [np.cos(angle), 0, np.sin(angle)],
        [0, 1, 0],
        [-np.sin(angle), 0, np.cos(angle)],
    ]
    pose[:3, 3] = center - pose[:3, :3] @ center
    intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
    return ij.PinholeCamera(*intrinsics, camera.width, camera.height, None, False, pose)


def seen(shape, camera, seed=0):
    maps = ij.render(shape, camera, outputs=("depth", "mask"))
    depth, mask = np.asarray(maps.depth), np.asarray(maps.mask)
    noise = np.random.default_rng(seed).normal(0, SIGMA, depth.shape)
    return (np.minimum(depth, 0.7) + noise).astype(np.float32), mask


def from_two_sides(shape):
    """Depths, cameras and masks."""
    cameras = [CAMERA, turned_about(can(), 150.0)]
    pairs = [seen(shape, camera, seed) for seed, camera in enumerate(cameras)]
    return [depth for depth, _ in pairs], cameras, [mask for _, mask in pairs]


@pytest.fixture(scope="module")
def two():
    """Depths, cameras and masks of a can from two sides."""
    return from_two_sides(can())


def fitted(depths, cameras, masks, sigma=SIGMA, pose_sigma=(0.0, 0.0), **options):
    """The fit to views whose poses are said to be exact."""
    options |= {"sigma": sigma, "pose_sigma": pose_sigma}
    return ij.fit_cylinder(depths, cameras, mask=masks, **options)


def posed_wrongly(degrees, move, errors="correlated"):
    """The fit to a can from two sides, of which one is said to be elsewhere."""
    cameras = [CAMERA, turned_about(can(), degrees)]
    pairs = [seen(can(), camera, seed) for seed, camera in enumerate(cameras)]
    moved = np.eye(4)
    moved[:3, 3] = move
    off = ij.RigidTransform.from_matrix(moved) @ cameras[1].camera_from_world
    cameras[1] = eqx.tree_at(lambda camera: camera.camera_from_world, cameras[1], off)
    depths, masks = zip(*pairs, strict=True)
    return fitted(depths, cameras, masks, errors=errors)


@pytest.fixture(scope="module")
def both(two):
    return fitted(*two)


def test_the_pose_is_told_in_the_frame_of_each_view(two, both):
    validator("fit").validate(both.to_dict())
    first, second = both.pose_in_camera
    np.testing.assert_array_equal(first, both.pose)
    turned = both.cylinder.transformed(two[1][1].camera_from_world)
    np.testing.assert_allclose(second[:3, 2], turned.axis, atol=1e-6)
    np.testing.assert_allclose(second[:3, 3], turned.center, atol=1e-6)


def test_a_wrong_pose_makes_views_contradict_each_other():
    # What the views then leave may be taken for rays that err.
    fit = posed_wrongly(150.0, (0.006, 0.002, 0.003), None)
    assert fit.status == "poor_fit"
    assert "a pose is wrong" in fit.reason


@RELEASE
def test_errors_of_neighbors_do_not_explain_a_wrong_pose():
    # It leaves what neighbors share; alone no view does.
    fit = posed_wrongly(60.0, (0.003, 0.001, 0.0015))
    assert fit.status == "poor_fit"
    assert "The views contradict each other: a pose is wrong" in fit.reason


@RELEASE
def test_a_wall_that_may_depart_because_a_pose_is_wrong_is_as_unsure():
    # From opposite sides a can between views that are apart looks oval.
    fit = posed_wrongly(150.0, (0.0015, 0.0005, 0.0007))
    assert fit.success
    assert fit.form.departs
    # A wall that departs alone leaves it at 0.25 mm.
    of_poses = np.asarray(fit.std_budget["poses"].across_axis)
    assert np.linalg.norm(of_poses) > 0.0005
    assert "Views disagree" in fit.reason


def test_poses_that_err_by_less_than_the_noise_widen_deviations():
    # By .5 mm, of 1 mm noise: the views agreed too well for a poor fit.
    fit = posed_wrongly(150.0, (0.00045, 0.00015, 0.0002), None)
    assert fit.success
    assert "Views disagree" in fit.reason
    off = np.abs(np.asarray(fit.cylinder.center) - np.asarray(can().center))
    assert np.all(off < 3 * np.asarray(fit.std.center))
    of_poses = np.asarray(fit.std_budget["poses"].across_axis)
    assert np.linalg.norm(of_poses) > 3 * np.linalg.norm(
        np.asarray(fit.std_budget["noise"].across_axis)
    )


def test_two_views_are_surer_than_each_and_as_right(two, both):
    assert both.success
    assert abs(float(both.cylinder.radius) - 0.04) < 4 * float(both.std.radius)
    away = np.cross(both.cylinder.axis, can().axis)
    assert np.linalg.norm(away) < 5 * float(np.max(np.asarray(both.std.axis)))
    first = ij.fit_cylinder(two[0][0], CAMERA, mask=two[2][0], sigma=SIGMA)
    # From opposite sides the diameter is between two walls.
    assert both.std.radius < first.std.radius / 2
    assert [image.shape for image in both.residual] == [(120, 160)] * 2
    assert int(both.num_pixels) == sum(int(np.sum(one)) for one in both.region)


@RELEASE
def test_it_does_not_matter_which_view_is_first(two, both):
    other = fitted(*(part[::-1] for part in two))
    std = np.sqrt(np.diagonal(np.asarray(both.covariance)))
    for name in ("center", "axis", "radius", "height"):
        values = [np.asarray(getattr(fit.cylinder, name)) for fit in (both, other)]
        np.testing.assert_allclose(*values, atol=0.05 * np.min(std))
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(np.asarray(other.covariance))), std, rtol=0.02
    )
    np.testing.assert_array_equal(other.region[1], both.region[0])


def test_an_image_given_twice_tells_it_twice(two):
    depth, _, mask = (part[0] for part in two)
    once = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    # The same camera, told in two ways.
    same = ij.PinholeCamera(150.0, 150.0, 79.5, 59.5, 160, 120, None, False, np.eye(4))
    twice = fitted([depth] * 2, [CAMERA, same], [mask] * 2)
    np.testing.assert_allclose(twice.std.radius, once.std.radius / 2**0.5, rtol=0.01)
    off = abs(float(twice.cylinder.radius) - float(once.cylinder.radius))
    assert off < 0.1 * float(once.std.radius)
    assert float(twice.chi2) == pytest.approx(float(once.chi2), rel=0.02)


def test_views_without_a_mask_are_found_by_those_that_have_one(two, both):
    depths, cameras, masks = two
    fit = fitted(depths, cameras, [masks[0], None])
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.04) < 4 * float(fit.std.radius)
    # The start tells, too.
    fit = fitted(depths, cameras, None, initial=both.cylinder)
    assert fit.success
    assert int(np.sum(fit.region[1])) > 0.9 * masks[1].sum()


def test_views_without_any_mask_are_searched(two):
    fit = fitted(*two[:2], None)
    assert fit.success
    assert abs(float(fit.cylinder.radius) - 0.04) < 4 * float(fit.std.radius)
    # One noise is of one sensor, whose images share the error of its scale.
    assert not isinstance(fit.asked.arguments["sigma"], list)
    empty = [np.full_like(depth, 0.7) for depth in two[0]]
    fit = fitted(empty, two[1], None)
    assert fit.status == "no_first_guess"
    assert len(fit.region) == 2


def test_a_view_that_shows_nothing_says_nothing(two):
    depths, cameras, masks = two
    fit = fitted(depths, cameras, [masks[0], np.zeros_like(masks[1])])
    alone = ij.fit_cylinder(depths[0], CAMERA, mask=masks[0], sigma=SIGMA)
    np.testing.assert_allclose(fit.std.radius, alone.std.radius, rtol=0.02)


def test_each_view_has_its_own_noise(two):
    # A view that is told to be a hundred times as noisy says next to nothing.
    fit = fitted(*two, sigma=[SIGMA, ij.ConstantNoise(100 * SIGMA)])
    alone = ij.fit_cylinder(two[0][0], CAMERA, mask=two[2][0], sigma=SIGMA)
    np.testing.assert_allclose(fit.std.radius, alone.std.radius, rtol=0.05)


@RELEASE
def test_an_error_of_scale_is_of_one_sensor_or_of_each(two):
    depths, cameras, masks = two
    # So small that readings of both sides still agree.
    finely, error = ij.Effort(tolerance=0.01), 2e-4
    sensors = [ij.ScaleError(ij.ConstantNoise(SIGMA), error) for _ in range(2)]

    def with_scale(sensor, first=0.0, second=0.0):
        pairs = zip(depths, (first, second), strict=True)
        images = [d * np.float32(1 + scale * error) for d, scale in pairs]
        return fitted(images, cameras, masks, sensor, effort=finely)

    shared, apart = with_scale(sensors[0]), with_scale(sensors)
    both, *each = (
        float(with_scale(sensors[0], *by).cylinder.radius - shared.cylinder.radius)
        for by in ((1, 1), (1, 0), (0, 1))
    )
    of_scale = [float(fit.std_budget["scale"].radius) for fit in (shared, apart)]
    np.testing.assert_allclose(of_scale, [abs(both), np.hypot(*each)], rtol=0.15)


def test_views_are_fitted_in_a_trace(two, both):
    depths, cameras, masks = two

    @jax.jit
    def radius(depths):
        fit = fitted(depths, cameras, masks, initial=can())
        return fit.cylinder.radius

    found = radius([jnp.asarray(depth) for depth in depths])
    assert abs(float(found - both.cylinder.radius)) < 0.2 * float(both.std.radius)


SHAPES = [
    (ij.fit_sphere, ij.Sphere((0.01, 0.005, 0.35), 0.05), {"radius": 0.05}),
    (
        ij.fit_tube,
        ij.tube((0.01, 0.005, 0.35), (0.3, 0.8, 0.52), 0.04, 0.03, 0.1),
        {"outer_radius": 0.04, "inner_radius": 0.03},
    ),
    (
        ij.fit_frustum,
        ij.Frustum((0.01, -0.05, 0.33), (0.02, 0.05, 0.38), 0.05, 0.03),
        {"radius1": 0.05, "radius2": 0.03},
    ),
]


@RELEASE
@pytest.mark.parametrize(("fit", "shape", "radii"), SHAPES, ids=["ball", "tube", "cup"])
def test_other_shapes_have_views_too(fit, shape, radii):
    depths, cameras, masks = from_two_sides(shape)
    found = fit(depths, cameras, mask=masks, sigma=SIGMA)
    assert found.success
    for name, true in radii.items():
        value, std = found.told[name]
        assert abs(float(value) - true) < 4 * float(std)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"cameras": [CAMERA]}, "camera must be a list of 2"),
        ({"cameras": CAMERA}, "camera must be a list of 2"),
        ({"masks": [None]}, "mask must be a list of 2"),
        ({"sigma": [SIGMA] * 3}, "sigma must be a list of 2"),
        ({"depths": []}, "depth must be an image or a list"),
    ],
    ids=str,
)
def test_lists_of_other_lengths_are_refused(two, change, match):
    given = dict(zip(("depths", "cameras", "masks"), two, strict=True)) | change
    with pytest.raises(ValueError, match=match):
        fitted(**given)


def test_an_outline_needs_a_mask(two, both):
    # What is near a start ends where that does.
    for given in ((two[0][0], CAMERA), two[:2]):
        with pytest.raises(ValueError, match="mask must be given where mask_meaning"):
            ij.fit_cylinder(
                *given, sigma=SIGMA, initial=both.cylinder, mask_meaning="outline"
            )


def test_one_image_has_no_lists(two):
    with pytest.raises(ValueError, match="give depth as a list"):
        ij.fit_cylinder(two[0][0], CAMERA, mask=[two[2][0]])


def test_a_page_shows_every_view(two, both):
    scene = scene_of(ij.view(both).html)
    assert [view["size"] for view in scene["views"]] == [[160, 120]] * 2
    for view, region in zip(scene["views"], both.region, strict=True):
        owners = np.frombuffer(base64.b64decode(view["owners"]), "<f4")
        assert np.count_nonzero(owners) == int(np.sum(region))
    with pytest.raises(ValueError, match="one for each of its images"):
        ij.view(both, two[0][0], CAMERA)
