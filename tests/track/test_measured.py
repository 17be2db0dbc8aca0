"""What is taken of a fit: which errors are its own, and which images share."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.track.measured import PART, Measured
from tests.fit.scenes import CAMERA, SIGMA
from tests.groups import FULL, SMALL_IMAGES
from tests.track.scenes import can, frame

pytestmark = [SMALL_IMAGES, FULL]

PIXEL = 1 / 150


@pytest.fixture(scope="module")
def fit():
    shape = can()
    mask = np.asarray(ij.render(shape, CAMERA, outputs=("mask",)).mask)
    effort = ij.Effort(readings=1024, doubts=False)
    sensor = ij.ScaleError(ij.ConstantNoise(SIGMA, across=0.0, angle=0.0), 0.01)
    depth = frame([shape])
    return ij.fit_cylinder(
        depth, CAMERA, mask=mask, sigma=sensor, initial=shape, effort=effort
    )


def test_both_parts_are_those_of_the_fit(fit):
    seen = Measured.of(fit, np.zeros(3), PIXEL)
    assert seen.is_known.all()
    whole = seen.own + seen.shared @ seen.shared.T
    # What images share of the noise comes on top.
    budget = fit.std_budget
    noise = np.concatenate(
        [np.atleast_1d(getattr(budget["noise"], name)) for name in ("radius", "height")]
    )
    std = np.array([float(fit.std.radius), float(fit.std.height)])
    expected = np.hypot(std, PART * noise)
    np.testing.assert_allclose(np.sqrt(np.diagonal(whole))[5:], expected, rtol=0.01)
    assert np.linalg.eigvalsh(seen.own)[0] > 0


def test_the_scale_is_one_error_of_all_lengths(fit):
    scale = Measured.of(fit, np.zeros(3), PIXEL).shared[:, 0]
    center = np.asarray(fit.cylinder.center, float)
    larger = scale[5] / float(fit.cylinder.radius)
    assert larger == pytest.approx(0.01, rel=0.02)
    assert scale[6] == pytest.approx(larger * float(fit.cylinder.height), rel=0.02)
    axis = np.asarray(fit.cylinder.axis, float)
    assert scale[4] == pytest.approx(larger * (axis @ center), rel=0.02)


def test_with_the_other_sign_of_the_axis_it_says_the_same(fit):
    own = np.asarray(fit.cylinder.axis, float)
    seen, turned = (Measured.of(fit, np.zeros(3), PIXEL, axis) for axis in (own, -own))
    np.testing.assert_allclose(turned.axis, -seen.axis)

    def of_surface(one):
        """Covariance in the world: tilt of the axis, center, radius and height."""
        into = np.zeros((8, 7))
        into[:3, :2] = one.basis[:2].T * np.sign(one.axis @ own)
        into[3:6, 2:5] = one.basis.T
        into[6, 5] = into[7, 6] = 1
        both = one.own + one.shared @ one.shared.T
        return into @ both @ into.T

    np.testing.assert_allclose(
        of_surface(turned), of_surface(seen), rtol=1e-9, atol=1e-15
    )
