"""What speaks for and against a cylinder, as facts."""

import dataclasses

import jax.numpy as jnp
import pytest

import impostor_jax as ij
from impostor_jax.find.caps import NO_CAPS, UNEVEN
from impostor_jax.find.confidence import FACTS, Observed, confidence, facts_of
from impostor_jax.find.evidence import weighed
from tests.find.scenes import CAMERAS, SIGMA, image_of, scene_of, wall_of

CAN = ij.Cylinder((0.0, 0.0, 0.4), (0.2, 0.95, 0.24), 0.05, 0.12)
NAMES = list(FACTS)


@pytest.fixture(scope="module")
def evidence():
    """Of a can that is seen alone."""
    image = image_of([CAN])
    return weighed(scene_of(image, free=image.owner >= 0), wall_of(CAN))


@pytest.fixture(scope="module")
def fit():
    """Of that can."""
    image = image_of([CAN])
    camera = CAMERAS["pinhole"]
    found = ij.fit_cylinder(image.depth, camera, image.owner == 0, sigma=SIGMA)
    assert found.success
    return found


def off_by(fit, share, sigmas):
    """A fit that is off by a part of the radius, and by so many standard deviations."""
    rms = jnp.asarray(share * float(fit.cylinder.radius), fit.rms.dtype)
    chi2 = jnp.asarray(sigmas**2, fit.chi2.dtype)
    return dataclasses.replace(fit, rms=rms, chi2=chi2)


def test_what_a_wall_is_rough_by_is_not_held_against_it(evidence, fit):
    observed = Observed(evidence, NO_CAPS, None)

    def told(share):
        return facts_of(observed, off_by(fit, share, 2.0))[NAMES.index("chi2")]

    assert told(UNEVEN) == 0
    assert told(10 * UNEVEN) == pytest.approx(3.0, rel=0.02)
    assert 0 < told(2 * UNEVEN) < told(10 * UNEVEN)


def test_chi2_says_nothing_where_sigma_is_not_all(evidence, fit):
    observed = Observed(evidence, NO_CAPS, None)
    facts = facts_of(observed, off_by(fit, 0.1, 2.0), noise=None)
    assert facts[NAMES.index("chi2")] == 0


def test_shared_errors_make_less_sure(evidence):
    def sure(shared):
        return confidence(facts_of(Observed(evidence, NO_CAPS, None, shared=shared)))

    assert sure(1.0) > sure(2.0) > sure(6.0) == sure(60.0)
