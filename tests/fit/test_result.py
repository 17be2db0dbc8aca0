"""One result of all fits: its shape, what is read of it by name, and its options."""

import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.body import coordinates_of
from impostor_jax.fit.fittable import CYLINDER, KINDS, no_guess
from impostor_jax.fit.measured import NOT_MEASURED
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.geometry.so3 import tangent_basis
from tests.fit.scenes import CAMERA, SIGMA, can, image
from tests.groups import SMALL_IMAGES

NAMES = {ij.Cylinder: "cylinder", ij.Frustum: "frustum", ij.Sphere: "sphere"}


@pytest.mark.parametrize("kind", NAMES)
def test_the_shape_has_the_name_of_its_kind_alone(kind):
    fit = no_guess(KINDS[kind], np.zeros((4, 5), bool))
    assert isinstance(fit.shape, kind)
    assert getattr(fit, NAMES[kind]) is fit.shape
    for other in {*NAMES.values()} - {NAMES[kind]}:
        message = f"fit.{other} needs the fit of a {other}, got that of a {NAMES[kind]}"
        with pytest.raises(AttributeError, match=message):
            getattr(fit, other)


@pytest.mark.parametrize("kind", NAMES)
def test_what_failed_has_infinite_deviations_of_every_parameter(kind):
    fit = no_guess(KINDS[kind], np.zeros((4, 5), bool))
    for name, (value, deviation) in fit.told.items():
        # An axis is told in its two tangent directions.
        assert deviation.shape == ((2,) if name == "axis" else value.shape)
        assert np.isinf(deviation).all()
    assert fit.covariance.shape == 2 * (len(fit.coordinates),)
    assert np.isinf(np.diagonal(fit.covariance)).all()
    assert not fit.observed.coordinates.any()
    assert fit.ends_seen.shape == ((0,) if kind is ij.Sphere else (2,))


def test_an_unknown_name_is_told_with_those_there_are():
    std = no_guess(CYLINDER, np.zeros((4, 5), bool)).std
    with pytest.raises(
        AttributeError, match=r"names center, .*, height, got 'radius1'"
    ):
        _ = std.radius1


@SMALL_IMAGES
def test_deviations_of_the_center_are_those_of_the_coordinates():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    first = fit.coordinates.index("center_first")
    axis = np.asarray(fit.cylinder.axis, float)
    frame = np.vstack([np.asarray(tangent_basis(fit.cylinder.axis), float), axis])
    along = np.asarray(fit.covariance, float)[first : first + 3, first : first + 3]
    expected = np.sqrt(np.diagonal(frame.T @ along @ frame))
    np.testing.assert_allclose(fit.std.center, expected, rtol=1e-4)
    root = np.sqrt(np.diagonal(fit.covariance))
    for name in ("radius", "height"):
        at = fit.coordinates.index(name)
        assert float(getattr(fit.std, name)) == pytest.approx(root[at], rel=1e-6)


@SMALL_IMAGES
def test_directions_beside_a_free_one_keep_their_deviations():
    depth, mask = image(wall=None)
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    known = np.asarray(fit.observed.coordinates)
    assert 0 < known.sum() < len(known)
    scale = np.array([1, 1, *[0] * 5]) * (0.04 + float(fit.cylinder.height)) / 2
    scale = np.where(scale > 0, scale, 1)
    moved = np.asarray(fit.covariance, float)[known][:, known]
    moved = moved * np.outer(scale[known], scale[known])
    expected = np.sqrt(np.linalg.eigvalsh(moved)[::-1])
    free = len(known) - known.sum()
    assert np.isinf(fit.observed.deviation[:free]).all()
    np.testing.assert_allclose(fit.observed.deviation[free:], expected, rtol=0.02)


@pytest.mark.usefixtures("double")
def test_a_readout_is_of_the_axis_turned_to_that_of_the_other():
    found, unseen = RoundBody.of(can()), jnp.zeros(2, bool)
    for sign in (1.0, -1.0):
        slid = found.reversed(jnp.asarray(sign))
        slid, _ = slid.drawn_in(unseen, jnp.asarray([-0.01, 0.05]))
        read = slid.readout(found, ~unseen)
        for name in ("axis", "across_axis"):
            np.testing.assert_allclose(read[name], 0, atol=1e-12)
        assert float(read["along_axis"]) == pytest.approx(sign * 0.03)
        assert float(read["height"]) == pytest.approx(0.04)


