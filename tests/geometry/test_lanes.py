"""Loops of which each takes its own number of turns."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.geometry.lanes import in_lanes

COUNT = 1000


def countdown(given):
    def once(state):
        left, total = state
        return jnp.maximum(left - 1, 0), total + jnp.where(left > 0, given, 0)

    return once


@partial(jax.jit, static_argnames="lanes")
def counted_down(given, turns, lanes):
    state = turns, jnp.zeros_like(turns)
    return in_lanes(countdown, lambda s: s[0] > 0, given, state, lanes)


@pytest.mark.parametrize("lanes", [7, 100, COUNT, 2 * COUNT])
def test_each_takes_its_own_turns(lanes):
    rng = np.random.default_rng(0)
    given = rng.integers(1, 9, COUNT)
    turns = rng.integers(0, 50, COUNT)
    # Some wait, some are closed before they begin, among them the first and the last.
    turns[:200] = turns[-1] = 0
    left, total = counted_down(given, turns, lanes)
    assert np.all(left == 0)
    np.testing.assert_array_equal(total, given * turns)


def test_where_none_is_open_nothing_changes():
    none = np.zeros(COUNT, int)
    left, total = counted_down(none + 1, none, 7)
    assert np.all(left == 0)
    assert np.all(total == 0)


def test_mapped_over_problems_each_takes_its_own_turns():
    given = np.arange(1, 2 * 30 + 1).reshape(2, 30)
    turns = np.stack([np.arange(30) % 7, np.arange(30) % 3])
    _, total = jax.vmap(partial(counted_down, lanes=4))(given, turns)
    np.testing.assert_array_equal(total, given * turns)
