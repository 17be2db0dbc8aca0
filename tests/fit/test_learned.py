"""Which error across the rays a fit ends with."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.fittable import SPHERE, no_guess
from impostor_jax.fit.learned import SPEAKS, fit_with_learned_rays
from impostor_jax.fit.result import Fit
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.status import STATUSES, FitStatus
from impostor_jax.sensor.gaussian import ConstantNoise
from tests.fit.scenes import CAMERA, SIGMA, can, image
from tests.groups import SMALL_IMAGES

pytestmark = SMALL_IMAGES


IMAGE = np.ones((1, 1), np.float32)
SEEN = Seen(
    IMAGE,
    IMAGE > 0,
    PinholeCamera(1.0, 1.0, 0.0, 0.0, 1, 1),
    ConstantNoise(0.001),
)


def ended(status: FitStatus, found: float, score: float = 5.0) -> Fit:
    """A fit whose residuals tell of an error."""
    blank = no_guess(SPHERE, np.ones((1, 1), bool))
    return dataclasses.replace(
        blank,
        status_code=jnp.array(STATUSES.index(status)),
        across=dataclasses.replace(
            blank.across,
            found=jnp.array(found),
            doubt=jnp.array(0.0),
            score=jnp.array(score),
        ),
    )


def test_error_with_which_nothing_is_determined_is_not_believed():
    # Of flying pixels that were taken for errors across the rays: with what they told
    # the next fit determined no radius, what that left told of twice as much, and the
    # fit from all starts failed.
    resumed = iter(
        [ended(FitStatus.CONVERGED, 0.0012), ended(FitStatus.UNDETERMINED, 0.0025)]
    )
    asked: list[float] = []

    def fitted(parts):
        asked.append(float(parts[0].noise.across or 0))
        return ended(FitStatus.CONVERGED, 0.001)

    fit_with_learned_rays(fitted, lambda *_: next(resumed), [SEEN], None)
    np.testing.assert_allclose(asked, [0, 0.0012], rtol=1e-6)


@pytest.mark.parametrize(
    ("score", "anew", "status"),
    [
        # Residuals that hardly speak: the fit of exact rays is off by little.
        (2.0, FitStatus.UNDETERMINED, FitStatus.CONVERGED),
        (7.0, FitStatus.UNDETERMINED, FitStatus.UNDETERMINED),
        # All starts end without a number, and the fit that went on says why.
        (7.0, FitStatus.NOT_FINITE, FitStatus.UNDETERMINED),
    ],
)
def test_what_stands_where_a_fit_with_errors_across_fails(score, anew, status):
    def fitted(parts):
        is_exact = parts[0].noise.bias.has_exact_rays
        return ended(FitStatus.CONVERGED if is_exact else anew, 0.001, score)

    def resumed(*_):
        return ended(FitStatus.UNDETERMINED, 0.002, score)

    fit = fit_with_learned_rays(fitted, resumed, [SEEN], None)
    assert fit.status is status


@pytest.mark.parametrize("told", [SIGMA, 2 * SIGMA])
def test_an_error_across_is_found_whatever_the_noise_along(told):
    # It was told in units of the noise along the rays. Of a noise that was given, or
    # measured, twice too large, the next found more, without end: a can of 40 mm came
    # out as 80 +- 16 mm.
    finer, shift = 8, 0.5
    height, width = CAMERA.height, CAMERA.width
    fine = PinholeCamera(
        finer * CAMERA.fx,
        finer * CAMERA.fy,
        finer * (CAMERA.cx + 0.5) - 0.5,
        finer * (CAMERA.cy + 0.5) - 0.5,
        finer * width,
        finer * height,
    )
    can_depth = np.asarray(ij.render(can(), fine).depth)
    random = np.random.default_rng(3)
    row, col = np.indices((height, width)) + random.normal(0, shift, (2, height, width))
    place = [
        np.clip(np.round(finer * (x + 0.5) - 0.5).astype(int), 0, finer * size - 1)
        for x, size in ((row, height), (col, width))
    ]
    depth = np.minimum(can_depth[tuple(place)], 0.6)
    depth = depth + random.normal(0, SIGMA, depth.shape)
    _, mask = image(wall=None)
    fit = ij.fit_cylinder(depth, CAMERA, mask, told)
    assert fit.success
    across = shift / CAMERA.fx * 0.33
    assert 0.7 * across < float(fit.across.found) < 1.4 * across
    assert abs(float(fit.cylinder.radius) - 0.04) < 3 * float(fit.std.radius)
    assert float(fit.std.radius) < 1e-3


def test_nothing_is_learned_from_how_numbers_are_rounded():
    # By what is left of a depth that was drawn without noise, over itself, rays erred
    # by hundreds of deviations.
    can = ij.Cylinder((0.01, 0.0, 0.45), (0.2, 1.0, 0.3), radius=0.03, height=0.12)
    maps = ij.render(can, CAMERA, outputs=("depth", "mask"))
    fit = ij.fit_cylinder(np.minimum(maps.depth, 0.8), CAMERA, maps.mask, SIGMA)
    assert fit.success
    assert float(fit.across.score) < SPEAKS
    assert float(fit.across.deviation) == 0
