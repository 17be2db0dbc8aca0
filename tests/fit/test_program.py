"""The two compiled programs of a fit, of tables that are padded."""

import numpy as np

from impostor_jax.fit import program
from impostor_jax.fit.regions import BUCKETS
from tests.fit.bodies import body_of
from tests.fit.scenes import can, program_of
from tests.groups import SMALL_IMAGES

LARGER = BUCKETS[0] + 1
"""Places that are in the second of the sizes."""


def test_padding_holds_no_reading():
    (table,), (padded,) = (
        program_of(least=least).inputs.tables for least in (0, LARGER)
    )
    count, whole = len(table.row), len(padded.row)
    assert (count, whole) == BUCKETS[:2]
    more = whole - count
    assert not padded.rays.exists[:more].any()
    assert not padded.rays.depth[:more].any()
    for full, own in zip(padded.rays, table.rays, strict=True):
        if own is not None:
            np.testing.assert_array_equal(full[more:whole], own[:count])
    assert padded.num_blocks == table.num_blocks


def test_a_table_of_a_quick_fit_is_not_padded():
    (table,) = program_of(readings=1024).inputs.tables
    assert len(table.row) == 1024


@SMALL_IMAGES
def test_padding_does_not_move_the_estimate():
    start, given = body_of(can()), program_of()
    found, same = (
        program._solved()(one._of_solver, start)
        for one in (given, program_of(least=LARGER))
    )
    assert bool(found.converged)
    assert int(found.num_steps) == int(same.num_steps)
    # Sums of different lengths round differently.
    std = np.asarray(given.fit(start).fit.std.center)
    assert (np.abs(found.body.center - same.body.center) < 0.02 * std).all()
