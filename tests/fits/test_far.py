"""Fits far from the origin of the world are those near it, and told in double."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from tests.fit.scenes import CAMERA, SIGMA, can, image
from tests.groups import OF_POINTS, RELEASE

pytestmark = OF_POINTS

PLACE = np.array([512345.678, 5412345.678, 250.0])
KNOWN = {"radius": (0.04, 0.001), "center": ((0.01, 0.005, 0.35), 0.01)}


def camera_at(place):
    """The camera of the images at a place; its world has the directions of its own."""
    return ij.PinholeCamera(
        CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, CAMERA.width, CAMERA.height,
        camera_from_world=ij.RigidTransform(np.eye(3), -place),
    )  # fmt: skip


NEAR, AWAY = camera_at(np.zeros(3)), camera_at(PLACE)


def start_at(place):
    near = can()
    center = np.asarray(near.center, float) + place
    return ij.Cylinder(center, near.axis, near.radius, near.height)


def assert_same(far, near):
    """The same fit but for its place, which is told to a micrometer."""
    assert near.success
    assert far.success
    np.testing.assert_allclose(
        far.cylinder.center - PLACE, near.cylinder.center, rtol=0, atol=1e-6
    )
    assert far.cylinder.center.dtype == np.float64
    assert far.cylinder.radius.dtype == near.cylinder.radius.dtype == np.float32
    np.testing.assert_allclose(far.cylinder.axis, near.cylinder.axis, atol=1e-6)
    np.testing.assert_allclose(far.cylinder.radius, near.cylinder.radius, atol=1e-7)
    np.testing.assert_allclose(far.std.radius, near.std.radius, rtol=1e-4)


@pytest.fixture(scope="module")
def pair():
    """The same image fitted far off and near."""
    depth, mask = image()
    return [
        ij.fit_cylinder(depth, camera, mask=mask, sigma=SIGMA)
        for camera in (AWAY, NEAR)
    ]


def test_an_image_is_fitted_far_as_near(pair):
    far, near = pair
    assert_same(far, near)
    np.testing.assert_allclose(far.pose[:3, 3], far.cylinder.center)
    np.testing.assert_allclose(far.pose_in_camera, near.pose_in_camera, atol=1e-6)
    assert far.asked.arguments["camera"] is AWAY
    assert far.to_dict()["center_m"] == far.cylinder.center.tolist()


def test_its_render_is_the_image_that_was_fitted(pair):
    depths = [
        np.asarray(ij.render(fit.shape, camera, outputs=("depth",)).depth)
        for fit, camera in zip(pair, (AWAY, NEAR), strict=True)
    ]
    np.testing.assert_allclose(*depths, atol=1e-6)


def test_start_and_prior_are_of_the_world():
    depth, mask = image()
    center, deviation = KNOWN["center"]

    def fitted(camera, place):
        prior = KNOWN | {"center": (np.asarray(center) + place, deviation)}
        return ij.fit_cylinder(
            depth, camera, mask=mask, sigma=SIGMA, initial=start_at(place), prior=prior
        )

    far, near = fitted(AWAY, PLACE), fitted(NEAR, np.zeros(3))
    assert_same(far, near)
    # What was asked is told as it was asked.
    np.testing.assert_array_equal(
        far.asked.arguments["initial"].center, start_at(PLACE).center
    )


def test_several_images_keep_their_worlds_side_by_side(pair):
    depth, mask = image()
    empty = np.zeros_like(depth)
    fits = ij.fit_cylinders(
        np.stack([depth, empty, depth]), [NEAR, AWAY, AWAY],
        np.stack([mask, mask, mask]), sigma=SIGMA,
    )  # fmt: skip
    far, near = pair
    assert np.asarray(fits.success).tolist() == [True, False, True]
    assert fits.cylinder.center.dtype == np.float64
    np.testing.assert_allclose(fits.cylinder.center[0], near.cylinder.center)
    np.testing.assert_array_equal(fits.cylinder.center[2], far.cylinder.center)


def test_a_search_finds_far_what_it_does_near(pair):
    depth, _ = image()
    far, near = (ij.find_cylinders(depth, c, sigma=SIGMA) for c in (AWAY, NEAR))
    assert len(far) == len(near) == 1
    np.testing.assert_array_equal(far.masks, near.masks)
    np.testing.assert_allclose(far.visible, near.visible)
    assert_same(far.fits[0], near.fits[0])
    np.testing.assert_allclose(
        far.cylinders.center - PLACE, near.cylinders.center, atol=1e-6
    )
    np.testing.assert_allclose(
        far.planes.point - PLACE, near.planes.point, rtol=0, atol=1e-6
    )
    assert far.fits[0].asked.arguments["camera"] is AWAY


@RELEASE
def test_tests_of_a_fit_are_those_near(pair):
    for test in (ij.test_taper, ij.test_bore):
        far, near = (test(fit) for fit in pair)
        np.testing.assert_allclose(far.p_value, near.p_value, rtol=1e-2)


def test_a_traced_fit_far_off_is_refused():
    depth, mask = image()

    def traced(place):
        camera, start = camera_at(place), start_at(place)

        def center(depth):
            fit = ij.fit_cylinder(depth, camera, mask=mask, sigma=SIGMA, initial=start)
            return fit.cylinder.center

        return jax.eval_shape(center, jnp.asarray(depth))

    with pytest.raises(ValueError, match="near the origin of the world in a traced"):
        traced(PLACE)
    # A few hundred meters are rounded by less than a fit is unsure of.
    assert traced(np.array([0.0, 300.0, 0.0])).dtype == np.float32
