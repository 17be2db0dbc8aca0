"""The compiled parts of a fit."""

import numpy as np

from impostor_jax.fit import program
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.options import Options
from impostor_jax.fit.program import Program, _filled
from impostor_jax.fit.request import checked_noise, checked_prior, checked_settings
from impostor_jax.fit.seen import Seen, shown_by
from tests.fit.bodies import body_of
from tests.fit.scenes import CAMERA, SIGMA, can, image
from tests.groups import SMALL_IMAGES


def program_of(readings=None):
    depth, mask = image()
    table = shown_by(Seen(depth, mask, CAMERA, checked_noise(SIGMA)), readings)
    settings = checked_settings(CYLINDER, Options(), None, SIGMA)
    known = checked_prior(None, CYLINDER.parameters, None)
    return Program((table,), known, settings, "geman_mcclure", correlated=False)


def test_a_table_is_filled_up_with_nothing():
    (table,) = program_of().shown
    filled = _filled(table)
    count, whole = len(table.row), len(filled.row)
    assert count < whole == len(_filled(filled).row)
    more = whole - count
    assert not filled.rays.exists[:more].any()
    assert not filled.rays.depth[:more].any()
    for full, own in zip(filled.rays, table.rays, strict=True):
        if own is not None:
            np.testing.assert_array_equal(full[more:], own)
    assert filled.num_blocks == table.num_blocks


def test_a_table_of_a_quick_fit_stays_small():
    (table,) = program_of(1024).shown
    assert _filled(table) is table


@SMALL_IMAGES
def test_a_solver_passes_over_what_only_fills_up():
    given = program_of()
    filled, prior, settings, start, kernel = given._for_solver(body_of(can()))
    found = program._solved()(filled, prior, settings, start, kernel)
    bare = (given.shown[0]._replace(lattice=None),)
    same = program._solved()(bare, prior, settings, start, kernel)
    assert bool(found.converged)
    assert int(found.num_steps) == int(same.num_steps)
    # Sums of other lengths are rounded otherwise.
    std = np.asarray(given.fit(start).fit.std.center)
    assert (np.abs(found.body.center - same.body.center) < 0.02 * std).all()
