"""The two compiled programs of a fit."""

import dataclasses

import numpy as np

from impostor_jax.fit import program
from impostor_jax.fit.program import _padded
from tests.fit.bodies import body_of
from tests.fit.scenes import can, program_of
from tests.groups import SMALL_IMAGES


def test_padding_holds_no_reading():
    (table,) = program_of().inputs.tables
    padded = _padded(table)
    count, whole = len(table.row), len(padded.row)
    assert count < whole == len(_padded(padded).row)
    more = whole - count
    assert not padded.rays.exists[:more].any()
    assert not padded.rays.depth[:more].any()
    for full, own in zip(padded.rays, table.rays, strict=True):
        if own is not None:
            np.testing.assert_array_equal(full[more:], own)
    assert padded.num_blocks == table.num_blocks


def test_a_table_of_a_quick_fit_is_not_padded():
    (table,) = program_of(readings=1024).inputs.tables
    assert _padded(table) is table


@SMALL_IMAGES
def test_padding_does_not_move_the_estimate():
    given = program_of()
    start, (table,) = body_of(can()), given.inputs.tables
    found = program._solved()(given._of_solver, start)
    bare = (table._replace(lattice=None),)
    same = program._solved()(dataclasses.replace(given.inputs, tables=bare), start)
    assert bool(found.converged)
    assert int(found.num_steps) == int(same.num_steps)
    # Sums of different lengths round differently.
    std = np.asarray(given.fit(start).fit.std.center)
    assert (np.abs(found.body.center - same.body.center) < 0.02 * std).all()
