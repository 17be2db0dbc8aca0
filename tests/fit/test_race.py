"""Which of several starts are worth a fit to all readings."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.options import Options
from impostor_jax.fit.problem import BLOCK, Inputs, posed
from impostor_jax.fit.race import Ends, coarse, worth_a_fit
from impostor_jax.fit.request import checked_prior, checked_settings
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.seen import Seen, shown_by
from tests.fit.bodies import body_of
from tests.fit.scenes import CAMERA, SIGMA, can, image, program_of
from tests.groups import FULL


def ends_with(cost, residual):
    """Ends that leave these residuals."""
    blank = RoundBody.of(can())
    return Ends(blank, np.array(cost), np.array(residual, float))


def test_ends_that_are_hopeless_are_dropped_and_equal_ones_are_one():
    residual = np.zeros((5, BLOCK))
    residual[2:] = 1.0
    # The first two leave the same; the third leaves other residuals at about the same
    # cost; the fourth is that again, and the last explains the readings far worse.
    ends = ends_with([500.0, 500.5, 510.0, 510.2, 900.0], residual)
    assert worth_a_fit(ends, 10 * BLOCK, 1.0) == {0: 2, 2: 2}
    # Where errors are shared, all readings tell little more than the few.
    assert worth_a_fit(ends, 2 * BLOCK, 100.0) == {0: 2, 2: 2, 4: 1}


def test_ends_that_all_readings_may_tell_apart_are_two():
    residual = np.zeros((2, BLOCK))
    residual[1, :4] = 1.0
    ends = ends_with([500.0, 500.5], residual)
    assert worth_a_fit(ends, BLOCK, 1.0) == {0: 2}
    assert worth_a_fit(ends, 20 * BLOCK, 1.0) == {0: 1, 1: 1}


def test_an_end_that_is_no_number_is_dropped():
    ends = ends_with([np.inf, 500.0, np.nan], np.zeros((3, BLOCK)))
    assert worth_a_fit(ends, BLOCK, 1.0) == {1: 1}
    none = ends_with([np.inf, np.inf], np.zeros((2, BLOCK)))
    assert worth_a_fit(none, BLOCK, 1.0) == {0: 2}


def started_from(*starts):
    program = program_of()
    return coarse(program.inputs.tables[0]), program.race(starts)


@FULL
@pytest.mark.parametrize("readings", [None, 1024, 512])
def test_the_few_keep_their_places_at_the_edge(readings):
    depth, mask = image()
    seen = Seen(depth, mask, CAMERA, ij.ConstantNoise(SIGMA))
    whole = posed_alone(shown_by(seen, readings))
    few = posed_alone(coarse(shown_by(seen, readings)))
    count = few.edge.inside.shape[1]
    assert few.pixels.depth.shape == (BLOCK,)
    assert 0 < count <= whole.edge.inside.shape[1]
    for field in ("depth", "exists"):
        found, wanted = (getattr(one.edge.pixels, field) for one in (few, whole))
        np.testing.assert_array_equal(found, wanted[:, :count])
    np.testing.assert_array_equal(few.edge.inside, whole.edge.inside[:, :count])
    np.testing.assert_array_equal(few.around.depth, whole.around.depth)


def posed_alone(table):
    settings = checked_settings(CYLINDER, Options(), None, SIGMA)
    prior = checked_prior(None, CYLINDER.parameters, None)
    (view,) = posed(Inputs(prior, settings, (table,), "geman_mcclure")).views
    return view


def test_starts_lead_to_the_object_on_the_readings_that_speak_for_all():
    near = ij.Cylinder(can().center, (0.5, 0.6, 0.5), 0.035, 0.1)
    across = ij.Cylinder(can().center, (0.9, -0.4, 0.1), 0.06, 0.05)
    few, ends = started_from(body_of(can()), body_of(near), body_of(across))
    assert few.row.shape == (BLOCK,)
    assert (few.row < CAMERA.height).all()
    # Half a millimeter: five hundred readings of 1 mm.
    np.testing.assert_allclose(ends.body.radius[:2], float(can().radius), atol=5e-4)
    assert ends.cost[2] > ends.cost[0] + 100
    # Both lead to one end, at costs that rounding orders.
    np.testing.assert_allclose(ends.cost[0], ends.cost[1], atol=0.01)
    assert list(worth_a_fit(ends, 5000, 1.0).values()) == [2]
