"""Fits of what a search proposes."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find import fitting
from impostor_jax.fit.options import Options
from tests.checks import prepared_by
from tests.find.scenes import ORTHOGRAPHIC
from tests.fit.scenes import CAMERA, SIGMA, image
from tests.groups import SMALL_IMAGES
from tests.page.scenes import can_fit


@SMALL_IMAGES
def test_a_fit_of_parallel_rays_forgets_the_camera_that_stood_in(monkeypatch):
    # Its image is 100 km away: a page, or a test for a taper, would look there.
    monkeypatch.setattr(fitting, "fit_shape", lambda *_, **__: can_fit())
    assert can_fit().asked.arguments is not None
    depth, mask = image()
    noise, options = ij.ConstantNoise(SIGMA), Options()
    fitter = fitting.Fitter.of(depth, ORTHOGRAPHIC, noise, SIGMA, options)
    fit = fitter._fit(mask, None, ij.Effort())
    assert fit.asked.arguments is None
    np.testing.assert_array_equal(fit.cylinder.radius, can_fit().cylinder.radius)


@SMALL_IMAGES
@pytest.mark.parametrize("sigma", [SIGMA, None], ids=["told", "untold"])
def test_what_is_prepared_is_what_fits_take(monkeypatch, sigma):
    depth, mask = image()
    ij.fit_cylinder(depth, CAMERA, mask, sigma)
    asked = prepared_by(monkeypatch)
    monkeypatch.setattr(fitting, "_PREPARED", set())
    monkeypatch.setattr(fitting, "in_background", lambda function: function())
    noise, options = ij.ConstantNoise(SIGMA), Options()
    fitter = fitting.Fitter.of(depth, CAMERA, noise, sigma, options)
    fitter.prepare()
    fitter.prepare()
    # Solver and assessment.
    assert len(asked) == 2
    assert all(key in part.programs for part, key in asked)
