"""What a search does with the fits of its candidates."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.find import search
from impostor_jax.find.caps import NO_CAPS
from impostor_jax.find.fitting import Fitter
from impostor_jax.fit.options import Options
from tests.find.scenes import CAMERA, SIGMA, WALL, image_of, seen, wall_of
from tests.groups import SMALL_IMAGES

pytestmark = SMALL_IMAGES
AXIS = np.array([0.4, 0.5, -0.77]) / np.linalg.norm([0.4, 0.5, -0.77])
CAN = ij.Cylinder((0.01, 0.01, 0.3), AXIS, 0.04, 0.04)
FLOOR = ij.Plane((0.0, 0.0, 0.5), (0.0, 0.0, -1.0))
BELOW = ij.Cylinder((-0.1, 0.03, 0.44), (0.0, 0.0, 1.0), 0.04, 0.12)


def searched(image):
    """A search of an image that has not begun."""
    noise = ij.ConstantNoise(SIGMA)
    fitter = Fitter.of(image.depth, CAMERA, noise, SIGMA, Options())
    return search._Search(seen(image.depth), search.Request(), fitter)


@pytest.fixture(scope="module")
def found():
    """A search, what is known of a can in its image, and the fit of that."""
    image = image_of([CAN, WALL])
    state = searched(image)
    entry = state._entry(state.scene(), wall_of(CAN))
    fit = ij.fit_cylinder(image.depth, CAMERA, image.owner == 0, SIGMA)
    assert entry.caps.rim > np.pi
    assert fit.success
    return state, entry, fit


@pytest.mark.parametrize("has_cap", [True, False])
def test_a_cap_that_was_not_fitted_yet_tells_the_radius(found, has_cap):
    # Of what is seen of the wall alone a fit may depart so far that it has none.
    state, entry, fit = found
    form = dataclasses.replace(fit.form, chi2=jnp.full_like(fit.form.chi2, 1e3))
    std = dataclasses.replace(fit.std, vector=jnp.full_like(fit.std.vector, 0.01))
    departing = fit.having(form=form, std=std)
    assert departing.form.departs
    if not has_cap:
        entry = entry._replace(caps=NO_CAPS)
    led = state._led_to(state.scene(), departing, entry)
    assert (led is None) == has_cap
    assert state._led_to(state.scene(), fit, entry) is not None


def test_what_is_seen_end_on_is_fitted_though_a_proposal_is_alike():
    # That of a can of 49 mm had 47 mm, and was refused; a part was found, of 40 mm.
    state = searched(image_of([BELOW, FLOOR]))
    parts = state._parts()
    first, *_ = state._guesses(parts, [])
    assert first.radius == pytest.approx(0.04, rel=0.03)
    rough = first._replace(radius=0.96 * first.radius)
    assert search.alike(rough, first)
    again, *_ = state._guesses(parts, [rough])
    assert again.radius == first.radius


@pytest.mark.parametrize("most", [1, 2])
def test_a_search_ends_after_many_candidates_that_are_none(monkeypatch, most):
    tried = []

    def refused(self, scene, entry):
        tried.append(entry)
        return False, []

    monkeypatch.setattr(search, "MOST_REFUSED", most)
    monkeypatch.setattr(search._Search, "_fitted", refused)
    assert not searched(image_of([CAN, BELOW, FLOOR])).took_another()
    assert len(tried) == most
