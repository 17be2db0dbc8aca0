"""Readings of a row, or of a column, that err alike."""

import functools

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.regions import DepthUnitsWarning
from tests.fit.scenes import CAMERA, SIGMA, image
from tests.groups import FULL, SMALL_IMAGES

pytestmark = SMALL_IMAGES

SHARED = 0.7 * SIGMA


@functools.cache
def fitted(lines, sigma, scale=1.0, **options):
    depth, mask = image()
    size = {"rows": (len(depth), 1), "columns": (1, depth.shape[1]), None: (1, 1)}
    errors = np.random.default_rng(3).normal(0, SHARED if lines else 0, size[lines])
    noisy = np.where(depth > 0, depth + errors, 0).astype(depth.dtype)
    return ij.fit_cylinder(scale * noisy, CAMERA, mask, sigma, **options)


@pytest.mark.parametrize(
    "sigma",
    [
        pytest.param(SIGMA, id="of single readings"),
        pytest.param(float(np.hypot(SIGMA, SHARED)), id="of all"),
        pytest.param(None, id="untold"),
    ],
)
@pytest.mark.parametrize("lines", ["rows", pytest.param("columns", marks=FULL)])
def test_lines_that_err_alike_are_told_and_counted(lines, sigma):
    # Taken for white noise, 4 of 10 fits were four to ten deviations off.
    fit = fitted(lines, sigma)
    assert fit.success
    told = f"Readings of a {lines[:-1]} err alike, by "
    assert told in fit.asked.measured
    assert told in str(fit)
    said = float(fit.asked.measured.split(told)[1].split()[0]) / 1e3
    assert said == pytest.approx(SHARED, rel=0.3)
    assert 0.8 < float(fit.chi2) < 1.3
    given = fitted(lines, ij.LineNoise(ij.ConstantNoise(SIGMA), SHARED, lines))
    for name in ("radius", "height", "axis", "center"):
        own, wanted = (np.asarray(getattr(one.std, name)) for one in (fit, given))
        np.testing.assert_allclose(own, wanted, rtol=0.35)


def test_what_lines_share_widens_deviations():
    white = fitted("rows", float(np.hypot(SIGMA, SHARED)), errors="independent")
    given = fitted("rows", ij.LineNoise(ij.ConstantNoise(SIGMA), SHARED))
    assert not given.asked.measured
    assert float(given.chi2) == pytest.approx(1, abs=0.2)
    # The axis lies in the image: rows turn it out of that.
    wider = np.max(np.asarray(given.std.axis) / np.asarray(white.std.axis))
    assert wider > 1.5


@FULL
def test_a_sensor_that_says_what_neighbors_share_may_not_say_all():
    warped = ij.CorrelatedNoise(ij.ConstantNoise(SIGMA), 1e-4, length=40.0)
    fit = fitted("rows", warped)
    assert "Readings of a row err alike" in fit.asked.measured
    assert {"warp"} <= set(fit.std_budget.some)


@FULL
@pytest.mark.parametrize("sigma", [SIGMA, None])
def test_white_noise_shares_nothing(sigma):
    assert "err alike" not in fitted(None, sigma).asked.measured


@FULL
def test_a_fit_with_what_was_measured_keeps_its_hint():
    with pytest.warns(DepthUnitsWarning, match="in millimeters"):
        fit = fitted("rows", None, scale=1000)
    assert "Readings of a row err alike" in fit.asked.measured
    assert "is it in millimeters?" in fit.reason