@pytest.mark.usefixtures("double")
def test_an_end_that_is_not_seen_has_the_radius_of_the_wall_beside_it():
    cup = ij.Frustum((0.0, 0.0, 1.0), (0.0, 0.0, 2.0), 0.5, 0.3)
    found = RoundBody.of(cup)
    longer, _ = found.drawn_in(jnp.zeros(2, bool), jnp.ones(2))
    read = longer.readout(found, jnp.asarray([False, True]))
    assert float(read["radius1"]) == pytest.approx(0.5)
    assert float(read["radius2"]) == pytest.approx(0.2)
    assert coordinates_of(found)[5:7] == ("radius1", "radius2")


@SMALL_IMAGES
def test_failures_of_several_views_name_their_poses():
    depth, mask = image()
    one = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    pair = one.having(pixelwise=one.pixelwise * 2)
    for status in (ij.FitStatus.STEP_LIMIT, ij.FitStatus.NOT_FINITE):
        assert one.failed(status).reason == status.meaning
        assert "camera_from_world maps points" in pair.failed(status).reason
    poor = pair.failed(ij.FitStatus.POOR_FIT)
    assert "or a pose is." in poor.having(chi2=jnp.asarray(16.0)).reason
    assert "a pose is wrong, or" in poor.having(border_chi2=jnp.asarray(99.0)).reason


@SMALL_IMAGES
def test_what_is_undetermined_says_which_noise_was_taken():
    blank = no_guess(CYLINDER, np.zeros((4, 5), bool)).noting(measured=NOT_MEASURED)
    assert blank.failed(ij.FitStatus.UNDETERMINED).reason.endswith(NOT_MEASURED)
    assert NOT_MEASURED not in blank.failed(ij.FitStatus.STEP_LIMIT).reason


def test_a_success_whose_residuals_exceed_the_noise_says_so():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    assert fit.reason == "The fit converged."
    doubtful = ij.fit_cylinder(depth, CAMERA, mask, SIGMA / 2)
    assert doubtful.success
    said = "But the residuals are 2.0 times the noise given: sigma or the shape may"
    assert said in doubtful.reason
    # Nobody said what it is.
    guessed = ij.fit_cylinder(depth, CAMERA, mask).having(chi2=jnp.asarray(4.0))
    assert ("times the noise" in guessed.reason) == (guessed.p_value >= 0)


@SMALL_IMAGES
def test_several_fits_are_counted_indexed_and_iterated():
    depth, mask = image()
    depths = np.stack([depth, depth, np.float32(2) * depth, depth])
    masks = np.stack([mask, 0 * mask, mask, mask])
    prior = {"radius": (0.04, 1e-3)}
    fits = ij.fit_cylinders(depths, CAMERA, masks, SIGMA, prior=prior)
    alone = ij.fit_cylinder(depth, CAMERA, mask, SIGMA, prior=prior)
    assert len(fits) == 4
    good, none, wrong, _ = fits.statuses
    assert [good, none] == [ij.FitStatus.CONVERGED, ij.FitStatus.NO_FIRST_GUESS]
    assert wrong is ij.FitStatus.CONTRADICTED
    # What is known of one beside its numbers.
    assert fits.reasons[2] == fits[2].reason != wrong.meaning
    assert fits[0].outline_gap == alone.outline_gap is not None
    assert fits[-1].cylinder.radius == alone.cylinder.radius
    assert [fit.status for fit in fits] == list(fits.statuses)
    some = fits[np.asarray(fits.success)]
    assert some.statuses == (good, good)
    assert fits[1:3].reasons == fits.reasons[1:3]
    np.testing.assert_array_equal(fits[1:3].pose, fits.pose[1:3])
    assert fits[0].to_dict() == {**alone.to_dict(), "num_starts": 1}
    assert fits.to_dict()["fits"][1]["status"] == "no_first_guess"
    with pytest.raises(IndexError):
        fits[4]
    with pytest.raises(TypeError, match="there is one fit: it has no length"):
        len(alone)
    with pytest.raises(TypeError, match="statuses has how each ended"):
        _ = fits.reason
    assert alone
