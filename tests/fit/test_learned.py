"""Which error across the rays a fit ends with, of fits that are made up."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.fittable import SPHERE, no_guess
from impostor_jax.fit.learned import fit_with_learned_rays
from impostor_jax.fit.result import Fit
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.status import STATUSES, FitStatus
from impostor_jax.sensor.gaussian import ConstantNoise


def ended(status: FitStatus, found: float) -> Fit:
    """A fit whose residuals tell of an error."""
    blank = no_guess(SPHERE, np.ones((1, 1), bool))
    return dataclasses.replace(
        blank,
        status_code=jnp.array(STATUSES.index(status)),
        across=dataclasses.replace(
            blank.across,
            found=jnp.array(found),
            doubt=jnp.array(0.0),
            score=jnp.array(5.0),
        ),
    )


def test_error_with_which_nothing_is_determined_is_not_believed():
    # Of flying pixels that were taken for errors across the rays: with what they told
    # the next fit determined no radius, what that left told of twice as much, and the
    # fit from all starts failed.
    image = np.ones((1, 1), np.float32)
    camera = PinholeCamera(1.0, 1.0, 0.0, 0.0, 1, 1)
    seen = Seen(image, image > 0, camera, ConstantNoise(0.001))
    resumed = iter(
        [ended(FitStatus.CONVERGED, 0.0012), ended(FitStatus.UNDETERMINED, 0.0025)]
    )
    asked: list[float] = []

    def fitted(parts):
        asked.append(float(parts[0].noise.across or 0))
        return ended(FitStatus.CONVERGED, 0.001)

    fit_with_learned_rays(fitted, lambda *_: next(resumed), [seen], None)
    np.testing.assert_allclose(asked, [0, 0.0012], rtol=1e-6)
