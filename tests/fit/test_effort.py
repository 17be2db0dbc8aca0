"""What the dials of an effort change in a fit, and what they do not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of
from tests.groups import RELEASE, SMALL_IMAGES

pytestmark = SMALL_IMAGES


def fitted(effort, **options):
    depth, mask = image()
    return ij.fit_cylinder(depth, CAMERA, mask, SIGMA, effort=effort, **options)


def assert_equal_to_a_fifth_of_a_deviation(fit, other):
    for name in ("center", "radius", "height"):
        deviation = np.asarray(getattr(other.std, name))
        values = [np.asarray(getattr(f.cylinder, name), float) for f in (fit, other)]
        assert (np.abs(values[0] - values[1]) < 0.2 * deviation).all(), name


@RELEASE
def test_losses_agree_on_normal_noise():
    fit = fitted(ij.Effort(kernel="pseudo_huber"))
    assert fit.success
    assert_equal_to_a_fifth_of_a_deviation(fit, fitted("balanced"))


@RELEASE
def test_exact_fits_in_double_precision():
    fit, plain = fitted("exact"), fitted("balanced")
    assert fit.success
    assert fit.cylinder.radius.dtype == np.float64
    assert_equal_to_a_fifth_of_a_deviation(fit, plain)


def test_all_starts_are_tried_where_that_is_asked():
    fit, plain = fitted(ij.Effort(all_starts=True)), fitted("balanced")
    assert fit.success
    assert int(fit.num_starts) > int(plain.num_starts) == 1
    assert_equal_to_a_fifth_of_a_deviation(fit, plain)


def test_fewer_readings_say_how_much_less_they_know():
    truth = ij.Cylinder((0.01, 0, 0.3), (0.8, 0.3, 0.5), radius=0.04, height=0.12)
    depth, mask = image_of(truth)
    effort = ij.Effort(readings=1024)
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA, effort=effort)
    assert fit.success
    assert int(fit.num_pixels) == 1024
    off = abs(float(fit.cylinder.radius) - truth.radius)
    assert off < 4 * float(fit.std.radius)
    assert "than the 1024 that were taken" in str(fit)
    # Of evenly spread ones a deviation grows with the root of what is left out, or
    # more; half of these are of those that graze, which know most of the radius.
    plain = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    assert "that were taken" not in str(plain)
    wider = np.sqrt(np.count_nonzero(mask) / int(fit.num_pixels))
    assert wider > 1.5
    assert 1 < float(fit.std.radius) / float(plain.std.radius) < 0.85 * wider
    tilted = np.linalg.norm(fit.std.axis) / np.linalg.norm(plain.std.axis)
    assert 1 < tilted < 1.6 * wider


def test_more_starts_are_tried_where_the_first_does_not_explain_the_readings():
    depth, mask = image()
    # Readings that scatter twice as much as the sensor is said to.
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA / 2)
    assert fit.success
    assert int(fit.num_starts) > 1
    one = ij.fit_cylinder(depth, CAMERA, mask, SIGMA / 2, effort=ij.Effort(starts=1))
    assert int(one.num_starts) == 1


def test_a_step_limit_ends_in_a_status():
    fit = fitted(ij.Effort(max_steps=1, starts=1, tolerance=1e-6))
    assert fit.status == ij.FitStatus.STEP_LIMIT
    assert np.isinf(fit.std.radius)


def test_a_fit_takes_no_more_steps_than_it_is_given():
    fit = fitted(ij.Effort(max_steps=30, starts=1, tolerance=1e-6))
    assert fit.status == ij.FitStatus.STEP_LIMIT
    assert int(fit.num_steps) == 30


def test_tolerance_compiles_nothing_and_saves_steps():
    coarse, fine = (fitted(ij.Effort(tolerance=t)) for t in (2.0, 0.02))
    assert int(coarse.num_steps) < int(fine.num_steps)
    assert_equal_to_a_fifth_of_a_deviation(fitted("balanced"), fine)


@RELEASE
def test_a_traced_fit_takes_as_many_readings_as_it_is_told():
    depth, mask = image()
    effort = ij.Effort(readings=300)

    @jax.jit
    def fit(depth):
        return ij.fit_cylinder(depth, CAMERA, mask, SIGMA, initial=can(), effort=effort)

    region = np.asarray(fit(jnp.asarray(depth)).region)
    assert np.count_nonzero(region) == 300 < np.count_nonzero(mask)
    assert not np.any(region & ~mask)
    with pytest.raises(ValueError, match="precision must be JAX's own, float32, in a"):
        jax.jit(lambda d: ij.fit_cylinder(d, CAMERA, initial=can(), effort="exact"))(
            jnp.asarray(depth)
        )
