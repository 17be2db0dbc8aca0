"""Where work is done: a graphics card draws, and the processor fits.

A fit is some hundred small loops that wait for one another, and a card takes longer to
start each than to run it: on an NVIDIA H200 a can takes 1.3 times as long as beside it,
and its first call 17 s for 4.7 (`experiments/graphics_card`). So what is fitted, found
or tracked is done on the processor where JAX would take a card, unless
`jax_default_device` says otherwise; what is given may lie on either, and what is tied
to a card is copied. Traced calls, as a
`jax.vmap` of many fits, are JAX's to place: there a card gains.
"""

__all__ = ["Device", "asked", "is_processor", "on_processor", "where"]

import contextlib
import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeAlias, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

Given = ParamSpec("Given")
Values = TypeVar("Values")

Device: TypeAlias = Any
"""A `jax.Device`, which type checkers do not know."""

ASKED = "jax_default_device"
"""Setting of JAX: a device, the name of a platform, or None."""


def asked() -> Device | str | None:
    """What this thread's user has said of where work is done."""
    return getattr(jax.config, ASKED)


def where() -> Device:
    """The device of this thread's next call, where its arrays are tied to none."""
    device = asked()
    if isinstance(device, str):
        return jax.local_devices(backend=device)[0]
    return device or jax.local_devices()[0]


def is_processor() -> bool:
    """Whether that is a processor, whose cores each take one ray after the other."""
    return where().platform == "cpu"


def on_processor(function: Callable[Given, Values]) -> Callable[Given, Values]:
    """The function, done on a processor where nothing that it is given is traced."""

    @functools.wraps(function)
    def placed(*args: Given.args, **kwargs: Given.kwargs) -> Values:
        if asked() is not None or is_processor():
            return function(*args, **kwargs)
        leaves = jax.tree.leaves((args, kwargs))
        processor = _processor()
        if processor is None or any(isinstance(leaf, Tracer) for leaf in leaves):
            return function(*args, **kwargs)
        with jax.default_device(processor):
            if any(_is_tied(leaf, processor) for leaf in leaves):
                # Where any array is tied to a card JAX works there.
                args, kwargs = jax.tree.map(
                    lambda leaf: _untied(leaf, processor), (args, kwargs)
                )
            return function(*args, **kwargs)

    return placed


def _is_tied(value: Any, processor: Device) -> bool:
    """Whether an array is tied to another device."""
    return (
        isinstance(value, jax.Array)
        and value.committed
        and value.devices() != {processor}
    )


def _untied(value: Any, processor: Device) -> Any:
    """A copy of what is tied, where JAX places arrays now."""
    return jnp.asarray(np.asarray(value)) if _is_tied(value, processor) else value


def _processor() -> Device | None:
    """None where `jax_platforms` leaves it out."""
    with contextlib.suppress(RuntimeError):
        return jax.local_devices(backend="cpu")[0]
    return None
