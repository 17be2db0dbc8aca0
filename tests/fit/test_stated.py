"""What a caller states beforehand and readings exclude is no success."""

import re
from functools import partial

import jax
import numpy as np
import pytest

import impostor_jax as ij
from tests.fit.scenes import CAMERA, SIGMA, can, image
from tests.groups import FULL, RELEASE, SMALL_IMAGES

pytestmark = SMALL_IMAGES
WRONG = {
    "radius": 0.045,
    "height": 0.125,
    "axis": (0.5, 0.8, 0.5),
    "center": (0.01, 0.009, 0.35),
}


def fit_of(sigma=SIGMA, **asked):
    depth, mask = image()
    return ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=sigma, **asked)


def start(**changed):
    """The can with some values changed."""
    values = {name: getattr(can(), name) for name in WRONG}
    return ij.Cylinder(**values | changed)


def assert_contradicted(fit, *names):
    assert fit.status is ij.FitStatus.CONTRADICTED
    assert not fit.success
    assert np.isinf(fit.std.radius)
    for name in names:
        assert f"states {name} as " in fit.reason


@pytest.mark.parametrize("deviation", [1e-3, pytest.param(1e-6, marks=RELEASE)])
def test_a_prior_that_readings_exclude_is_no_success(deviation):
    free = fit_of()
    fit = fit_of(prior={"radius": (0.06, deviation)})
    assert_contradicted(fit)
    found = re.search(
        r"prior states radius as 60.000 \+- (\S+) mm, the readings say (\S+) \+- "
        r"(\S+) mm, (\d+) deviations apart",
        fit.reason,
        re.IGNORECASE,
    )
    assert found
    stated, read, said, apart = map(float, found.groups())
    assert stated == pytest.approx(1e3 * deviation)
    assert read == pytest.approx(1e3 * float(free.cylinder.radius), abs=0.05)
    assert said == pytest.approx(1e3 * float(free.std.radius), rel=0.1)
    assert apart == pytest.approx((60 - read) / np.hypot(stated, said), rel=0.05)
    assert fit.reason in str(fit)
    assert fit.to_dict()["reason"] == fit.reason


@pytest.mark.parametrize(
    "name", ["height", *(pytest.param(x, marks=RELEASE) for x in ("center", "axis"))]
)
def test_a_prior_on_any_parameter_is_tested(name):
    assert_contradicted(fit_of(prior={name: (WRONG[name], 1e-5)}), name)


@FULL
@pytest.mark.parametrize("name", WRONG)
def test_a_held_value_of_any_parameter_is_tested(name):
    wrong = start(**{name: WRONG[name]})
    assert_contradicted(fit_of(initial=wrong, fixed=(name,)), name)


def test_what_agrees_with_the_readings_succeeds():
    values = {name: getattr(can(), name) for name in WRONG}
    assert fit_of(initial=can(), fixed=("radius", "axis")).success
    # An axis has either sign.
    beliefs = values | {"axis": -values["axis"]}
    fit = fit_of(prior={name: (value, 1e-6) for name, value in beliefs.items()})
    assert fit.success


def test_four_deviations_may_be_chance():
    free, deviation = fit_of(), 1e-4
    both = np.hypot(float(free.std.radius), deviation)
    for apart, succeeds in ((4.0, True), (6.5, False)):
        stated = float(free.cylinder.radius) + apart * both
        assert bool(fit_of(prior={"radius": (stated, deviation)}).success) == succeeds


@RELEASE
def test_what_a_sensor_may_be_off_by_is_no_contradiction():
    belief = {"radius": (0.041, 1e-5)}
    assert_contradicted(fit_of(prior=belief))
    scaled = ij.ScaleError(ij.ConstantNoise(SIGMA), 0.03)
    assert fit_of(sigma=scaled, prior=belief).success


def test_what_readings_leave_open_excludes_nothing():
    depth, mask = image(wall=None)
    stated = {"height": (0.2, 1e-4)}
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA, prior=stated)
    assert fit.success
    assert float(fit.cylinder.height) == pytest.approx(0.2, abs=1e-3)


def test_points_are_tested_as_images_are():
    depth, mask = image()
    row, col = np.nonzero(mask)
    z = depth[row, col].astype(float)
    points = np.stack([(col - 79.5) / 150 * z, (row - 59.5) / 150 * z, z], axis=1)
    fit_points = partial(ij.fit_cylinder_to_points, points, (0, 0, 0), SIGMA)
    assert_contradicted(fit_points(prior={"radius": (0.05, 1e-4)}), "radius")


@FULL
def test_two_lengths_that_an_outline_excludes_together():
    mask = np.array(ij.render(can(), CAMERA, outputs=("mask",)).mask)
    outline = partial(
        ij.fit_cylinder, None, CAMERA, mask, mask_meaning="outline"
    )  # fmt: skip
    fit = outline(prior={"radius": (0.04, 1e-4), "height": (0.2, 1e-4)})
    assert_contradicted(fit)
    assert outline(prior={"radius": (0.04, 1e-4), "height": (0.12, 1e-3)}).success


def test_a_failed_one_of_several_says_so_alone():
    depth, mask = image()
    fits = ij.fit_cylinders(
        np.stack([depth, depth]), CAMERA, masks=np.stack([mask, mask]), sigma=SIGMA,
        prior={"radius": (0.06, 1e-3)},
    )  # fmt: skip
    first = jax.tree.map(lambda values: values[0], fits)
    assert first.status is ij.FitStatus.CONTRADICTED
    assert first.reason == "The readings exclude what was stated, or the outline."


def test_a_prior_on_a_held_parameter_is_refused():
    asked = {"initial": can(), "fixed": ("radius",), "prior": {"radius": (0.04, 1.0)}}
    with pytest.raises(ValueError, match="prior must be of parameters that are free, "):
        fit_of(**asked)
