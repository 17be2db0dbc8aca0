"""What `print` shows of shapes and fits: values with units, and never an error."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.across import exact_rays
from impostor_jax.fit.fittable import CYLINDER, no_guess
from tests.cases import PRIMITIVES
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of
from tests.groups import FULL, SMALL_IMAGES


def test_a_shape_shows_its_values_with_units():
    cylinder = ij.Cylinder((0.02, 0.01, 0.8), (0, 0.6, 0.8), 0.04, 0.12)
    assert str(cylinder) == (
        "Cylinder: center (0.02, 0.01, 0.8) m, axis (0, 0.6, 0.8), radius 0.04 m, "
        "height 0.12 m"
    )
    half = ij.Cylinder((0, 0, 1), (0, 1, 0), 1, 2, 0.5, 2, (1, 0, 0), caps=False)
    assert str(half).endswith(
        "start_angle 0.5 rad, end_angle 2 rad, zero (1, 0, 0), caps False, cut_faces "
        "False"
    )


@pytest.mark.parametrize("name", PRIMITIVES)
def test_every_shape_is_told_on_one_line(name):
    shape = PRIMITIVES[name]()
    text = str(shape)
    assert text.startswith(type(shape).__name__ + ": ")
    assert " m" in text
    assert "f32" not in text
    # And those that it is made of have one each.
    assert text.count("\n") == (2 if isinstance(shape, ij.Solid) else 0)


def test_what_has_no_numbers_prints_without_an_error():
    batch = jax.tree.map(lambda x: jnp.stack([x, x]), can())
    assert str(batch) == repr(batch)
    seen = []
    jax.jit(lambda shape: seen.append(str(shape)) or shape.radius)(can())
    assert "f32[3]" in seen[0]
    others = (
        jax.eval_shape(lambda: can()),
        eqx.filter(can(), lambda leaf: False),
        jax.tree.map(lambda x: object(), can()),
    )
    for other in others:
        assert str(other).startswith("Cylinder")


def test_errors_across_rays_are_told_with_units():
    assert str(exact_rays(np.float32)) == (
        "AcrossRays: deviation 0 m, found 0 m, score 0, doubt 0 m^2, scale 1, "
        "misfit 0, spread 1 m, readings 0"
    )


@SMALL_IMAGES
def test_a_fit_prints_as_its_summary():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
    head, center, axis, radius, height, rms = str(fit).splitlines()
    assert head.startswith("converged: The fit converged. ")
    assert fit.summary(1.5).splitlines()[0] == head + ", 1.50 s"
    value, deviation = 1e3 * float(fit.cylinder.radius), 1e3 * float(fit.std.radius)
    assert radius == f"  radius  {value:.3f} mm  (std {deviation:.3f})"
    assert center.startswith("  center  ")
    assert axis.endswith(" degrees)")
    assert " mm  (std " in height
    assert rms.endswith(f" inliers, chi-squared {float(fit.chi2):.2f}")
    assert str(fit.std).startswith("Deviations: center (")


@FULL
@SMALL_IMAGES
def test_fits_of_other_shapes_print_their_values():
    depth, mask = image_of(ij.Sphere((0.02, 0.01, 0.35), 0.05))
    ball = ij.fit_sphere(depth, CAMERA, mask, SIGMA)
    assert [line.split()[0] for line in str(ball).splitlines()[1:]] == [
        "center", "radius", "rms",
    ]  # fmt: skip
    assert ball.shape is ball.sphere


def test_a_failed_fit_and_a_batch_say_how_they_ended():
    fit = no_guess(CYLINDER, np.zeros((4, 5), bool))
    assert str(fit).startswith("no_first_guess: No shape lies near the readings")
    batch = jax.tree.map(lambda x: jnp.stack([x, x]), fit)
    assert str(batch) == "2 fits: 2 no_first_guess"
    shapes = jax.eval_shape(lambda: fit)
    assert str(shapes).startswith("Fit(")
