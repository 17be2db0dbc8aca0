import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from tests.cases import pose
from tests.checks import QUICKLY
from tests.fit.scenes import CAMERA, SIGMA, camera_with, image_of
from tests.groups import RELEASE, SMALL_IMAGES

pytestmark = SMALL_IMAGES


def ball():
    return ij.Sphere((0.02, -0.01, 0.4), 0.05)


def fit_of(shape, seed=0, **asked):
    depth, mask = image_of(shape, seed=seed)
    return ij.fit_sphere(depth, CAMERA, mask=mask, sigma=SIGMA, **asked)


def test_noisy_sphere_is_recovered_within_its_deviations():
    scores = []
    for seed in range(12):
        fit = fit_of(ball(), seed)
        assert fit.status is ij.FitStatus.CONVERGED
        scores += [*(np.asarray(fit.sphere.center - ball().center) / fit.std.center)]
        scores += [float((fit.sphere.radius - 0.05) / fit.std.radius)]
    assert float(fit.std.radius) < 1e-4
    assert fit.rms == pytest.approx(SIGMA, rel=0.05)
    # 48 draws, partly correlated: their own deviation is known to about 15 percent.
    assert np.abs(scores).max() < 4
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_rays_beside_the_outline_of_a_small_ball_may_miss_it():
    # Of 40 balls of eight pixels ten were refused.
    far, scores = ij.Sphere((0.0, 0.0, 1.0), 0.052), []
    for seed in range(12):
        depth, mask = image_of(far, seed=seed, wall=1.5)
        noise = np.random.default_rng(100 + seed).normal(0, 0.008, depth.shape)
        noisy = (depth + noise).astype(np.float32)
        fit = ij.fit_sphere(noisy, CAMERA, mask, float(np.hypot(0.008, SIGMA)))
        assert fit.success
        scores += [float((fit.sphere.radius - 0.052) / fit.std.radius)]
    assert np.sqrt(np.mean(np.square(scores))) < 1.6


def test_sphere_is_found_without_a_mask():
    depth, mask = image_of(ball())
    fit = ij.fit_sphere(depth, CAMERA, sigma=SIGMA)
    assert fit.success
    assert fit.sphere.radius == pytest.approx(0.05, abs=4 * float(fit.std.radius))
    assert (np.asarray(fit.region) & mask).sum() > 0.97 * mask.sum()


def test_sphere_around_the_camera_is_seen_from_inside():
    room = ij.Sphere((0.02, 0.01, 0.1), 0.5)
    depth, mask = image_of(room)
    # As few pixels as the ball has, lest the fit be compiled for more.
    part = np.zeros_like(mask)
    part[::4, ::4] = True
    part[50:70, 70:90] = True
    fit = ij.fit_sphere(depth, CAMERA, mask=mask & part, sigma=SIGMA)
    assert fit.success
    assert fit.sphere.radius == pytest.approx(0.5, abs=4 * float(fit.std.radius))


# With a pose, which is compiled anew as what is held is: once for both.
def test_held_and_expected_parameters_count_in_the_world_of_a_posed_camera():
    posed = camera_with(camera_from_world=pose())
    depth, mask = image_of(ball())
    center = ball().transformed(pose().inverse()).center
    start = ij.Sphere((0.0, 0.0, 0.41), 0.05).transformed(pose().inverse())

    def fit_of(deviation):
        return ij.fit_sphere(
            depth, posed, mask=mask, sigma=SIGMA, initial=start, fixed=("radius",),
            prior={"center": (center, deviation)},
        )  # fmt: skip

    held = fit_of(1e-6)
    assert float(held.sphere.radius) == pytest.approx(0.05, rel=1e-6)
    assert float(held.std.radius) == 0
    np.testing.assert_allclose(held.std.center, 1e-6, rtol=0.05)
    np.testing.assert_allclose(held.sphere.center, center, atol=5e-6)
    # A vague one leaves it to the readings, which are the camera's.
    vague = fit_of(1.0)
    assert vague.success
    assert 1e-5 < float(jnp.max(vague.std.center)) < 1e-4
    off = np.abs(np.asarray(vague.sphere.center - center))
    assert (off < 4 * np.asarray(vague.std.center)).all()


def test_a_plane_is_no_sphere():
    depth = np.full((CAMERA.height, CAMERA.width), 0.5)
    depth = depth + np.random.default_rng(0).normal(0, SIGMA, depth.shape)
    mask = np.zeros(depth.shape, bool)
    mask[40:80, 50:110] = True
    fit = ij.fit_sphere(depth.astype(np.float32), CAMERA, mask=mask, sigma=SIGMA)
    assert not fit.success
    assert np.isinf(fit.std.radius)


@RELEASE
def test_derivatives_are_those_of_finite_differences():
    depth, mask = image_of(ball())

    def radius(offset):
        moved = jnp.asarray(depth) + offset
        # Differences need values at the fixed point itself, where steps have ended.
        fit = ij.fit_sphere(
            *(moved, CAMERA, mask, SIGMA, ball()), effort=ij.Effort(tolerance=2e-3)
        )
        return fit.sphere.radius * 1e3

    # One compilation for all.
    @jax.jit(compiler_options=QUICKLY)
    def both(offset):
        return jax.jvp(radius, (offset,), (jnp.ones(()),))

    _, slope = both(jnp.zeros(()))
    step = 1e-3
    above, below = (both(jnp.asarray(sign * step))[0] for sign in (1, -1))
    differences = (above - below) / (2 * step)
    # The float32 radius is rounded to 4 nm, a part of 2e-3 of what it moves.
    assert float(slope) == pytest.approx(float(differences), rel=0.02)


def test_a_sphere_has_no_height_to_hold():
    with pytest.raises(ValueError, match="fixed must be one of center, radius"):
        fit_of(ball(), initial=ball(), fixed=("height",))
