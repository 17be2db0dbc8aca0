"""Loops over many of which each takes its own number of turns.

In lockstep all wait for the slowest: of rays that march to steep ground the slowest
takes six times the turns of the mean. So some go side by side, in lanes, and a lane
that is through takes the next that waits. On devices with thousands of lanes of their
own all go side by side.
"""

__all__ = ["chosen_numbers", "in_lanes"]

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from impostor_jax.device import is_processor

LANES = 1024
"""Of how many the turns are taken side by side: what they hold stays in a processor's
cache."""

TURNS = 8
"""Of a lane before it may take another."""

Given = TypeVar("Given")
"""What each is given: arrays that broadcast to the states'."""

State = TypeVar("State")
"""What each is at: arrays that broadcast to one shape."""


class _Lanes(NamedTuple):
    """What lanes are at.

    Attributes:
        next: How many of those that wait have been taken.
        number: Whose turns each lane takes; that of all if none's.
        state: What these are at.
    """

    next: Int[Array, ""]
    number: Int[Array, " lanes"]
    state: Any


def in_lanes(
    turn: Callable[[Given], Callable[[State], State]],
    is_open: Callable[[State], Bool[Array, "*batch"]],
    given: Given,
    state: State,
    lanes: int = LANES,
) -> State:
    """Take turns until none is open.

    Args:
        turn: From what some are given to what takes a turn of theirs. It may be called
            with those that are not open any more, and must not change them.
        is_open: Who takes another turn, in the shape of all.
        given: Of each.
        state: Of each, before.
        lanes: How many go side by side.

    Returns:
        The states after the last turn.
    """
    shape = is_open(state).shape
    given, state = jax.tree.map(
        lambda x: jnp.broadcast_to(x, shape).reshape(-1), (given, state)
    )
    found = _of_many(turn, is_open, given, state, lanes)
    return jax.tree.map(lambda x: x.reshape(shape), found)


def _of_many(
    turn: Callable[[Given], Callable[[State], State]],
    is_open: Callable[[State], Bool[Array, " n"]],
    given: Given,
    state: State,
    lanes: int,
) -> State:
    """The same of arrays (n,)."""
    count = is_open(state).shape[0]
    if count <= lanes or not is_processor():
        once = turn(given)
        return jax.lax.while_loop(lambda s: jnp.any(is_open(s)), once, state)
    waiting, num_waiting = chosen_numbers(is_open(state))

    def refilled(at: _Lanes) -> _Lanes:
        """Lanes that are through take those that wait."""
        idle = (at.number == count) | ~is_open(at.state)
        place = at.next + jnp.cumsum(idle, dtype=jnp.int32) - 1
        fresh = idle & (place < num_waiting)
        number = jnp.where(idle, count, at.number)
        number = jnp.where(fresh, waiting[jnp.minimum(place, count - 1)], number)
        place = jnp.minimum(number, count - 1)
        return _Lanes(
            next=at.next + jnp.sum(fresh, dtype=jnp.int32),
            number=number,
            state=jax.tree.map(
                lambda x, kept: jnp.where(fresh, x[place], kept), state, at.state
            ),
        )

    def turned(carry: tuple[_Lanes, State]) -> tuple[_Lanes, State]:
        at, found = carry
        place = jnp.minimum(at.number, count - 1)
        once = turn(jax.tree.map(lambda x: x[place], given))
        after = jax.lax.fori_loop(0, TURNS, lambda _, s: once(s), at.state)
        put = jnp.where(is_open(after), count, at.number)
        found = jax.tree.map(
            lambda x, new: x.at[put].set(new, mode="drop", unique_indices=True),
            found,
            after,
        )
        return refilled(at._replace(state=after)), found

    blank = jax.tree.map(lambda x: x[:lanes], state)
    none = jnp.full(lanes, count, jnp.int32)
    begin = refilled(_Lanes(jnp.zeros((), jnp.int32), none, blank))
    _, found = jax.lax.while_loop(
        lambda carry: jnp.any(carry[0].number < count), turned, (begin, state)
    )
    return found


def chosen_numbers(
    chosen: Bool[Array, " n"],
) -> tuple[Int[Array, " n"], Int[Array, ""]]:
    """Numbers of what is chosen, in order, and how many there are."""
    count = chosen.shape[0]
    # Of rays that are known when it compiles, XLA would take a minute to count 100,000.
    chosen = jax.lax.optimization_barrier(chosen)
    place = jnp.where(chosen, jnp.cumsum(chosen, dtype=jnp.int32) - 1, count)
    number = jnp.arange(count, dtype=jnp.int32)
    order = jnp.zeros(count, jnp.int32)
    order = order.at[place].set(number, mode="drop", unique_indices=True)
    return order, jnp.sum(chosen, dtype=jnp.int32)
