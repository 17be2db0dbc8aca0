"""What a fit is not asked for costs nothing, by the size of its programs."""

from functools import partial

import jax.numpy as jnp
import numpy as np
import pytest
from impostor_jax.fit.residuals import residuals

import impostor_jax as ij
from impostor_jax.fit.assess import Start
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.evidence import gather_edge, gather_pixels
from impostor_jax.fit.prior import Prior
from impostor_jax.fit.request import Request
from impostor_jax.fit.round_body import CylinderBody, FrustumBody
from impostor_jax.fit.shapes import pixels_shown
from impostor_jax.fit.solve import evaluate, solve
from tests.checks import compiled_cost
from tests.fit.scenes import CAMERA, SIGMA, can, image
from tests.fit.test_residuals import rows_of

ROWS = 4096


def gradient_cost(fixed: tuple[str, ...], body: AbstractBody):
    rows = rows_of(np.float32, ROWS)
    return compiled_cost(partial(residuals, fixed=fixed), rows, body)


NAMES = ("center", "axis", "radius", "height")


@pytest.mark.parametrize("name", NAMES)
def test_a_held_parameter_has_no_gradient(name):
    body = CylinderBody.of(can())
    free = gradient_cost((), body)
    assert (gradient_cost((name,), body) < free).all()
    others = tuple(other for other in NAMES if other != name)
    assert (gradient_cost(others, body) < 0.9 * free).all()


def test_a_cylinder_has_no_gradient_of_a_slope():
    frustum = FrustumBody.of(ij.Frustum((0, 0, 0.5), (0, 0.1, 0.5), 0.05, 0.05))
    cylinder = gradient_cost((), CylinderBody.of(can()))
    assert (cylinder < gradient_cost((), frustum)).all()


def evaluation_cost(noise, is_outline=False):
    depth, mask = image()
    shown = pixels_shown(depth, mask, CAMERA, ij.ConstantNoise(SIGMA))
    place = jnp.float32(0.02)

    def run(depth, mask, row, col, noise, body):
        pixels = gather_pixels(depth, CAMERA, row, col)
        edge = gather_edge(depth, mask, CAMERA, row, col)
        return evaluate(pixels, edge, noise, is_outline, body, 0 * place, place)

    return compiled_cost(run, *shown[:4], noise, CylinderBody.of(can()))


def test_a_constant_sigma_needs_no_incidence():
    plain = evaluation_cost(ij.ConstantNoise(SIGMA))
    assert (plain < evaluation_cost(ij.StructuredLight())).all()


def test_the_edge_of_a_region_is_no_outline():
    noise = ij.ConstantNoise(SIGMA)
    assert evaluation_cost(noise)[0] < evaluation_cost(noise, is_outline=True)[0]


def fit_cost(prior=None, **request):
    """Operations of the program of a whole fit, before XLA makes it faster."""
    depth, mask = image()
    shown = pixels_shown(depth, mask, CAMERA, ij.ConstantNoise(jnp.float32(SIGMA)))
    start, belief = Start.at(CylinderBody.of(can())), prior or Prior()
    asked = Request(**request), jnp.float32(0.2)
    lowered = solve.lower(*shown, start, belief, *asked, is_far=True)
    return lowered.cost_analysis()["flops"]


def test_correlated_errors_and_a_prior_are_paid_by_those_who_ask():
    plain = fit_cost()
    assert plain < fit_cost(correlated=True)
    assert plain < fit_cost(Prior(radius=(jnp.float32(0.04), jnp.float32(0.001))))
    assert fit_cost(fixed=("axis", "center")) < plain
